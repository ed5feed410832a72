"""Which parts a camera would see under each hypothesis, and where: batched projection with self-occlusion by walls.

Shape legend: H hypotheses, n pairs (hypothesis, part), C corners, O objects, F faces of an object.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.layout import Layout

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LEAST_COSINE = 0.2
"""Parts seen more obliquely than this are not expected to be found."""


@dataclass(frozen=True, slots=True)
class Walls:
    """The faces of one object as parallelograms: origin, right, down and outward normal, each ``(F, 3)``."""

    origin: FloatArray
    right: FloatArray
    down: FloatArray
    normal: FloatArray


def walls_of(layout: Layout) -> list[Walls]:
    """The walls of each object; objects without faces hide nothing."""
    result = []
    for thing in layout.base.objects:
        corners = np.array([face.corners_mm for face in thing.faces]).reshape(-1, 4, 3)
        right, down = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
        normal = -np.cross(right, down)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        result.append(Walls(corners[:, 0], right, down, normal))
    return result


@dataclass(frozen=True, slots=True)
class Pairs:
    """Parts in view: hypothesis and part index ``(n,)``, corners ``(n, C, 2)`` px, cosine of incidence ``(n,)``."""

    hypothesis: IntArray
    part: IntArray
    corners_px: FloatArray = field(repr=False)
    cosine: FloatArray = field(repr=False)

    def take(self, rows: IntArray | BoolArray) -> Pairs:
        """Those rows."""
        return Pairs(self.hypothesis[rows], self.part[rows], self.corners_px[rows], self.cosine[rows])


def camera_in_objects(placement: FloatArray, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pan ``(H,)`` radians and centre ``(H, 3)`` of a camera ``(4,)`` in the object frames of placements ``(H, 4)``."""
    phi = placement[:, 0]
    away = camera[1:] - placement[:, 1:]
    c, s = np.cos(phi), np.sin(phi)
    # Ry(-phi) takes rig directions to the object frame.
    centre = np.stack([c * away[:, 0] - s * away[:, 2], away[:, 1], s * away[:, 0] + c * away[:, 2]], axis=1)
    return camera[0] + phi, centre


def parts_in_view(
    layout: Layout,
    walls: list[Walls],
    object_of: IntArray,
    placement: FloatArray,
    camera: FloatArray,
    internals: FloatArray,
    image_size: tuple[int, int],
    *,
    margin_px: float = 0.0,
    least_px: float = 8.0,
) -> Pairs:
    """All parts that face the camera, are nowhere hidden by a wall, and lie in the frame.

    Args:
        layout: the model base.
        walls: of ``walls_of``.
        object_of: ``(H,)`` object of each hypothesis.
        placement: ``(H, 4)`` object -> rig, radians and mm.
        camera: ``(4,)`` theta (radians), centre in the rig frame; or ``(H, 4)``, one for each hypothesis.
        internals: ``(H, 4)``.
        image_size: width, height.
        margin_px: corners must be so far inside the frame; negative: may be so far outside.
        least_px: parts smaller than this are left out.
    """
    pan, centre = camera_in_objects(placement, camera) if camera.ndim == 1 else _each(placement, camera)
    found = []
    for thing in np.unique(object_of):
        rows = np.flatnonzero(object_of == thing)
        span = slice(int(layout.first[thing]), int(layout.first[thing + 1]))
        pairs = _of_object(
            layout, walls[thing], rows, span, pan, centre, internals, np.array(image_size), margin_px, least_px
        )
        found.append(pairs)
    if not found:
        c = layout.corners_mm.shape[1]
        nothing = np.empty(0, dtype=np.int64)
        return Pairs(nothing, nothing, np.empty((0, c, 2)), np.empty(0))
    order = np.argsort(np.concatenate([f.hypothesis for f in found]), kind="stable")
    return Pairs(
        np.concatenate([f.hypothesis for f in found])[order],
        np.concatenate([f.part for f in found])[order],
        np.concatenate([f.corners_px for f in found])[order],
        np.concatenate([f.cosine for f in found])[order],
    )


