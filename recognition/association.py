"""Matching of expected parts to detections under many hypotheses at once.

Shape legend: H hypotheses, n pairs (hypothesis, part), D detections, C corners, M matches kept for each hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.layout import Layout
from recognition.seen import LEAST_CLASS_PROBABILITY, Seen
from recognition.visibility import Pairs, bounding_box

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_CHUNK = 200_000


@dataclass(frozen=True, slots=True)
class Matching:
    """For each pair the detection taken for it, -1 for none, and the rms distance of their corners, px."""

    pairs: Pairs
    detection: IntArray
    distance_px: FloatArray = field(repr=False)


def compatible(layout: Layout, seen: Seen) -> npt.NDArray[np.bool_]:
    """``(D, K)`` whether a detection may be of a class: same number of corners, class not ruled out."""
    corner_count = np.array([c.corner_count for c in layout.base.classes])
    return np.asarray(
        (seen.class_score >= LEAST_CLASS_PROBABILITY) & (seen.corner_count[:, None] == corner_count[None])
    )


def match(layout: Layout, pairs: Pairs, seen: Seen, gate_px: FloatArray, *, foremost: bool = False) -> Matching:
    """Take for each expected part the nearest detection within its gate; each detection serves one part.

    Args:
        layout: the model base.
        pairs: expected parts.
        seen: the view.
        gate_px: ``(n,)`` largest rms corner distance.
        foremost: of several outlines alike take the one that the detector likes best, not the nearest: right as long as
            parts are expected to no better than those differ.
    """
    n = len(pairs.part)
    detection = np.full(n, -1)
    distance = np.full(n, np.inf)
    if n and seen.count:
        allowed = compatible(layout, seen).T
        step = max(1, _CHUNK // max(seen.count, 1))
        flat = _unpadded(seen.corners_px, seen.corner_count)
        norm = (flat**2).sum(axis=1)
        count = layout.corner_count[pairs.part]
        for begin in range(0, n, step):
            rows = slice(begin, begin + step)
            expected = _unpadded(pairs.corners_px[rows], count[rows])
            square = (expected**2).sum(axis=1)[:, None] + norm - 2.0 * expected @ flat.T
            square = np.where(allowed[layout.part_class[pairs.part[rows]]], square, np.inf)
            best = square.argmin(axis=1)
            least = square[np.arange(len(best)), best]
            detection[rows] = best
            distance[rows] = np.sqrt(np.maximum(least, 0.0) / count[rows])
        if foremost:
            first = seen.foremost[detection]
            gap = _unpadded(pairs.corners_px, count) - flat[first]
            away = np.sqrt((gap**2).sum(axis=1) / count)
            liked = (away <= gate_px) & allowed[layout.part_class[pairs.part], first]
            detection, distance = np.where(liked, first, detection), np.where(liked, away, distance)
    detection = np.where(distance <= gate_px, detection, -1)
    detection = _one_each(pairs.hypothesis, detection, distance)
    return Matching(pairs, detection, np.where(detection >= 0, distance, np.inf))


def _unpadded(corners_px: FloatArray, count: IntArray) -> FloatArray:
    """``(n, 2 C)`` coordinates with those past each shape's own corners zero, so that they add nothing to distances."""
    real = np.arange(corners_px.shape[1]) < count[:, None]
    return np.asarray(np.where(real[..., None], corners_px, 0.0).reshape(len(count), -1))


def _one_each(hypothesis: IntArray, detection: IntArray, distance: FloatArray) -> IntArray:
    """Where two parts of a hypothesis claim the same detection, the nearer keeps it."""
    taken = np.flatnonzero(detection >= 0)
    if taken.size == 0:
        return detection
    order = taken[np.lexsort((distance[taken], detection[taken], hypothesis[taken]))]
    key = hypothesis[order] * (detection.max(initial=0) + 1) + detection[order]
    again = np.concatenate([[False], key[1:] == key[:-1]])
    result = detection.copy()
    result[order[again]] = -1
    return result


