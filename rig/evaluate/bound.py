"""A lower bound on views: how many even a perfect policy needs on average, on perfect views.

Two starts are alike if their first views show the very same parts at the very same place of the picture, through one
and the same camera. Nobody can tell starts that are alike by one view; further views can, each into at most as many
classes as there are different views at all. Fewer views than the length of a Huffman code with that many letters over
the starts that are alike cannot do. What the recogniser asks for beside the place (a sure pose, several parts) is not
counted, nor are misses and false parts, and that internals are unknown: all of them only cost more.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence
from functools import cache

import numpy as np

from recognition.geometry import camera_in_object, camera_in_rig
from recognition.modelbase import ModelBase, ObjectModel
from rig.evaluate.plan import Plan, Row
from rig.evaluate.staging import BENCHES, model_base
from sim_backends.internals_policy import FixedByZoom
from sim_backends.renderer import DEFAULT_SIZE
from sim_backends.sightlines import Sightlines
from sim_backends.simulate import draw_scene

SAME_PX = 4.0
"""Corners are told apart in steps of so many pixels; finer steps would lower the bound."""


def bounds(plan: Plan) -> list[float | None]:
    """The bound of each row of a plan; ``None`` for experiments and for objects that the base does not hold."""
    return [_bound(row) for row in plan.rows]


def _bound(row: Row) -> float | None:
    conditions = row.conditions
    if conditions.experiment is not None or conditions.object != "in_base":
        return None
    return least_views(row.source, conditions.bench)


@cache
def least_views(base_name: str, bench: str) -> float:
    """The bound for the starts of a bench before the objects of a model base."""
    base = model_base(base_name)
    alike: dict[bytes, list[float]] = defaultdict(list)
    for thing in base.objects:
        shown = first_views(base, thing, bench)
        for view in shown:
            alike[view].append(1.0 / len(shown) / len(base.objects))
    return 1.0 + sum(sum(group) * code_length(group, len(alike)) for group in alike.values())


def first_views(base: ModelBase, thing: ObjectModel, bench: str) -> list[bytes]:
    """What each possible start before an object shows, as a key: equal for views that are alike."""
    stood = BENCHES[bench](base, draw_scene(base, thing.id, 0), 0)
    lens = FixedByZoom()
    cameras = [camera_in_object(camera_in_rig(pose, stood.mount), stood.scene.object_in_rig) for pose in stood.poses]
    # A lens that only the zoom changes draws nothing.
    rng = np.random.default_rng(0)
    inner = [lens.internals(pose.zoom, rng) for pose in stood.poses]
    sightlines = Sightlines(thing, base.classes)
    pairs = sightlines.seen(cameras, inner, DEFAULT_SIZE)
    kind = sightlines.layout.part_class[pairs.part]
    places = np.rint(pairs.corners_px / SAME_PX).astype(np.int64).reshape(len(kind), -1)
    table = np.column_stack([kind, places])
    if not len(kind):
        return []
    by_view = np.split(table, np.flatnonzero(np.diff(pairs.hypothesis)) + 1)
    return [rows[np.lexsort(rows.T)].tobytes() for rows in by_view]


def code_length(weights: Sequence[float], letters: int) -> float:
    """Mean length of the best code with so many letters (2 or more) for words of these weights (Huffman).

    0 for one word; the weights need not sum to 1.
    """
    heap = [float(weight) for weight in weights]
    total = sum(heap)
    if len(heap) < 2:
        return 0.0
    # All but the first merging must be of as many as there are letters.
    letters = max(2, letters)
    first = (len(heap) - 2) % (letters - 1) + 2
    heapq.heapify(heap)
    length, take = 0.0, first
    while len(heap) > 1:
        merged = sum(heapq.heappop(heap) for _ in range(take))
        length += merged
        heapq.heappush(heap, merged)
        take = letters
    return length / total