def _each(placement: FloatArray, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
    phi = placement[:, 0]
    away = camera[:, 1:] - placement[:, 1:]
    c, s = np.cos(phi), np.sin(phi)
    centre = np.stack([c * away[:, 0] - s * away[:, 2], away[:, 1], s * away[:, 0] + c * away[:, 2]], axis=1)
    return camera[:, 0] + phi, centre


def _of_object(
    layout: Layout,
    walls: Walls,
    rows: IntArray,
    span: slice,
    pan: FloatArray,
    centre: FloatArray,
    internals: FloatArray,
    size: npt.NDArray[np.int64],
    margin_px: float,
    least_px: float,
) -> Pairs:
    middle = layout.centre_mm[span]
    row, part = _in_sight(middle, layout.normal[span], pan[rows], centre[rows], internals[rows], size)
    hypothesis = rows[row]
    ray = middle[part] - centre[hypothesis]
    cosine = -np.einsum("nk,nk->n", ray, layout.normal[span][part]) / np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
    facing = cosine > LEAST_COSINE
    hypothesis, part, cosine = hypothesis[facing], part[facing], cosine[facing]
    px, depth = _project(layout.corners_mm[span][part], pan[hypothesis], centre[hypothesis], internals[hypothesis])
    low, high = bounding_box(px)
    whole = np.asarray((depth > 0).all(axis=1))
    for k in (0, 1):
        whole &= (low[:, k] >= margin_px) & (high[:, k] <= size[k] - 1 - margin_px)
        whole &= high[:, k] - low[:, k] >= least_px
    whole[whole] = ~_hidden_in_part(layout, walls, part[whole] + span.start, centre[hypothesis[whole]])
    return Pairs(hypothesis[whole], part[whole] + span.start, px[whole], cosine[whole])


def _in_sight(
    middle: FloatArray,
    normal: FloatArray,
    pan: FloatArray,
    centre: FloatArray,
    internals: FloatArray,
    size: npt.NDArray[np.int64],
) -> tuple[IntArray, IntArray]:
    """(row, part) whose centres face the camera and lie in the frame; dense over all parts, so in matrix products."""
    c, s = np.cos(pan), np.sin(pan)
    flat = middle[:, [0, 2]].T
    z = np.stack([-s, c], axis=1) @ flat - (-s * centre[:, 0] + c * centre[:, 2])[:, None]
    x = np.stack([c, s], axis=1) @ flat - (c * centre[:, 0] + s * centre[:, 2])[:, None]
    fx, fy, u0, v0 = (internals[:, k, None] for k in range(4))
    u = fx * x + u0 * z
    inside = (z > 1e-6) & (u > 0) & (u < size[0] * z)
    inside &= centre @ normal.T > np.einsum("pk,pk->p", middle, normal)
    row, part = np.nonzero(inside)
    v = fy[row, 0] * (middle[part, 1] - centre[row, 1]) / z[row, part] + v0[row, 0]
    keep = (v > 0) & (v < size[1])
    return row[keep], part[keep]


def bounding_box(polygons: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest u, v ``(n, 2)`` of polygons ``(n, C, 2)``; corner by corner: reducing short axes is slow."""
    low, high = polygons[:, 0].copy(), polygons[:, 0].copy()
    for k in range(1, polygons.shape[1]):
        np.minimum(low, polygons[:, k], out=low)
        np.maximum(high, polygons[:, k], out=high)
    return low, high


def _project(
    points: FloatArray, pan: FloatArray, centre: FloatArray, internals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels ``(n, C, 2)`` and depths ``(n, C)`` of points ``(n, C, 3)`` in the object frame."""
    away = points - centre[:, None]
    c, s = np.cos(pan)[:, None], np.sin(pan)[:, None]
    x, y, z = c * away[..., 0] + s * away[..., 2], away[..., 1], -s * away[..., 0] + c * away[..., 2]
    safe = np.where(z > 1e-6, z, 1e-6)
    fx, fy, u0, v0 = np.moveaxis(internals[:, None], -1, 0)
    return np.stack([fx * x / safe + u0, fy * y / safe + v0], axis=-1), z


def _hidden_in_part(layout: Layout, walls: Walls, part: IntArray, eyes: FloatArray) -> BoolArray:
    """Whether a wall hides some of a part ``(n,)``: such a part is not expected whole. Its corners' rectangle tells."""
    hidden = np.zeros(len(part), dtype=bool)
    aside = 0.5 * _CORE * layout.size_mm[part, 0, None] * layout.along[part]
    below = np.zeros_like(aside)
    below[:, 1] = 0.5 * _CORE * layout.size_mm[part, 1]
    for a in (-1.0, 1.0):
        for b in (-1.0, 1.0):
            left = np.flatnonzero(~hidden)
            points = layout.centre_mm[part[left]] + a * aside[left] + b * below[left]
            hidden[left] = _hidden(walls, points, eyes[left])
    return hidden


_CORE = 0.9
"""Share of a part's width and height that must not be hidden: a wall that ends beside a part does not hide it."""


def _hidden(walls: Walls, points: FloatArray, eyes: FloatArray) -> BoolArray:
    """Whether a wall that faces the eye stands between the eye and the point, both ``(n, 3)``."""
    hidden = np.zeros(len(points), dtype=bool)
    ray = points - eyes
    for origin, right, down, normal in zip(walls.origin, walls.right, walls.down, walls.normal, strict=True):
        slope = ray @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((origin - eyes) @ normal) / slope
            hit = eyes + t[:, None] * ray - origin
            a, b = hit @ right / (right @ right), hit @ down / (down @ down)
        # The part's own wall is met at t = 1 and must not hide it.
        blocks = (slope < 0) & (t > 0) & (t < 0.98) & (a > 0) & (a < 1) & (b > 0) & (b < 1)
        hidden |= blocks
    return hidden