def vote_shift(
    pairs: Pairs, seen: Seen, hypotheses: int, reach_px: FloatArray, *, bin_px: float = 12.0, modes: int = 1
) -> tuple[FloatArray, FloatArray]:
    """The image shifts that bring most expected parts onto detections of about their size.

    A wrong focal length or principal point, or an uncertain place, moves all expected parts of a view alike, to first
    order; so each (part, detection) votes for the shift between them.

    Args:
        pairs: expected parts.
        seen: the view.
        hypotheses: H.
        reach_px: ``(H,)`` largest shift.
        bin_px: width of a bin.
        modes: how many shifts to return for each hypothesis.

    Returns:
        shifts ``(H, modes, 2)`` and votes ``(H, modes)``.
    """
    reach = float(reach_px.max(initial=0.0))
    half = int(np.ceil(reach / bin_px)) + 1
    side = 2 * half + 1
    shifts = np.zeros((hypotheses, modes, 2))
    counts = np.zeros((hypotheses, modes))
    across = (np.arange(side) - half) * bin_px
    # Of equal votes the smaller shift is the likelier.
    far = (0.4 * np.hypot(across[:, None], across[None]) / max(reach, 1.0)).astype(np.float32)
    owner, cell, weight = _votes(pairs, seen, reach_px, bin_px, half)
    for begin in range(0, hypotheses, _VOTERS):
        end = min(begin + _VOTERS, hypotheses)
        first, last = np.searchsorted(owner, [begin, end])
        votes = np.zeros((end - begin, side + 2, side + 2), dtype=np.float32)
        row, column = cell[first:last, 1] + 1, cell[first:last, 0] + 1
        np.add.at(votes, (owner[first:last] - begin, row, column), weight[first:last])
        rows = votes[:, :-2] + votes[:, 1:-1] + votes[:, 2:]
        smooth = rows[:, :, :-2] + rows[:, :, 1:-1] + rows[:, :, 2:] + 0.5 * votes[:, 1:-1, 1:-1] - far
        here = np.arange(end - begin)
        for mode in range(modes):
            best = smooth.reshape(end - begin, -1).argmax(axis=1)
            r, c = np.divmod(best, side)
            counts[begin:end, mode] = smooth[here, r, c]
            shifts[begin:end, mode] = np.stack([across[c], across[r]], axis=1)
            if mode + 1 < modes:
                _silence(smooth, r, c)
    return shifts, counts


_VOTERS = 512
_LEAST_VOTE = 0.3


def _votes(
    pairs: Pairs, seen: Seen, reach_px: FloatArray, bin_px: float, half: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Votes as (hypothesis ``(m,)`` rising, cell ``(m, 2)``, weight ``(m,)``): of a part for a cell the loudest."""
    low, high = bounding_box(pairs.corners_px)
    middle, size = (low + high) / 2, np.maximum(high - low, 1.0)
    limit = reach_px[pairs.hypothesis][:, None]
    seen_middle, log_seen, log_size = seen.centre_px, np.log(np.maximum(seen.size_px, 1.0)), np.log(size)
    near = np.ones((len(size), seen.count), dtype=bool)
    for k in (0, 1):
        near &= np.abs(seen_middle[None, :, k] - middle[:, k, None]) <= limit
        near &= np.abs(log_seen[None, :, k] - log_size[:, k, None]) < 0.3
    row, det = np.nonzero(near)
    weight = _LEAST_VOTE + (1.0 - _LEAST_VOTE) * seen.likeness[det]
    loudest = np.argsort(-weight, kind="stable")
    row, det, weight = row[loudest], det[loudest], weight[loudest]
    cell = np.rint((seen_middle[det] - middle[row]) / bin_px).astype(np.int64) + half
    side = 2 * half + 1
    key, first = np.unique((row * side + cell[:, 1]) * side + cell[:, 0], return_index=True)
    row, place = np.divmod(key, side * side)
    return pairs.hypothesis[row], np.stack([place % side, place // side], axis=1), weight[first]


def _silence(votes: npt.NDArray[np.float32], row: IntArray, column: IntArray) -> None:
    """Blank out the surroundings of a peak in each hypothesis's votes."""
    here, side = np.arange(len(votes)), votes.shape[1]
    for dr in range(-3, 4):
        for dc in range(-3, 4):
            votes[here, np.clip(row + dr, 0, side - 1), np.clip(column + dc, 0, side - 1)] = -1e9
