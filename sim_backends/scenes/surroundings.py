"""Tells which places of some objects look alike: parts with the same other parts around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from recognition.links import part_frame
from recognition.modelbase import ObjectModel

IntArray = npt.NDArray[np.int64]

SAME_MM = 4.0
"""Parts that stand within about this of each other count as standing in the same place."""


def differences(objects: Sequence[ObjectModel], radius_mm: float, max_turn_deg: float = 100.0) -> IntArray:
    """``(n, n)`` number of parts by which the surroundings of any two of the n parts of all objects differ.

    The surroundings of a part are the classes and places, in its own frame, of the parts within a radius that face at
    most ``max_turn_deg`` away from it, itself included. A part that only one of two places has counts one.
    """
    import scipy.sparse  # late: half a second

    numbers = {name: i for i, name in enumerate(sorted({part.part_class for o in objects for part in o.parts}))}
    rows, keys, row = [], [], 0
    for thing in objects:
        seen = _surroundings(thing, radius_mm, max_turn_deg, numbers)
        rows.append(seen[0] + row)
        keys.append(seen[1])
        row += len(thing.parts)
    _, columns = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    entries = (np.ones(len(columns), dtype=np.int64), (np.concatenate(rows), columns.ravel()))
    table = scipy.sparse.csr_array(entries, shape=(row, int(columns.max()) + 1))
    shared = (table @ table.T).todense()
    sizes = shared.diagonal()
    return np.asarray(sizes[:, None] + sizes[None, :] - 2 * shared, dtype=np.int64)


def _surroundings(
    thing: ObjectModel, radius_mm: float, max_turn_deg: float, numbers: dict[str, int]
) -> tuple[IntArray, IntArray]:
    """``(m,)`` parts, and ``(m, 5)`` what each has around it: place in steps of ``SAME_MM``, facing, class."""
    frames = [part_frame(part) for part in thing.parts]
    rotations, centres = np.stack([r for r, _ in frames]), np.stack([c for _, c in frames])
    classes = np.array([numbers[part.part_class] for part in thing.parts])
    offsets = centres[None, :] - centres[:, None]
    turns = rotations[:, :, 2] @ rotations[:, :, 2].T
    near = (np.linalg.norm(offsets, axis=2) <= radius_mm) & (turns >= np.cos(np.radians(max_turn_deg)))
    i, j = np.nonzero(near)
    places = np.einsum("mji,mj->mi", rotations[i], offsets[i, j])
    # The odd offset keeps places on the buildings' lattice away from the borders of the steps.
    steps = np.floor(places / SAME_MM + 0.37)
    return i, np.column_stack([steps, np.round(2 * turns[i, j]), classes[j]]).astype(np.int64)


def share_with_a_twin(objects: Sequence[ObjectModel], radius_mm: float, *, in_another_object: bool) -> float:
    """Share of parts whose surroundings on their own wall are found again, within the radius (in another object)."""
    same = differences(objects, radius_mm, max_turn_deg=45.0) == 0
    owner = np.repeat(np.arange(len(objects)), [len(thing.parts) for thing in objects])
    if in_another_object:
        same &= owner[:, None] != owner[None, :]
    else:
        np.fill_diagonal(same, False)
    return float(same.any(axis=1).mean())
