"""Points seen from known camera poses, and the normal equations that they give in a placement and the internals.

Shape legend: H hypotheses, N points (padded; weight 0), V views, G groups of views that share internals, P parameters
in the order of ``recognition.motion``. A camera is a row: cos and sin of its pan, and its centre; internals are (fx,
fy, u0, v0).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@kernel
def _in_camera(
    point: FloatArray,
    camera: FloatArray,
    rotation: FloatArray,
    shift: FloatArray,
    tilt: FloatArray,
    turned: FloatArray,
    seen: FloatArray,
) -> None:
    """Write R p into ``turned``, and the point in the camera's frame without and with tilt into ``seen`` ``(2, 3)``."""
    for a in range(3):
        turned[a] = rotation[a, 0] * point[0] + rotation[a, 1] * point[1] + rotation[a, 2] * point[2]
    x, z = turned[0] + shift[0] - camera[2], turned[2] + shift[2] - camera[4]
    seen[0, 0], seen[0, 1] = camera[0] * x + camera[1] * z, turned[1] + shift[1] - camera[3]
    seen[0, 2] = camera[0] * z - camera[1] * x
    seen[1] = seen[0]
    if len(tilt):
        _turn(seen[1], np.cos(tilt[0]), np.sin(tilt[0]), np.cos(tilt[1]), np.sin(tilt[1]))


@kernel
def _divide(seen: FloatArray, radial: FloatArray) -> tuple[float, float, float]:
    """Normalised x and y, with the radial term, and what 1 / depth was taken to be."""
    inverse = 1.0 / (seen[2] if abs(seen[2]) >= 1e-9 else 1e-9)
    x, y = seen[0] * inverse, seen[1] * inverse
    if len(radial):
        grow = 1.0 + radial[0] * (x * x + y * y)
        x, y = x * grow, y * grow
    return x, y, inverse


@kernel
def _slopes(
    camera: FloatArray,
    upright: bool,
    tilt: FloatArray,
    radial: FloatArray,
    turned: FloatArray,
    seen: FloatArray,
    inverse: float,
    column: FloatArray,
    slope: FloatArray,
) -> None:
    """Derivatives ``(2, P)`` of x and y, from what `_in_camera` wrote; ``column`` ``(P, 3)`` is room to work in."""
    c, s = camera[0], camera[1]
    column[:] = 0.0
    # Derivatives in the rig frame, turned into the camera's.
    if upright:
        column[0, 0], column[0, 2] = turned[2], -turned[0]
        n = 1
    else:
        column[0, 1], column[0, 2] = -turned[2], turned[1]
        column[1, 0], column[1, 2] = turned[2], -turned[0]
        column[2, 0], column[2, 1] = -turned[1], turned[0]
        n = 3
    for a in range(3):
        column[n + a, a] = 1.0
    n += 3
    for k in range(n):
        column[k, 0], column[k, 2] = c * column[k, 0] + s * column[k, 2], c * column[k, 2] - s * column[k, 0]
    if len(tilt):
        column[n, 0], column[n, 1] = -seen[0, 1], seen[0, 0]
        cr, sr, cp, sp = np.cos(tilt[0]), np.sin(tilt[0]), np.cos(tilt[1]), np.sin(tilt[1])
        for k in range(n + 1):
            _turn(column[k], cr, sr, cp, sp)
        column[n + 1, 1], column[n + 1, 2] = -seen[1, 2], seen[1, 1]
        n += 2
    x, y = seen[1, 0] * inverse, seen[1, 1] * inverse
    for k in range(n):
        slope[0, k] = (column[k, 0] - x * column[k, 2]) * inverse
        slope[1, k] = (column[k, 1] - y * column[k, 2]) * inverse
    if len(radial):
        square = x * x + y * y
        grow = 1.0 + radial[0] * square
        for k in range(n):
            more = 2.0 * radial[0] * (x * slope[0, k] + y * slope[1, k])
            slope[0, k], slope[1, k] = slope[0, k] * grow + x * more, slope[1, k] * grow + y * more
        slope[0, n], slope[1, n] = x * square, y * square


