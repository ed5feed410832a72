"""Which parts a camera would see under each hypothesis, and where: batched projection with self-occlusion by walls.

Shape legend: H hypotheses, n pairs (hypothesis, part), C corners, O objects, F faces of all objects.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.kernels.sight import sight
from recognition.layout import Layout

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LEAST_COSINE = 0.2
"""Parts seen more obliquely than this are not expected to be found."""
LEAST_PART_PX = 8.0
"""Nor are parts smaller than this."""


@dataclass(frozen=True, slots=True)
class Walls:
    """The faces of all objects as parallelograms: origin, right, down and outward normal, each ``(F, 3)``.

    ``first`` ``(O + 1,)`` is the first wall of each object. Objects without faces hide nothing.
    """

    first: IntArray
    origin: FloatArray
    right: FloatArray
    down: FloatArray
    normal: FloatArray


def walls_of(layout: Layout) -> Walls:
    """The walls of all objects."""
    things = layout.base.objects
    corners = np.array([face.corners_mm for thing in things for face in thing.faces]).reshape(-1, 4, 3)
    right, down = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    normal = -np.cross(right, down)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    first = np.concatenate([[0], np.cumsum([len(thing.faces) for thing in things])])
    return Walls(first.astype(np.int64), corners[:, 0].copy(), right, down, normal)


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
    """Pan ``(H,)`` radians and centre ``(H, 3)`` of a camera in the object frames of placements ``(H, 4)``.

    The camera is one ``(4,)``, or one for each placement ``(H, 4)``.
    """
    phi = placement[:, 0]
    away = camera[..., 1:] - placement[:, 1:]
    c, s = np.cos(phi), np.sin(phi)
    # Ry(-phi) takes rig directions to the object frame.
    centre = np.stack([c * away[:, 0] - s * away[:, 2], away[:, 1], s * away[:, 0] + c * away[:, 2]], axis=1)
    return camera[..., 0] + phi, centre


def parts_in_view(
    layout: Layout,
    walls: Walls,
    object_of: IntArray,
    placement: FloatArray,
    camera: FloatArray,
    internals: FloatArray,
    image_size: tuple[int, int],
    *,
    margin_px: float = 0.0,
    least_px: float = LEAST_PART_PX,
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
    pan, centre = camera_in_objects(placement, camera)
    found = sight(
        layout.first,
        layout.centre_mm,
        layout.normal,
        layout.corners_mm,
        layout.corner_count,
        layout.core_mm,
        walls.first,
        walls.origin,
        walls.right,
        walls.down,
        walls.normal,
        object_of,
        pan,
        centre,
        internals,
        float(image_size[0]),
        float(image_size[1]),
        margin_px,
        least_px,
        LEAST_COSINE,
    )
    return Pairs(*found)


def bounding_box(polygons: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest u, v ``(n, 2)`` of polygons ``(n, C, 2)``; corner by corner: reducing short axes is slow."""
    low, high = polygons[:, 0].copy(), polygons[:, 0].copy()
    for k in range(1, polygons.shape[1]):
        np.minimum(low, polygons[:, k], out=low)
        np.maximum(high, polygons[:, k], out=high)
    return low, high
