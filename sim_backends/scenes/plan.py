"""Floor plans of generated buildings: right-angled outlines walked from corner to corner, and their walls."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.modelbase import Face

FloatArray = npt.NDArray[np.float64]

UNIT_MM = 35.0
"""All walls, gaps and margins are multiples of this or of half of it, so that plans close."""
STOREY_MM = 80.0
PARAPET_MM = 20.0

_SIDES = {(1, 0): "front", (0, 1): "right", (-1, 0): "back", (0, -1): "left"}


@dataclass(frozen=True, slots=True)
class Edge:
    """One side of an outline: its length, how many storeys stand on it, and which way the outline turns after it."""

    units: int
    storeys: int
    convex: bool = True


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall in the object frame (origin on the ground, amid the plan; Y down, so the wall rises towards negative y).

    Attributes:
        id: its side and a number, e.g. ``front1``.
        start_mm: ``(3,)`` foot of the left edge, seen from outside.
        along: ``(3,)`` unit vector to the right, seen from outside.
        units, storeys: as in the plan.
    """

    id: str
    start_mm: FloatArray
    along: FloatArray
    units: int
    storeys: int

    @property
    def outward(self) -> FloatArray:
        """``(3,)`` unit normal."""
        return np.array([self.along[2], 0.0, -self.along[0]])

    @property
    def height_mm(self) -> float:
        """From the ground to the top edge."""
        return self.storeys * STOREY_MM + PARAPET_MM

    def point(self, right_mm: float, up_mm: float) -> FloatArray:
        """``(3,)`` point on the wall, from its lower left corner."""
        return np.asarray(self.start_mm + right_mm * self.along + np.array([0.0, -up_mm, 0.0]))

    def face(self) -> Face:
        """The wall as a face of the model base."""
        width, height = self.units * UNIT_MM, self.height_mm
        corners = [(0.0, height), (width, height), (width, 0.0), (0.0, 0.0)]
        return Face(self.id, np.stack([self.point(*corner) for corner in corners]))


def walls(outline: list[Edge]) -> tuple[Wall, ...]:
    """The walls of an outline that begins at the front, left corner and keeps the outside on its right.

    Raises:
        ValueError: the outline does not close.
    """
    position, step = (0, 0), (1, 0)
    corners, steps = [position], []
    for edge in outline:
        position = (position[0] + edge.units * step[0], position[1] + edge.units * step[1])
        corners.append(position)
        steps.append(step)
        step = (-step[1], step[0]) if edge.convex else (step[1], -step[0])
    if position != (0, 0) or step != (1, 0):
        raise ValueError(f"the outline ends at {position} instead of where it began")
    middle = (np.max(corners, axis=0) + np.min(corners, axis=0)) / 2
    seen: Counter[str] = Counter()
    found: list[Wall] = []
    for edge, corner, (dx, dz) in zip(outline, corners, steps, strict=False):
        side = _SIDES[dx, dz]
        seen[side] += 1
        x, z = (np.array(corner) - middle) * UNIT_MM
        along = np.array([float(dx), 0.0, float(dz)])
        found.append(Wall(f"{side}{seen[side]}", np.array([x, 0.0, z]), along, edge.units, edge.storeys))
    return tuple(found)
