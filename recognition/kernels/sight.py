"""Which parts each hypothesis shows a camera, and where: projection, frame, and self-occlusion by walls.

Shape legend: H hypotheses, n parts in view, P parts, C corners, O objects, F walls of all objects.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel
def sight(
    first: IntArray,
    centre_mm: FloatArray,
    normal: FloatArray,
    corners_mm: FloatArray,
    corner_count: IntArray,
    core_mm: FloatArray,
    wall_first: IntArray,
    wall_origin: FloatArray,
    wall_right: FloatArray,
    wall_down: FloatArray,
    wall_normal: FloatArray,
    object_of: IntArray,
    pan: FloatArray,
    eye: FloatArray,
    internals: FloatArray,
    width: float,
    height: float,
    margin_px: float,
    least_px: float,
    least_cosine: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Hypothesis ``(n,)`` (rising), part ``(n,)``, corners ``(n, C, 2)`` px and cosine of incidence ``(n,)``.

    ``first`` ``(O + 1,)`` and ``wall_first`` ``(O + 1,)`` tell the parts and the walls of each object; ``core_mm``
    ``(P, 4, 3)`` the points of a part that no wall may hide; ``pan`` ``(H,)`` and ``eye`` ``(H, 3)`` the camera in the
    object's frame.
    """
    corners = corners_mm.shape[1]
    room = 64 + 16 * len(object_of)
    hypothesis, part = np.empty(room, np.int64), np.empty(room, np.int64)
    pixels, cosine = np.empty((room, corners, 2)), np.empty(room)
    facing_wall, to_wall = np.empty(len(wall_origin), np.int64), np.empty(len(wall_origin))
    n = 0
    for h in range(len(object_of)):
        c, s = np.cos(pan[h]), np.sin(pan[h])
        fx, fy, u0, v0 = internals[h]
        thing = object_of[h]
        walls = 0
        for w in range(wall_first[thing], wall_first[thing + 1]):
            away = 0.0
            for a in range(3):
                away += (wall_origin[w, a] - eye[h, a]) * wall_normal[w, a]
            if away < 0.0:
                facing_wall[walls], to_wall[walls] = w, away
                walls += 1
        for p in range(first[thing], first[thing + 1]):
            x, y, z = centre_mm[p, 0] - eye[h, 0], centre_mm[p, 1] - eye[h, 1], centre_mm[p, 2] - eye[h, 2]
            facing = -(x * normal[p, 0] + y * normal[p, 1] + z * normal[p, 2])
            depth = c * z - s * x
            if facing <= 0.0 or depth <= 1e-6:
                continue
            u, v = fx * (c * x + s * z) + u0 * depth, fy * y + v0 * depth
            beyond = max(0.0, -margin_px) * depth
            if not (-beyond < u < width * depth + beyond and -beyond < v < height * depth + beyond):
                continue
            away = max(np.sqrt(x * x + y * y + z * z), 1e-9)
            if facing <= least_cosine * away:
                continue
            if n == room:
                room *= 2
                hypothesis, part = _longer(hypothesis, room), _longer(part, room)
                pixels, cosine = _longer(pixels, room), _longer(cosine, room)
            if not _project(corners_mm[p], corner_count[p], c, s, eye[h], internals[h], pixels[n]):
                continue
            if not _whole(pixels[n], width, height, margin_px, least_px):
                continue
            if _hidden(
                core_mm[p], eye[h], facing_wall[:walls], to_wall, wall_origin, wall_right, wall_down, wall_normal
            ):
                continue
            hypothesis[n], part[n] = h, p
            cosine[n] = facing / away
            n += 1
    return hypothesis[:n].copy(), part[:n].copy(), pixels[:n].copy(), cosine[:n].copy()


@kernel
def _longer(array: Any, room: int) -> Any:
    """A copy with more room at the end."""
    longer: Any = np.empty((room, *array.shape[1:]), array.dtype)
    longer[: len(array)] = array
    return longer


@kernel
def _project(
    corners: FloatArray, count: int, c: float, s: float, eye: FloatArray, internals: FloatArray, pixels: FloatArray
) -> bool:
    """Write a part's pixels, those past its own corners as its last; false where a corner is behind the camera."""
    for k in range(count):
        x, y, z = corners[k, 0] - eye[0], corners[k, 1] - eye[1], corners[k, 2] - eye[2]
        depth = c * z - s * x
        if depth <= 0.0:
            return False
        pixels[k, 0] = internals[0] * (c * x + s * z) / depth + internals[2]
        pixels[k, 1] = internals[1] * y / depth + internals[3]
    for k in range(count, len(corners)):
        pixels[k] = pixels[count - 1]
    return True


@kernel
def _whole(pixels: FloatArray, width: float, height: float, margin_px: float, least_px: float) -> bool:
    """Whether all corners are inside the frame by a margin, and the part is large enough."""
    for k, size in ((0, width), (1, height)):
        low, high = pixels[:, k].min(), pixels[:, k].max()
        if not (low >= margin_px and high <= size - 1.0 - margin_px and high - low >= least_px):
            return False
    return True


@kernel
def _hidden(
    points: FloatArray,
    eye: FloatArray,
    facing: IntArray,
    to_wall: FloatArray,
    origin: FloatArray,
    right: FloatArray,
    down: FloatArray,
    normal: FloatArray,
) -> bool:
    """Whether a wall, of those that face the eye, stands between it and any of some points ``(4, 3)``."""
    for i in range(len(facing)):
        w = facing[i]
        for k in range(len(points)):
            slope = 0.0
            for a in range(3):
                slope += (points[k, a] - eye[a]) * normal[w, a]
            # The part's own wall is met at t = 1 and must not hide it.
            if slope >= 0.0 or to_wall[i] <= 0.98 * slope:
                continue
            t = to_wall[i] / slope
            across, over, along, below = 0.0, 0.0, 0.0, 0.0
            for a in range(3):
                at = eye[a] + t * (points[k, a] - eye[a]) - origin[w, a]
                across += at * right[w, a]
                along += right[w, a] * right[w, a]
                over += at * down[w, a]
                below += down[w, a] * down[w, a]
            if 0.0 < across < along and 0.0 < over < below:
                return True
    return False
