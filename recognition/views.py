"""Views of an object as the pose estimator takes them, and the checks that keep confident nonsense out."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, rotation_y
from rig.errors import DegenerateGeometryError, InputError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_LEAST = {4: 4, 6: 4}
_COLLINEAR = 1e-6  # least height of a point set, as a fraction of its length


@dataclass(frozen=True, slots=True)
class View:
    """Corners matched in one picture. No internals: they are never known.

    Attributes:
        points_mm: ``(n, 3)`` in the object frame.
        pixels: ``(n, 2)`` where they were seen.
        camera: where the rig says the camera was, in the rig frame; only differences between views matter.
        internals_group: views with equal labels share their internals (zoom locked); ``None``: a group of its own.
        sigma_px: standard deviation of one corner coordinate: one number, or ``(n,)``.
    """

    points_mm: FloatArray = field(repr=False)
    pixels: FloatArray = field(repr=False)
    camera: CameraPose = field(default_factory=lambda: CameraPose(0.0, 0.0, 0.0, 0.0))
    internals_group: Hashable | None = None
    sigma_px: float | FloatArray = 0.5


@dataclass(frozen=True, slots=True)
class Observations:
    """All views in one table, in the frame of the first view's camera. N corners, V views, G groups.

    ``points_mm`` (N, 3), ``pixels`` (N, 2), ``weight`` (N,) 1/sigma, ``view`` (N,), ``cameras`` (V, 4) theta
    (radians) and centre, ``group`` (V,).
    """

    points_mm: FloatArray
    pixels: FloatArray
    weight: FloatArray
    view: IntArray
    cameras: FloatArray
    group: IntArray


def gather(views: Sequence[View], dof: int) -> Observations:
    """Check the views and join them.

    Raises:
        InputError: wrong shapes, NaN or infinity, no views, a sigma that is not positive.
        DegenerateGeometryError: too few, repeated or collinear points.
    """
    if dof not in _LEAST:
        raise InputError(f"a pose has 4 or 6 degrees of freedom, not {dof}", where="dof")
    if len(views) == 0:
        raise InputError("no views were given", where="views", remedy="Pass at least one View.")
    tables = [_checked(view, f"views[{k}]") for k, view in enumerate(views)]
    points = np.concatenate([t[0] for t in tables])
    _refuse_degenerate(points, tables, dof)
    first = views[0].camera
    turn = rotation_y(np.radians(first.theta_deg))
    cameras = np.array(
        [
            [np.radians(v.camera.theta_deg - first.theta_deg), *(turn @ (v.camera.centre_mm - first.centre_mm))]
            for v in views
        ]
    )
    if not np.all(np.isfinite(cameras)):
        raise InputError("a camera pose is not finite", where="views", remedy="Give centre and theta as numbers.")
    labels: dict[Hashable, int] = {}
    keys = [("own", k) if v.internals_group is None else ("shared", v.internals_group) for k, v in enumerate(views)]
    group = np.array([labels.setdefault(key, len(labels)) for key in keys])
    view = np.repeat(np.arange(len(views)), [len(t[0]) for t in tables])
    pixels, weight = (np.concatenate([t[c] for t in tables]) for c in (1, 2))
    return Observations(points, pixels, weight, view, cameras, group)


def _checked(view: View, where: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points, pixels and weights of one view as float arrays."""
    try:
        points, pixels = np.array(view.points_mm, dtype=np.float64), np.array(view.pixels, dtype=np.float64)
        sigma = np.array(view.sigma_px, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"points and pixels must be arrays of numbers ({error})", where=where) from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points_mm must have shape (n, 3), not {points.shape}", where=where)
    if pixels.shape != (len(points), 2):
        raise InputError(f"pixels must have shape ({len(points)}, 2) like the points, not {pixels.shape}", where=where)
    for name, values in (("points_mm", points), ("pixels", pixels)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise InputError(f"{name} of point {bad[0]} are not finite: {values[bad[0]]}", where=where)
    if sigma.shape not in ((), (len(points),)) or not np.all(np.isfinite(sigma) & (sigma > 0)):
        raise InputError("sigma_px must be positive: one number, or one a point", where=where)
    return points, pixels, np.broadcast_to(1.0 / sigma, len(points))


def _refuse_degenerate(
    points: FloatArray, tables: Sequence[tuple[FloatArray, FloatArray, FloatArray]], dof: int
) -> None:
    for k, (one, _, _) in enumerate(tables):
        _, first, count = np.unique(one, axis=0, return_index=True, return_counts=True)
        if np.any(count > 1):
            again = one[first[np.argmax(count)]]
            where = np.flatnonzero((one == again).all(axis=1))
            raise DegenerateGeometryError(f"views[{k}]: points {where[0]} and {where[1]} are repeated at {again} mm")
    distinct = np.unique(points, axis=0)
    if len(distinct) < _LEAST[dof]:
        raise DegenerateGeometryError(
            f"too few points: {len(distinct)} distinct corners cannot fix a pose of {dof} degrees of freedom without "
            f"known internals; at least {_LEAST[dof]} are needed"
        )
    if _nearly_collinear(distinct):
        raise DegenerateGeometryError("the points are collinear, all or all but one of them: they fix no pose")
    if all(len(t[1]) < 3 or _height(t[1]) <= 2.0 / float(t[2].max()) for t in tables):
        raise DegenerateGeometryError("the pixels are collinear within their noise in every view: a part seen edge-on")


def _nearly_collinear(points: FloatArray) -> bool:
    """True if all points, or all but one, lie on a line.

    At least two of any three points then lie on it, so the three lines through the first three points decide.
    """
    length = float(np.ptp(points, axis=0).max())
    for a, b in ((0, 1), (0, 2), (1, 2)):
        along = (points[b] - points[a]) / np.linalg.norm(points[b] - points[a])
        off = np.linalg.norm(np.cross(points - points[a], along), axis=1)
        if np.count_nonzero(off > _COLLINEAR * length) <= 1:
            return True
    return False


def _height(pixels: FloatArray) -> float:
    """Extent across the longest direction: twice the root mean square distance from the best line."""
    values = np.linalg.svd(pixels - pixels.mean(axis=0), compute_uv=False)
    return float(2.0 * values[-1] / np.sqrt(len(pixels)))
