"""Closed-form poses of many sets of matched corners at once, from nothing: the direct linear transform, read as a pose.

Four free internals and six degrees of freedom make the whole projection matrix but for its skew: eleven numbers, linear
in the pixels (the direct linear transform; Hartley and Zisserman, Multiple View Geometry, 7.1). Upright, the height
takes no part in u nor in the depth, which leaves nine. Both need points that do not lie in one plane; they minimise no
distance in the picture, so they are starts for `varpro`, not estimates.

Shape legend: H sets of corners, N points each. Everything is about points -> camera, p_cam = R p + t, mm.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.geometry import rotation_y

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LEAST_POINTS = {4: 5, 6: 6}
"""By degrees of freedom. Two equations a point: nine and eleven unknowns."""

_RIDGE = 1e-14  # against a singular system, of what has no pose or many
_FLAT = 1e-6  # smallest over largest variance of points that count as lying in one plane


def upright_starts(points_mm: FloatArray, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Poses of upright cameras.

    Args:
        points_mm: ``(H, N, 3)``, N at least five, not in one plane.
        pixels: ``(H, N, 2)``.

    Returns:
        ``(H, 4)`` theta (radians), x, y, z (mm), as ``refine_batch`` takes them, and whether they are sound: points
        not in one plane and in front, focal lengths positive. What is not sound is the identity.
    """
    points, centre, size = _normalised_points(points_mm)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    one = np.ones_like(x)
    (a, b, d), (e, f, g, h), (m, n, q) = _solved([x, z, one], [x, y, z, one], [x, z, one], pixels)
    depth = m[:, None] * x + n[:, None] * z + q[:, None]
    # The row of the depth is (-sin, 0, cos, tz) times a positive number.
    scale = 1.0 / np.maximum(np.hypot(m, n), 1e-12)
    sin, cos, tz = -m * scale, n * scale, q * scale
    fx, u0 = (a * cos + b * sin) * scale, (b * cos - a * sin) * scale
    fy, v0 = f * scale, (g * cos - e * sin) * scale
    with np.errstate(all="ignore"):
        shift = np.stack([(d * scale - u0 * tz) / fx, (h * scale - v0 * tz) / fy, tz], axis=-1) * size[:, None]
    theta = np.arctan2(sin, cos)
    shift = shift - np.einsum("hij,hj->hi", rotation_y(theta), centre)
    found = np.concatenate([theta[:, None], shift], axis=1)
    in_front = (depth * scale[:, None] > 0).all(axis=1)
    sound = _solid(points) & in_front & (fx > 0) & (fy > 0) & np.isfinite(found).all(axis=1)
    return np.where(sound[:, None], found, 0.0), sound


def general_starts(points_mm: FloatArray, pixels: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Poses of cameras that hang in any way: rotations ``(H, 3, 3)``, translations ``(H, 3)``, and whether sound.

    Arguments as in `upright_starts`, N at least six. The skew that the matrix may have is dropped.
    """
    points, centre, size = _normalised_points(points_mm)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    row = [x, y, z, np.ones_like(x)]
    matrix = np.stack([np.asarray(r).T for r in _solved(row, row, row, pixels)], axis=1)
    internals, rotation = _triangle_times_rotation(matrix[:, :, :3])
    with np.errstate(all="ignore"):
        shift = _backward(internals, matrix[:, :, 3]) * size[:, None]
        shift = shift - np.einsum("hij,hj->hi", rotation, centre)
    in_front = (np.einsum("hj,hnj->hn", rotation[:, 2], points_mm) + shift[:, 2:] > 0).all(axis=1)
    proper = np.linalg.det(matrix[:, :, :3]) > 0
    sound = _solid(points) & proper & in_front & np.isfinite(shift).all(axis=1)
    return np.where(sound[:, None, None], rotation, np.eye(3)), np.where(sound[:, None], shift, 0.0), sound


def _normalised_points(points_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points about their centre, in units of their root mean square distance from it; centres and units."""
    centre = points_mm.mean(axis=1)
    about = points_mm - centre[:, None]
    size = np.sqrt(np.einsum("hni,hni->h", about, about) / points_mm.shape[1])
    return about / size[:, None, None], centre, size


def _solid(points: FloatArray) -> BoolArray:
    values = np.linalg.eigvalsh(points.swapaxes(1, 2) @ points)
    return np.asarray(values[:, 0] > _FLAT * values[:, 2])


def _solved(
    over_u: list[FloatArray], over_v: list[FloatArray], depth: list[FloatArray], pixels: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of the three rows, each ``(terms, H)``, of u = over_u / depth and v = over_v / depth.

    Pixels are brought to mean 0 and sd 1 first, which changes internals alone: nobody asks for those. The scale of the
    rows is fixed by the depth of the points' centre, the last term, which is in front of every camera: 1.
    """
    mean, sd = pixels.mean(axis=1, keepdims=True), pixels.std(axis=1, keepdims=True)
    seen = (pixels - mean) / np.where(sd > 0, sd, 1.0)
    h, n = seen.shape[:2]
    i, j = len(over_u), len(over_u) + len(over_v)
    system = np.zeros((h, 2 * n, j + len(depth) - 1))
    system[:, :n, :i] = np.stack(over_u, axis=-1)
    system[:, n:, i:j] = np.stack(over_v, axis=-1)
    below = np.stack(depth[:-1], axis=-1)
    system[:, :n, j:], system[:, n:, j:] = -seen[..., :1] * below, -seen[..., 1:] * below
    right = np.concatenate([seen[..., 0], seen[..., 1]], axis=1)[..., None]
    turned = system.swapaxes(1, 2)
    normal = turned @ system + _RIDGE * n * np.eye(system.shape[2])
    solution = np.linalg.solve(normal, turned @ right)[..., 0].T
    return solution[:i], solution[i:j], np.concatenate([solution[j:], np.ones((1, h))])


def _triangle_times_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upper triangles of positive diagonal and rotations whose product is ``matrix`` ``(H, 3, 3)`` of positive det."""
    # QR of the matrix turned upside-down and transposed gives the factors in the order that is needed.
    q, r = np.linalg.qr(matrix[:, ::-1].swapaxes(1, 2))
    triangle, rotation = r.swapaxes(1, 2)[:, ::-1, ::-1], q.swapaxes(1, 2)[:, ::-1]
    sign = np.where(np.einsum("hii->hi", triangle) < 0, -1.0, 1.0)
    return triangle * sign[:, None, :], rotation * sign[:, :, None]


def _backward(triangle: FloatArray, right: FloatArray) -> FloatArray:
    """Solve upper triangular systems ``(H, 3, 3) @ x = (H, 3)``; zeros on the diagonal give infinities."""
    z = right[:, 2] / triangle[:, 2, 2]
    y = (right[:, 1] - triangle[:, 1, 2] * z) / triangle[:, 1, 1]
    x = (right[:, 0] - triangle[:, 0, 1] * y - triangle[:, 0, 2] * z) / triangle[:, 0, 0]
    return np.stack([x, y, z], axis=-1)
