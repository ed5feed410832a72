"""A model base compiled to arrays: every part of every object with its corners, its wall's directions and its shape.

Shape legend: P parts of all objects together, C corners (padded by repeating the last), S distinct shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from recognition.modelbase import ModelBase, Part

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SHAPE_TOLERANCE = 0.025
"""Parts whose corners agree within this fraction of their size share a shape; windows of one kind scatter by 1-2 %."""
CORE = 0.9
"""Share of a part's width and height that must not be hidden: a wall that ends beside a part does not hide it."""


@dataclass(frozen=True)
class Layout:
    """All parts as arrays.

    Attributes:
        base: the model base it was made from.
        corners_mm: ``(P, C, 3)`` in the object frame.
        corner_count: ``(P,)``.
        centre_mm: ``(P, 3)``.
        normal: ``(P, 3)`` outward.
        along: ``(P, 3)`` horizontal unit vector in the wall, to the right for who faces it from outside.
        local_mm: ``(P, C, 2)`` corners in the wall: along, and down, from the centre.
        size_mm: ``(P, 2)`` width and height.
        part_class: ``(P,)`` index into ``class_names``.
        object_of: ``(P,)`` index into ``base.objects``.
        first: ``(O + 1,)`` first part of each object.
        shape: ``(P,)`` index of the part's shape.
        shape_example: ``(S,)`` one part of each shape.
        core_mm: ``(P, 4, 3)`` corners of the rectangle in the middle of a part that must not be hidden.
    """

    base: ModelBase
    corners_mm: FloatArray
    corner_count: IntArray
    centre_mm: FloatArray
    normal: FloatArray
    along: FloatArray
    local_mm: FloatArray
    size_mm: FloatArray
    part_class: IntArray
    object_of: IntArray
    first: IntArray
    shape: IntArray
    shape_example: IntArray
    core_mm: FloatArray
    class_names: tuple[str, ...]
    part_ids: tuple[str, ...]

    @property
    def extent_mm(self) -> FloatArray:
        """``(O,)`` the largest horizontal or vertical extent of each object's parts."""
        spans = [np.ptp(self.centre_mm[a:b], axis=0).max(initial=0.0) for a, b in pairwise(self.first)]
        return np.asarray(spans)


def compile_layout(base: ModelBase) -> Layout:
    """Compile a model base."""
    parts = [part for thing in base.objects for part in thing.parts]
    names = tuple(c.name for c in base.classes)
    corners, count = _padded([p.corners_mm for p in parts])
    centre = np.array([p.centre_mm for p in parts])
    normal = np.array([p.normal for p in parts])
    along = np.stack([-normal[:, 2], np.zeros(len(parts)), normal[:, 0]], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    away = corners - centre[:, None]
    local = np.stack([np.einsum("pck,pk->pc", away, along), away[:, :, 1]], axis=2)
    sizes = [len(thing.parts) for thing in base.objects]
    part_class = np.array([names.index(p.part_class) for p in parts])
    shape, example = _shapes(local, part_class)
    size = np.asarray(np.ptp(local, axis=1))
    return Layout(
        base=base,
        corners_mm=corners,
        corner_count=count,
        centre_mm=centre,
        normal=normal,
        along=along,
        local_mm=local,
        size_mm=size,
        part_class=part_class,
        object_of=np.repeat(np.arange(len(sizes)), sizes),
        first=np.concatenate([[0], np.cumsum(sizes)]),
        shape=shape,
        shape_example=example,
        core_mm=_core(centre, along, size),
        class_names=names,
        part_ids=tuple(p.id for p in parts),
    )


def part_of(layout: Layout, index: int) -> Part:
    """The part behind an index."""
    thing = int(layout.object_of[index])
    return layout.base.objects[thing].parts[index - int(layout.first[thing])]


def _core(centre: FloatArray, along: FloatArray, size: FloatArray) -> FloatArray:
    aside = 0.5 * CORE * size[:, 0, None] * along
    below = np.stack([np.zeros(len(size)), 0.5 * CORE * size[:, 1], np.zeros(len(size))], axis=1)
    return np.stack([centre + a * aside + b * below for a in (-1.0, 1.0) for b in (-1.0, 1.0)], axis=1)


def _padded(polygons: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    longest = max(len(p) for p in polygons)
    padded = np.array([np.concatenate([p, np.repeat(p[-1:], longest - len(p), axis=0)]) for p in polygons])
    return padded, np.array([len(p) for p in polygons])


def _shapes(local: FloatArray, part_class: IntArray) -> tuple[IntArray, IntArray]:
    """Greedy clusters: a part joins the first shape of its class whose corners all lie within the tolerance."""
    shape = np.full(len(local), -1)
    examples: list[int] = []
    size = np.ptp(local, axis=1).max(axis=1)
    while (left := np.flatnonzero(shape < 0)).size:
        seed = int(left[0])
        gap = np.abs(local[left] - local[seed]).max(axis=(1, 2))
        same = (gap <= SHAPE_TOLERANCE * size[seed]) & (part_class[left] == part_class[seed])
        shape[left[same]] = len(examples)
        examples.append(seed)
    return shape, np.array(examples)
