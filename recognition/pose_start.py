"""Starts for the pose estimator, from nothing: a grid of rotations and distances, the rest linear in the pixels.

For a given rotation and distance, fx, fx tx and u0 are linear in u (fy, fy ty, v0 in v). Pixels are normalised to
mean 0 and sd 1 per view and coordinate, so the starts themselves do not depend on any internals.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.geometry import rotation_y
from recognition.rigid import Pose6

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_PULL = 0.02
"""Weight of the assumption that the principal point lies near the expected place, against the points' own weight."""


def rotation_grid(dof: int) -> tuple[FloatArray, FloatArray]:
    """Rotations ``(R, 3, 3)`` over the whole circle (or sphere), and their angles ``(R,)`` in radians for 4 DOF."""
    if dof == 4:
        # Offset by half a step: straight-on is a saddle between the two slants.
        angles = np.radians(np.arange(-175.0, 180.0, 10.0))
        return rotation_y(angles), angles
    grid = [
        Pose6.from_angles(theta, np.zeros(3), roll_deg=roll, pitch_deg=pitch).rotation
        for theta in np.arange(-170.0, 180.0, 20.0)
        for pitch in (-75.0, -50.0, -25.0, -5.0, 20.0, 45.0, 70.0)
        for roll in (-75.0, -50.0, -25.0, 3.0, 30.0, 55.0, 80.0)
    ]
    # Theta runs over the full circle and roll over a half: with pitch turned by 180 degrees that covers upside-down.
    flipped = [np.diag([-1.0, -1.0, 1.0]) @ r for r in grid]
    rotations = np.array(grid + flipped)
    return rotations, np.zeros(len(rotations))


def normalise_pixels(pixels: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels ``(n, 2)`` brought to mean 0 and sd 1 per coordinate; with the means and the sds, ``(2,)`` each."""
    mean, sd = pixels.mean(axis=0), pixels.std(axis=0)
    sd = np.where(sd > 0, sd, max(float(sd.max()), 1.0))
    return (pixels - mean) / sd, mean, sd


def linear_starts(
    points_mm: FloatArray, pixels: FloatArray, expected: FloatArray, rotations: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Best translation for every rotation and distance.

    Args:
        points_mm: ``(n, 3)``, in a frame whose origin is at their centre.
        pixels: ``(n, 2)`` normalised.
        expected: ``(2,)`` expected principal point, normalised.
        rotations: ``(R, 3, 3)``.

    Returns:
        index ``(S,)`` into the rotations, translations ``(S, 3)`` and misfits ``(S,)`` (sum of squares, normalised
        pixels), of those starts that have all points in front and positive focal lengths.
    """
    turned = points_mm @ rotations.transpose(0, 2, 1)
    radius = float(np.sqrt((points_mm**2).sum(axis=1).mean()))
    distance = radius * np.geomspace(1.2, 60.0, 10)
    z = turned[:, None, :, 2] + distance[:, None]
    near = z.min(axis=-1) > 0.05 * distance
    inverse = 1.0 / np.where(near[..., None], z, 1.0)
    focal, shift, misfit = [], [], np.zeros(near.shape)
    for c in (0, 1):
        scale, offset, rest = _fit_coordinate(turned[:, None, :, c] * inverse, inverse, pixels[:, c] - expected[c])
        focal.append(scale)
        shift.append(offset)
        misfit = misfit + rest
    good = near & (focal[0] > 1e-9) & (focal[1] > 1e-9) & np.isfinite(misfit)
    which, at = np.nonzero(good)
    translations = np.stack([shift[0][good], shift[1][good], distance[at]], axis=-1)
    return which.astype(np.int64), translations, np.asarray(misfit[good])


def _fit_coordinate(x: FloatArray, inverse: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Focal length, shift and misfit of u = f (x + t / Z) + u0 with a soft u0 = 0; arrays ``(R, D, n)``."""
    typical = inverse.mean(axis=-1, keepdims=True)
    design = np.stack([x, inverse / typical, np.ones_like(x)], axis=-1)
    normal = design.swapaxes(-1, -2) @ design
    normal[..., 2, 2] += _PULL * x.shape[-1]
    diagonal = np.einsum("...aa->...a", normal)
    normal = normal + 1e-12 * np.eye(3) * np.maximum(diagonal, 1e-12)[..., None]
    solved = np.linalg.solve(normal, (design.swapaxes(-1, -2) @ u)[..., None])
    rest = u - (design @ solved)[..., 0]
    misfit = (rest**2).sum(axis=-1) + _PULL * x.shape[-1] * solved[..., 2, 0] ** 2
    f = solved[..., 0, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = solved[..., 1, 0] / (f * typical[..., 0])
    return f, t, np.asarray(misfit)
