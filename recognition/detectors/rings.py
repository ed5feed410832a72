"""Proposes the outlines just outside of those found: of concentric frames, segmentation often closes an inner one.

A frame, the paint around it and its sill give several parallel edges a few pixels apart. Whichever of them the region's
boundary followed, the part's own outline is often that quadrilateral with one or two sides on the next edges outwards.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from recognition.detectors.profiles import EdgeFit, Float32Array, fit_edges, mean_profiles, moved_sides

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

_MOVED_SIDES = 2  # at most
_EDGES = 3  # further edges looked at per side
_LEAST_STEP = 1.2  # grey levels per pixel
_SHARE = 0.25  # of the strongest step within reach
_BEYOND_PX = 1.6  # nearer edges are the side itself
_CONTAINER = 30.0  # outlines larger than this many times another do not make it an inner one


def outer_rings(planes: Float32Array, quads: FloatArray, reach_px: float, each: int) -> EdgeFit:
    """Outlines with one or two sides moved outwards to another edge, the ``each`` best supported ones of each outline.

    Args:
        planes: as `recognition.detectors.profiles.planes_of` gives them.
        quads: ``(K, 4, 2)``, clockwise. Those inside another one (panes) are left alone.
        reach_px: how far outwards edges are looked for.
        each: proposals per outline.
    """
    outer = quads[~inside_another(quads)]
    offsets = _further_edges(planes, outer, reach_px)
    whose, moves = _moves(offsets)
    proposals = moved_sides(outer[whose], moves)
    sound = np.isfinite(proposals).all(axis=(1, 2))
    fit = fit_edges(planes, proposals[sound], radius_px=2.0, samples=12)
    return fit.take(_best_of_each(whose[sound], fit.support.min(axis=1), each))


def inside_another(quads: FloatArray, slack_px: float = 1.0) -> BoolArray:
    """``(K,)``: the quadrilateral lies inside a larger one of the same picture, which is not very much larger."""
    low, high = quads.min(axis=1), quads.max(axis=1)
    area = _areas(quads)
    may = (low[:, None] >= low - slack_px).all(-1) & (high[:, None] <= high + slack_px).all(-1)
    may &= (area > 1.03 * area[:, None]) & (area < _CONTAINER * area[:, None])
    inner, container = np.nonzero(may)
    corners, around = quads[inner], quads[container]
    side = np.roll(around, -1, axis=1) - around
    normal = np.stack([side[..., 1], -side[..., 0]], axis=-1) / np.linalg.norm(side, axis=-1, keepdims=True)
    outside = np.einsum("pcsd,psd->pcs", corners[:, :, None] - around[:, None], normal)
    result = np.zeros(len(quads), dtype=bool)
    result[inner[(outside <= slack_px).all(axis=(1, 2))]] = True
    return result


def _areas(quads: FloatArray) -> FloatArray:
    x, y = quads[..., 0], quads[..., 1]
    return np.asarray(0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)))


def _further_edges(planes: Float32Array, quads: FloatArray, reach_px: float) -> FloatArray:
    """Offsets ``(K, 4, _EDGES)`` of the strongest further edges outside each side; NaN where there are fewer."""
    at, steps = mean_profiles(planes, quads, reach_px)
    size = np.linalg.norm(steps, axis=-1)
    middle = size[..., 1:-1]
    peak = (middle >= size[..., :-2]) & (middle > size[..., 2:]) & (at[1:-1] > _BEYOND_PX)
    peak &= middle > np.maximum(_LEAST_STEP, _SHARE * size.max(axis=-1, keepdims=True))
    height = np.where(peak, middle, -1.0)
    strongest = np.argsort(-height, axis=-1, kind="stable")[..., :_EDGES]
    there = np.take_along_axis(height, strongest, axis=-1) > 0
    return np.where(there, at[1:-1][strongest], np.nan)


def _moves(offsets: FloatArray) -> tuple[IntArray, FloatArray]:
    """Which outline is moved ``(P,)`` and how far each of its sides ``(P, 4)``."""
    choices = np.array([c for c in product(range(_EDGES + 1), repeat=4) if 0 < np.count_nonzero(c) <= _MOVED_SIDES])
    options = np.concatenate([np.zeros((len(offsets), 4, 1)), offsets], axis=-1)
    moves = options[:, np.arange(4), choices]  # (K, choices, 4)
    whose, which = np.nonzero(np.isfinite(moves).all(axis=-1))
    return whose, moves[whose, which]


def _best_of_each(group: IntArray, score: FloatArray, each: int) -> IntArray:
    """Indices of the ``each`` highest scores of every group."""
    order = np.lexsort((-score, group))
    sorted_group = group[order]
    start = np.searchsorted(sorted_group, sorted_group, side="left")
    return np.asarray(order[np.arange(len(order)) - start < each])
