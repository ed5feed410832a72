"""Matching of expected parts to detections under many hypotheses at once.

Shape legend: H hypotheses, n pairs (hypothesis, part), D detections, C corners, M matches kept for each hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.kernels.nearest import nearest
from recognition.kernels.voting import vote
from recognition.layout import Layout
from recognition.seen import LEAST_CLASS_PROBABILITY, Seen
from recognition.visibility import LEAST_PART_PX, Pairs, bounding_box

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


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
    detection, distance = nearest(
        pairs.hypothesis,
        pairs.corners_px,
        layout.corner_count[pairs.part],
        layout.part_class[pairs.part],
        seen.corners_px,
        compatible(layout, seen),
        seen.foremost,
        gate_px,
        foremost,
    )
    return Matching(pairs, detection, distance)


@dataclass(frozen=True, slots=True)
class Displaced:
    """Where the picture of a view lies against its prediction, as the expected parts vote; M ways, best first.

    ``shift_px`` ``(H, M, 2)``, ``scale`` ``(H, M)`` of the focal length, ``votes`` ``(H, M)``, under ``NO_VOTES`` where
    there is no further way.
    """

    shift_px: FloatArray
    scale: FloatArray
    votes: FloatArray


@dataclass(frozen=True, slots=True)
class OpenScale:
    """Focal lengths to try: factors ``(S,)``, 1 among them; whose are open ``(H,)``; principal points ``(H, 2)``."""

    factors: FloatArray
    open: npt.NDArray[np.bool_]
    centre_px: FloatArray


def vote_shift(
    pairs: Pairs, seen: Seen, hypotheses: int, reach_px: FloatArray, *, modes: int = 1, scale: OpenScale | None = None
) -> Displaced:
    """The image shifts, and scales, that bring most expected parts onto detections of about their size.

    A wrong focal length or principal point, or an uncertain place, moves all expected parts of a view alike, to first
    order; so each (part, detection) votes for the shift between them, likely parts louder.

    Args:
        pairs: expected parts, at a scale of 1; those beyond the frame too, as they may come into it.
        seen: the view.
        hypotheses: H.
        reach_px: ``(H,)`` largest shift.
        modes: how many ways to return for each hypothesis.
        scale: of whom the focal length is open; ``None``: of none.
    """
    if scale is None:
        scale = OpenScale(np.ones(1), np.zeros(hypotheses, dtype=bool), np.zeros((hypotheses, 2)))
    low, high = bounding_box(pairs.corners_px)
    width = seen.image_size[0]
    shifts, which, votes = vote(
        pairs.hypothesis,
        (low + high) / 2,
        high - low,
        scale.centre_px,
        scale.factors,
        scale.open,
        seen.centre_px,
        seen.size_px,
        _LEAST_VOTE + (1.0 - _LEAST_VOTE) * seen.likeness,
        np.asarray(reach_px, dtype=np.float64),
        np.array(seen.image_size, dtype=np.float64),
        BEYOND_PX * width / 1280.0,
        LEAST_PART_PX,
        max(_BIN_PX * width / 1280.0, _LEAST_BIN_PX),
        modes,
    )
    return Displaced(shifts, scale.factors[which], votes)


BEYOND_PX = 120.0
"""How far beyond the frame the corners of expected parts may lie when a view is searched, for 1,280 px width."""
NO_VOTES = -1e8
"""Votes that are no votes."""
_BIN_PX, _LEAST_BIN_PX = 12.0, 4.0
_LEAST_VOTE = 0.3
"""Vote of a detection that looks least like a part; 1 is that of the view's best."""
