"""Makes an object that no model base holds but that shares most of its layout with one that it does hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from recognition.modelbase import ObjectModel
from sim_backends.walls import Wall, walls_of

FloatArray = npt.NDArray[np.float64]

SHARED = 0.8
"""Share of the parts that stay where they are."""
_GAP = 0.15
"""Least gap between parts, and to a wall's edges, as a share of the moved part's width."""
_TRIES = 200


def stranger(thing: ObjectModel, rng: np.random.Generator, shared: float = SHARED) -> ObjectModel:
    """The object with the places of some of its parts drawn anew, each on its own wall, mostly in its own storey.

    Args:
        thing: the object to begin from.
        rng: draws which parts move, and where to.
        shared: share of the parts that stay.

    Raises:
        ValueError: a part finds no other place on its wall.
    """
    parts = list(thing.parts)
    moving = rng.permutation(len(parts))[: round((1.0 - shared) * len(parts))]
    wall_of = {index: wall for wall in walls_of(thing) for index in wall.parts}
    for index in sorted(int(k) for k in moving):
        wall = wall_of[index]
        others = [parts[k].corners_mm for k in wall.parts if k != index]
        parts[index] = replace(parts[index], corners_mm=_elsewhere(parts[index].corners_mm, wall, others, rng))
    return ObjectModel(f"{thing.id} altered", tuple(parts), thing.faces)


def _elsewhere(corners: FloatArray, wall: Wall, others: Sequence[FloatArray], rng: np.random.Generator) -> FloatArray:
    """The part's corners ``(n, 3)`` at another place on its wall, clear of the other parts."""
    here = _box(corners, wall)
    taken = np.array([_box(other, wall) for other in others]).reshape(-1, 4)
    size = here[2:] - here[:2]
    gap = _GAP * size[0]
    room = np.array(wall.size_mm) - size - 2.0 * gap
    for turn in range(_TRIES):
        low = gap + rng.random(2) * room
        if turn < _TRIES // 2:
            low[1] = here[1]
        apart = (taken[:, :2] > low + size + gap) | (taken[:, 2:] < low - gap)
        # Nearer than half its width, it would hardly be another place.
        if apart.any(axis=1).all() and np.abs(low - here[:2]).max() > size[0] / 2:
            along, down = _axes(wall)
            return np.asarray(corners + (low - here[:2]) @ np.stack([along, down]))
    raise ValueError(f"a part of wall {wall.id} finds no other place on it")


def _axes(wall: Wall) -> tuple[FloatArray, FloatArray]:
    a, b, _, d = wall.corners_mm
    return (b - a) / np.linalg.norm(b - a), (d - a) / np.linalg.norm(d - a)


def _box(corners: FloatArray, wall: Wall) -> FloatArray:
    """``(4,)`` least and greatest place along and down the wall."""
    flat = (corners - wall.corners_mm[0]) @ np.stack(_axes(wall), axis=1)
    return np.concatenate([flat.min(axis=0), flat.max(axis=0)])
