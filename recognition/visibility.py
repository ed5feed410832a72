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
    rows, parts = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for thing in np.unique(object_of):
        mine = np.flatnonzero(object_of == thing)
        first, end = int(layout.first[thing]), int(layout.first[thing + 1])
        middle, normal = layout.centre_mm[first:end], layout.normal[first:end]
        row, part = _in_sight(middle, normal, pan[mine], centre[mine], internals[mine], image_size)
        rows.append(mine[row])
        parts.append(part + first)
    hypothesis, part = np.concatenate(rows), np.concatenate(parts)
    ray = layout.centre_mm[part] - centre[hypothesis]
    cosine = -(ray * layout.normal[part]).sum(axis=1) / np.maximum(np.sqrt((ray**2).sum(axis=1)), 1e-9)
    kept = np.flatnonzero(cosine > LEAST_COSINE)
    kept = kept[np.argsort(hypothesis[kept], kind="stable")]
    hypothesis, part, cosine = hypothesis[kept], part[kept], cosine[kept]
    px, depth = _project(layout.corners_mm[part], pan[hypothesis], centre[hypothesis], internals[hypothesis])
    low, high = bounding_box(px)
    whole = np.asarray((depth > 0).all(axis=1))
    for k in (0, 1):
        whole &= (low[:, k] >= margin_px) & (high[:, k] <= image_size[k] - 1 - margin_px)
        whole &= high[:, k] - low[:, k] >= least_px
    whole[whole] = ~_hidden_in_part(layout, walls, object_of[hypothesis[whole]], part[whole], centre[hypothesis[whole]])
    return Pairs(hypothesis[whole], part[whole], px[whole], cosine[whole])


def enlarged(
    pairs: Pairs, centre_px: FloatArray, factor: float, image_size: tuple[int, int], beyond_px: float
) -> Pairs:
    """What is left in the frame when focal lengths grow by a factor, about principal points ``(H, 2)``.

    Which parts face the camera and are not hidden does not depend on the internals. The frame reaches ``beyond_px``
    beyond the picture, for corners; the middle of a part must be in the picture.
    """
    size = np.array(image_size)
    centre = centre_px[pairs.hypothesis][:, None]
    corners = (pairs.corners_px - centre) * factor + centre
    low, high = bounding_box(corners)
    middle = (low + high) / 2
    inside = (low >= -beyond_px) & (high <= size - 1 + beyond_px) & (middle > 0) & (middle < size)
    rows = np.flatnonzero(inside.all(axis=1))
    return Pairs(pairs.hypothesis[rows], pairs.part[rows], corners[rows], pairs.cosine[rows])


def _each(placement: FloatArray, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
    phi = placement[:, 0]
    away = camera[:, 1:] - placement[:, 1:]
    c, s = np.cos(phi), np.sin(phi)
    centre = np.stack([c * away[:, 0] - s * away[:, 2], away[:, 1], s * away[:, 0] + c * away[:, 2]], axis=1)
    return camera[:, 0] + phi, centre


def _in_sight(
    middle: FloatArray,
    normal: FloatArray,
    pan: FloatArray,
    centre: FloatArray,
    internals: FloatArray,
    size: tuple[int, int],
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


def _hidden_in_part(layout: Layout, walls: list[Walls], thing: IntArray, part: IntArray, eyes: FloatArray) -> BoolArray:
    """Whether a wall hides some of a part ``(n,)``: such a part is not expected whole. Its corners' rectangle tells."""
    hidden = np.zeros(len(part), dtype=bool)
    aside = 0.5 * _CORE * layout.size_mm[part, 0, None] * layout.along[part]
    below = np.zeros_like(aside)
    below[:, 1] = 0.5 * _CORE * layout.size_mm[part, 1]
    middle = layout.centre_mm[part]
    corners = np.stack([middle + a * aside + b * below for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    for one in np.unique(thing):
        rows = np.flatnonzero(thing == one)
        points = corners[:, rows].reshape(-1, 3)
        blocked = _hidden(walls[one], points, np.tile(eyes[rows], (len(corners), 1)))
        hidden[rows] = blocked.reshape(len(corners), -1).any(axis=0)
    return hidden


_CORE = 0.9
"""Share of a part's width and height that must not be hidden: a wall that ends beside a part does not hide it."""


def _hidden(walls: Walls, points: FloatArray, eyes: FloatArray) -> BoolArray:
    """Whether a wall that faces the eye stands between the eye and the point, both ``(n, 3)``."""
    ray = points - eyes
    slope = ray @ walls.normal.T
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((walls.origin * walls.normal).sum(axis=1) - eyes @ walls.normal.T) / slope
        # The part's own wall is met at t = 1 and must not hide it.
        blocks = (slope < 0) & (t > 0) & (t < 0.98)
        for side in (walls.right, walls.down):
            square = (side**2).sum(axis=1)
            at = (eyes @ side.T - (walls.origin * side).sum(axis=1) + t * (ray @ side.T)) / square
            blocks &= (at > 0) & (at < 1)
    return np.asarray(blocks.any(axis=1))
