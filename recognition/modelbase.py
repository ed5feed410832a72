"""The model base: objects, their parts (PART-OF), and each part's class (IS-A)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PartClass:
    """What all parts of one class share.

    Attributes:
        name: identifier, e.g. ``DW4``.
        corner_count: number of corners, at least 4.
        canonical: ``(n, 2)`` corners in the unit square, x right, y down, in the order in which every part of this
            class lists its corners; ``None`` for four corners (any quadrilateral).
        bright: True if the part is brighter than the wall around it, False if darker, ``None`` if it may be either.
    """

    name: str
    corner_count: int
    canonical: FloatArray | None = field(default=None, repr=False)
    bright: bool | None = False


@dataclass(frozen=True)
class Part:
    """One part of an object: a planar polygon.

    Attributes:
        id: unique in its object.
        part_class: name of its class.
        corners_mm: ``(n, 3)`` in the object frame, clockwise as seen from outside (X right, Y down, Z forward),
            starting top-left.
        face: name of the face it lies on, if any.
        look: free word for detectors that can tell more than the class.
        recess_mm: how far the part's surface lies behind its face, for rendering; the corners lie in the face.
    """

    id: str
    part_class: str
    corners_mm: FloatArray = field(repr=False)
    face: str | None = None
    look: str | None = None
    recess_mm: float = 0.0

    @cached_property
    def centre_mm(self) -> FloatArray:
        """``(3,)`` mean of the corners."""
        return np.asarray(self.corners_mm.mean(axis=0))

    @cached_property
    def normal(self) -> FloatArray:
        """``(3,)`` unit normal pointing out of the wall, towards whoever sees the corners clockwise."""
        p = self.corners_mm
        area = np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)
        return np.asarray(-area / np.linalg.norm(area))


@dataclass(frozen=True)
class Face:
    """A flat wall, for rendering and drawing: ``corners_mm`` ``(4, 3)``, clockwise from outside, top-left first."""

    id: str
    corners_mm: FloatArray = field(repr=False)


@dataclass(frozen=True)
class ObjectModel:
    """An object: its parts, and its walls where they are known."""

    id: str
    parts: tuple[Part, ...] = field(repr=False)
    faces: tuple[Face, ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class ModelBase:
    """All objects that can be told apart, and the classes of their parts."""

    objects: tuple[ObjectModel, ...]
    classes: tuple[PartClass, ...]
    name: str = ""

    def object(self, object_id: str) -> ObjectModel:
        """Return the object of that id (KeyError if there is none)."""
        for candidate in self.objects:
            if candidate.id == object_id:
                return candidate
        raise KeyError(object_id)
