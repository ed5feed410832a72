"""Matching of expected parts to detections under many hypotheses at once.

Shape legend: H hypotheses, n pairs (hypothesis, part), D detections, C corners, M matches kept for each hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.layout import Layout
from recognition.seen import LEAST_CLASS_PROBABILITY, Seen
from recognition.visibility import Pairs

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


def match(layout: Layout, pairs: Pairs, seen: Seen, gate_px: FloatArray) -> Matching:
    """Take for each expected part the nearest detection within its gate; each detection serves one part.

    Args:
        layout: the model base.
        pairs: expected parts.
        seen: the view.
        gate_px: ``(n,)`` largest rms corner distance.
    """
    n = len(pairs.part)
    detection = np.full(n, -1)
    distance = np.full(n, np.inf)
    if n and seen.count:
        allowed = compatible(layout, seen).T
        step = max(1, _CHUNK // max(seen.count, 1))
        flat = seen.corners_px.reshape(seen.count, -1)
        norm = (flat**2).sum(axis=1)
        for begin in range(0, n, step):
            rows = slice(begin, begin + step)
            expected = pairs.corners_px[rows].reshape(-1, flat.shape[1])
            square = (expected**2).sum(axis=1)[:, None] + norm - 2.0 * expected @ flat.T
            square = np.where(allowed[layout.part_class[pairs.part[rows]]], square, np.inf)
            best = square.argmin(axis=1)
            least = square[np.arange(len(best)), best]
            detection[rows] = best
            distance[rows] = np.sqrt(np.maximum(least, 0.0) / seen.corners_px.shape[1])
    detection = np.where(distance <= gate_px, detection, -1)
    detection = _one_each(pairs.hypothesis, detection, distance)
    return Matching(pairs, detection, np.where(detection >= 0, distance, np.inf))


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
    low, high = pairs.corners_px.min(axis=1), pairs.corners_px.max(axis=1)
    middle, size = (low + high) / 2, np.maximum(high - low, 1.0)
    gap = seen.centre_px[None] - middle[:, None]
    ratio = np.abs(np.log(np.maximum(seen.size_px[None], 1.0) / size[:, None])).max(axis=2)
    near = (np.abs(gap) <= reach_px[pairs.hypothesis][:, None, None]).all(axis=2) & (ratio < 0.3)
    row, det = np.nonzero(near)
    shift = gap[row, det]
    cell = np.rint(shift / bin_px).astype(np.int64) + half
    # One vote of a part for a cell, however many detections stand there.
    key = np.unique(np.stack([pairs.hypothesis[row], row, cell[:, 1], cell[:, 0]], axis=1), axis=0)
    votes = np.zeros((hypotheses, side, side))
    np.add.at(votes, (key[:, 0], key[:, 2], key[:, 3]), 1.0)
    padded = np.pad(votes, ((0, 0), (1, 1), (1, 1)))
    smooth = sum(padded[:, i : i + side, j : j + side] for i in range(3) for j in range(3)) + 0.5 * votes
    across = (np.arange(side) - half) * bin_px
    # Of equal votes the smaller shift is the likelier.
    smooth = smooth - 0.4 * np.hypot(across[:, None], across[None]) / max(reach, 1.0)
    shifts = np.zeros((hypotheses, modes, 2))
    counts = np.zeros((hypotheses, modes))
    for mode in range(modes):
        best = smooth.reshape(hypotheses, -1).argmax(axis=1)
        r, c = np.divmod(best, side)
        counts[:, mode] = smooth[np.arange(hypotheses), r, c]
        shifts[:, mode] = np.stack([across[c], across[r]], axis=1)
        for dr in range(-3, 4):
            for dc in range(-3, 4):
                smooth[np.arange(hypotheses), np.clip(r + dr, 0, side - 1), np.clip(c + dc, 0, side - 1)] = -1e9
    return shifts, counts
