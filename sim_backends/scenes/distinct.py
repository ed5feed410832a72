"""Moves a building's exceptions about until no two places of a set of buildings have the same surroundings."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np

from sim_backends.scenes.building import REGULAR, Building, Place
from sim_backends.scenes.surroundings import differences

RADIUS_MM = 280.0
"""Four narrow bays: a few neighbouring close-ups."""
FEWEST_DIFFERENCES = 2
"""One missed part must not make two places the same."""


def make_distinct(buildings: Sequence[Building], rng: random.Random, most_rounds: int = 300) -> int:
    """Swap exceptions and regular windows within buildings until all surroundings differ; return the rounds needed.

    Counts of parts, of classes and of exceptions of each building stay as they are.

    Raises:
        ValueError: it did not succeed: there are too few exceptions for so many places.
    """
    for round_number in range(most_rounds):
        owners = [(b, place) for b in buildings for place, _ in b.parts()]
        pairs = _confusable(buildings)
        if not pairs:
            return round_number
        touched: set[int] = set()
        for pair in pairs:
            if touched.isdisjoint(pair):
                touched.update(pair)
                building, place = owners[pair[int(rng.random() * 2)]]
                _swap_near(building, place, rng)
    raise ValueError(f"{len(pairs)} pairs of places still look alike after {most_rounds} rounds")


def _confusable(buildings: Sequence[Building]) -> list[tuple[int, int]]:
    unlike = differences([building.object_model() for building in buildings], RADIUS_MM)
    first, second = np.nonzero(np.triu(unlike < FEWEST_DIFFERENCES, 1))
    return list(zip(first.tolist(), second.tolist(), strict=True))


def _swap_near(building: Building, place: Place, rng: random.Random) -> None:
    """Bring an exception from elsewhere in the building to a regular window near a place on its wall."""
    here = np.array(building.centre_mm(place))

    def near(other: Place) -> bool:
        return other[0] == place[0] and float(np.hypot(*(building.centre_mm(other) - here))) < RADIUS_MM / 2

    free = [other for other in building.cells if other not in building.fixed]
    regular = [other for other in free if building.cells[other] == REGULAR and near(other)]
    special = [other for other in free if building.cells[other] != REGULAR and not near(other)]
    if regular and special:
        a, b = regular[int(rng.random() * len(regular))], special[int(rng.random() * len(special))]
        building.cells[a], building.cells[b] = building.cells[b], building.cells[a]
