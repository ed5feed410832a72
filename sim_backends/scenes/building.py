"""Generated buildings: bays and storeys of regular windows, with exceptions, turned into an object of a model base."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from recognition.modelbase import ObjectModel, Part
from recognition.part_classes import BUILT_IN_CLASSES
from sim_backends.scenes.plan import STOREY_MM, UNIT_MM, Edge, Wall, walls

FloatArray = npt.NDArray[np.float64]
T = TypeVar("T")

NARROW, WIDE = 2, 3
"""Distances between the middles of neighbouring bays, in plan units; together with the margins they fill a wall."""
MARGINS = 3
SILL_MM = 50.0
"""Height of the middle of the ground floor's windows."""

SIZES_MM = {
    "DW4": (30.0, 40.0),
    "OPEN": (30.0, 40.0),
    "DW6L": (40.0, 44.0),
    "DW6R": (40.0, 44.0),
    "DW8HANDLE": (36.0, 64.0),
    "DW8T": (46.0, 46.0),
    "DW12": (48.0, 48.0),
}


@dataclass(frozen=True, slots=True)
class Cell:
    """What is in one bay of one storey: a part, moved right and up by some mm, or nothing."""

    part_class: str | None
    right_mm: float = 0.0
    up_mm: float = 0.0


REGULAR = Cell("DW4")
MISSING = Cell(None)

Place = tuple[int, int, int]
"""Wall, storey from the ground, bay from the left: where a cell is."""


@dataclass
class Building:
    """A building in the making.

    Attributes:
        id: the object's id.
        walls: its walls.
        gaps: per wall, the distances between neighbouring bays in plan units.
        cells: what is where.
        recess_mm: part-class to how far its parts lie behind the wall.
        fixed: places that the search for distinct surroundings leaves alone.
    """

    id: str
    walls: tuple[Wall, ...]
    gaps: list[list[int]]
    cells: dict[Place, Cell]
    recess_mm: Mapping[str, float]
    fixed: set[Place] = field(default_factory=set)

    def centre_mm(self, place: Place) -> tuple[float, float]:
        """Right and up on the wall, of the middle of a cell."""
        wall, storey, bay = place
        right = (MARGINS / 2 + sum(self.gaps[wall][:bay])) * UNIT_MM
        return right, SILL_MM + storey * STOREY_MM

    def parts(self) -> Iterator[tuple[Place, Part]]:
        """All parts with their places."""
        for place, cell in self.cells.items():
            if cell.part_class is not None:
                yield place, self._part(place, cell, cell.part_class)

    def _part(self, place: Place, cell: Cell, name: str) -> Part:
        wall = self.walls[place[0]]
        width, height = SIZES_MM[name]
        right, up = self.centre_mm(place)
        left, top = right + cell.right_mm - width / 2, up + cell.up_mm + height / 2
        outline = BUILT_IN_CLASSES[name].canonical
        corners = [(0, 0), (1, 0), (1, 1), (0, 1)] if outline is None else outline
        points = np.stack([wall.point(left + x * width, top - y * height) for x, y in corners])
        part_id = f"{wall.id}_s{place[1]}_b{place[2]:02d}"
        return Part(part_id, name, points, wall.id, recess_mm=self.recess_mm[name])

    def object_model(self) -> ObjectModel:
        """The building as an object of a model base."""
        return ObjectModel(self.id, tuple(p for _, p in self.parts()), tuple(wall.face() for wall in self.walls))


def raise_building(name: str, outline: list[Edge], rng: random.Random) -> Building:
    """A building with all bays regular; only the order of narrow and wide gaps is drawn."""
    sides = walls(outline)
    gaps = [_gaps(wall.units, rng) for wall in sides]
    cells = {
        (index, storey, bay): REGULAR
        for index, wall in enumerate(sides)
        for storey in range(wall.storeys)
        for bay in range(len(gaps[index]) + 1)
    }
    recess = {part_class: rng.randrange(6, 17) / 2 for part_class in SIZES_MM}
    return Building(name, sides, gaps, cells, recess)


def _gaps(units: int, rng: random.Random) -> list[int]:
    """Narrow and wide gaps that fill a wall between its margins, in random order; about one in four is wide."""
    space = units - MARGINS
    wide = space % NARROW
    while wide + 1 < space / 10:
        wide += NARROW
    gaps = [WIDE] * wide + [NARROW] * ((space - wide * WIDE) // NARROW)
    return shuffled(gaps, rng)


def shuffled(items: Sequence[T], rng: random.Random) -> list[T]:
    """A copy in random order, by means of ``rng.random`` alone, whose numbers are the same in every Python."""
    return [item for _, item in sorted(((rng.random(), item) for item in items), key=lambda pair: pair[0])]


def strew(building: Building, cells: list[Cell], rng: random.Random) -> None:
    """Put exceptions into random regular places."""
    free = [place for place, cell in building.cells.items() if cell == REGULAR and place not in building.fixed]
    for place, cell in zip(shuffled(free, rng), cells, strict=False):
        building.cells[place] = cell