@kernel
def _turn(v: FloatArray, cr: float, sr: float, cp: float, sp: float) -> None:
    """Rx(pitch) Rz(roll) applied in place."""
    x, y = cr * v[0] - sr * v[1], sr * v[0] + cr * v[1]
    v[0], v[1], v[2] = x, cp * y - sp * v[2], sp * y + cp * v[2]


@kernel
def normalise(
    points_mm: FloatArray,
    view: IntArray,
    cameras: FloatArray,
    rotation: FloatArray,
    upright: bool,
    shift: FloatArray,
    tilt: FloatArray,
    radial: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coordinates ``(H, 2, N)``, derivatives ``(H, 2, P, N)`` and depths ``(H, N)`` of all points."""
    count, most = view.shape
    size = (1 if upright else 3) + 3 + tilt.shape[1] + radial.shape[1]
    place, slopes, depth = np.empty((count, 2, most)), np.empty((count, 2, size, most)), np.empty((count, most))
    turned, seen, column, slope = np.empty(3), np.empty((2, 3)), np.empty((size, 3)), np.empty((2, size))
    for h in range(count):
        for n in range(most):
            camera = cameras[view[h, n]]
            _in_camera(points_mm[h, n], camera, rotation[h], shift[h], tilt[h], turned, seen)
            x, y, inverse = _divide(seen[1], radial[h])
            z = seen[1, 2]
            _slopes(camera, upright, tilt[h], radial[h], turned, seen, inverse, column, slope)
            place[h, 0, n], place[h, 1, n], depth[h, n] = x, y, z
            slopes[h, :, :, n] = slope
    return place, slopes, depth


@kernel
def inner_sums(
    points_mm: FloatArray,
    pixels: FloatArray,
    weight: FloatArray,
    residuals: FloatArray,
    view: IntArray,
    group: IntArray,
    groups: int,
    cameras: FloatArray,
    rotation: FloatArray,
    shift: FloatArray,
    tilt: FloatArray,
    radial: FloatArray,
    tail_sd: float,
) -> tuple[FloatArray, FloatArray]:
    """The data's information in the internals ``(H, G, 4, 4)`` and right-hand side ``(H, G, 4)``.

    ``residuals`` ``(H, N, 2)`` px of the last evaluation weaken the pull of what is off by more than ``tail_sd``
    (0: of nothing).
    """
    count, most = view.shape
    information, right = np.zeros((count, groups, 4, 4)), np.zeros((count, groups, 4))
    turned, seen = np.empty(3), np.empty((2, 3))
    for h in range(count):
        for n in range(most):
            if weight[h, n] == 0.0:
                continue
            _in_camera(points_mm[h, n], cameras[view[h, n]], rotation[h], shift[h], tilt[h], turned, seen)
            x, y, _ = _divide(seen[1], radial[h])
            w = _pull(weight[h, n], residuals[h, n], tail_sd)
            g = group[h, n]
            _add_inner(information[h, g], x, y, w)
            u, v = pixels[h, n, 0] * w, pixels[h, n, 1] * w
            right[h, g, 0] += x * u
            right[h, g, 1] += y * v
            right[h, g, 2] += u
            right[h, g, 3] += v
    return information, right


@kernel
def joint_sums(
    points_mm: FloatArray,
    pixels: FloatArray,
    weight: FloatArray,
    view: IntArray,
    group: IntArray,
    cameras: FloatArray,
    rotation: FloatArray,
    upright: bool,
    shift: FloatArray,
    tilt: FloatArray,
    radial: FloatArray,
    tail_sd: float,
    internals: FloatArray,
    nearest_mm: float,
    furthest: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]:
    """Residuals ``(H, N, 2)`` px and the normal equations at given internals ``(H, G, 4)``.

    Then: information and gradient of the pose ``(H, P, P)``, ``(H, P)``, information between internals and pose
    ``(H, G, 4, P)``, information and gradient of the internals ``(H, G, 4, 4)``, ``(H, G, 4)``, -2 log likelihood
    ``(H,)``, and whether all depths are above ``nearest_mm`` and below ``furthest`` times the points' extent ``(H,)``.
    """
    count, most = view.shape
    groups = internals.shape[1]
    size = (1 if upright else 3) + 3 + tilt.shape[1] + radial.shape[1]
    residuals = np.zeros((count, most, 2))
    pose, gradient = np.zeros((count, size, size)), np.zeros((count, size))
    mixed = np.zeros((count, groups, 4, size))
    inner, inner_gradient = np.zeros((count, groups, 4, 4)), np.zeros((count, groups, 4))
    cost, within = np.zeros(count), np.ones(count, np.bool_)
    turned, seen, column, slope = np.empty(3), np.empty((2, 3)), np.empty((size, 3)), np.empty((2, size))
    for h in range(count):
        furthest_mm = furthest * _extent(points_mm[h])
        for n in range(most):
            if weight[h, n] == 0.0:
                continue
            camera = cameras[view[h, n]]
            _in_camera(points_mm[h, n], camera, rotation[h], shift[h], tilt[h], turned, seen)
            x, y, inverse = _divide(seen[1], radial[h])
            z = seen[1, 2]
            _slopes(camera, upright, tilt[h], radial[h], turned, seen, inverse, column, slope)
            if not (nearest_mm < z < furthest_mm):
                within[h] = False
            g = group[h, n]
            fx, fy, u0, v0 = internals[h, g]
            ru, rv = pixels[h, n, 0] - fx * x - u0, pixels[h, n, 1] - fy * y - v0
            residuals[h, n, 0], residuals[h, n, 1] = ru, rv
            square = weight[h, n] * weight[h, n] * (ru * ru + rv * rv)
            cost[h] += square if tail_sd == 0.0 else tail_sd * tail_sd * np.log1p(square / (tail_sd * tail_sd))
            w = _pull(weight[h, n], residuals[h, n], tail_sd)
            _add_inner(inner[h, g], x, y, w)
            inner_gradient[h, g, 0] -= w * x * ru
            inner_gradient[h, g, 1] -= w * y * rv
            inner_gradient[h, g, 2] -= w * ru
            inner_gradient[h, g, 3] -= w * rv
            for a in range(size):
                ju, jv = w * fx * slope[0, a], w * fy * slope[1, a]
                gradient[h, a] -= ju * ru + jv * rv
                mixed[h, g, 0, a] += x * ju
                mixed[h, g, 1, a] += y * jv
                mixed[h, g, 2, a] += ju
                mixed[h, g, 3, a] += jv
                for b in range(a, size):
                    pose[h, a, b] += ju * fx * slope[0, b] + jv * fy * slope[1, b]
        for a in range(size):
            for b in range(a):
                pose[h, a, b] = pose[h, b, a]
    return residuals, pose, gradient, mixed, inner, inner_gradient, cost, within


@kernel
def _extent(points: FloatArray) -> float:
    """The largest difference of a coordinate among points ``(N, 3)``."""
    most = 0.0
    for a in range(3):
        low, high = np.inf, -np.inf
        for n in range(len(points)):
            low, high = min(low, points[n, a]), max(high, points[n, a])
        most = max(most, high - low)
    return most


@kernel
def _pull(weight: float, residual: FloatArray, tail_sd: float) -> float:
    """Weight of a corner under the Cauchy loss on its distance, both coordinates together."""
    square = weight * weight
    if tail_sd == 0.0:
        return square
    off: float = square * (residual[0] * residual[0] + residual[1] * residual[1])
    return square / (1.0 + off / (tail_sd * tail_sd))


@kernel
def _add_inner(information: FloatArray, x: float, y: float, w: float) -> None:
    """Add a point to the information in the internals."""
    information[0, 0] += w * x * x
    information[1, 1] += w * y * y
    information[2, 2] += w
    information[3, 3] += w
    information[0, 2] += w * x
    information[2, 0] += w * x
    information[1, 3] += w * y
    information[3, 1] += w * y
