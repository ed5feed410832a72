"""Closed forms for known rotation: translation and internals of one view are then linear in what was seen.

With (a, b, c) = R p known, u = fx (a + tx) / (c + tz) + u0 reads  u tz - fx a - (fx tx + u0 tz) - u0 c = -u c,
linear in tz, fx, fx tx + u0 tz and u0; v likewise, sharing tz. Eliminating the internals from these rows leaves the
translation linear in the invariants, so four points in general position need no start and no iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TranslationSolution:
    """``translation_mm`` (3,) of points -> camera, and the by-product ``internals`` (4,): fx, fy, u0, v0."""

    translation_mm: FloatArray
    internals: FloatArray


def translation_given_rotation(points_mm: FloatArray, pixels: FloatArray, rotation: FloatArray) -> TranslationSolution:
    """Translation of one uncalibrated view whose rotation (points -> camera) is known, by linear least squares.

    Args:
        points_mm: ``(n, 3)``, n >= 4, not coplanar.
        pixels: ``(n, 2)``.
        rotation: ``(3, 3)``.

    Raises:
        DegenerateGeometryError: too few points; coplanar points (then x trades against u0, even with the rotation
            known); or the only solution has points behind the camera or a negative focal length.
    """
    n = len(points_mm)
    if n < 4:
        raise DegenerateGeometryError(f"{n} points leave the translation open; at least 4 are needed")
    centre, mean = points_mm.mean(axis=0), pixels.mean(axis=0)
    spread = float(np.abs(pixels - mean).max()) or 1.0
    size = float(np.abs(points_mm - centre).max()) or 1.0
    (a, b, c), (u, v) = (rotation @ (points_mm - centre).T) / size, ((pixels - mean) / spread).T
    one, o = np.ones(n), np.zeros(n)
    rows = np.concatenate([np.stack([u, -a, -one, -c, o, o, o], axis=1), np.stack([v, o, o, o, -b, -one, -c], axis=1)])
    values = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), compute_uv=False)
    if values[-1] < 1e-9 * values[0]:
        raise DegenerateGeometryError(
            "the points are coplanar or nearly so: the translation trades against the principal point even where the "
            "rotation is known"
        )
    tz, fx, ax, u0, fy, ay, v0 = np.linalg.lstsq(rows, -np.concatenate([u * c, v * c]), rcond=None)[0]
    if min(fx, fy) <= 0 or np.any(c + tz <= 0):
        raise DegenerateGeometryError("no translation puts all points in front of the camera at this rotation")
    t = np.array([(ax - u0 * tz) / fx, (ay - v0 * tz) / fy, tz]) * size - rotation @ centre
    return TranslationSolution(t, np.array([fx * spread, fy * spread, u0 * spread + mean[0], v0 * spread + mean[1]]))
