"""The graded likelihood of one view under a hypothesis, as log odds against "all of this is clutter" (design §4).

Each expected part is either found, with corner residuals, or missed; detections that no part explains are clutter under
every hypothesis and drop out of the odds. What detectors do wrong is not independent from part to part - the panes of a
window look like the windows of a farther wall, a row of windows fits one bay further on - so no part and no view counts
for more than a cap: a rival that explains one view brilliantly can still be overruled by the next.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from recognition.association import Matching
from recognition.layout import Layout
from recognition.rates import DetectionRates
from recognition.seen import Seen
from recognition.visibility import Pairs, bounding_box

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def part_log_odds(
    layout: Layout, matching: Matching, seen: Seen, rates: DetectionRates, blur_px: FloatArray, sd_px: FloatArray
) -> FloatArray:
    """Log odds ``(n,)`` that each expected part brings: found against clutter, or missed.

    Args:
        layout: the model base.
        matching: expected parts with the detections taken for them.
        seen: the view.
        rates: how the detector behaves.
        blur_px: ``(n,)`` sd of where the part is expected, before anything of the view was matched.
        sd_px: ``(n,)`` sd of a corner about its prediction once it is matched, beside the detection's own.
    """
    pairs = matching.pairs
    rate = detection_rate(pairs, seen, rates, blur_px)
    odds = np.log1p(-rate)
    hit = np.flatnonzero(matching.detection >= 0)
    if hit.size == 0:
        return odds
    det = matching.detection[hit]
    low, high = bounding_box(pairs.corners_px[hit])
    size = np.maximum(high - low, 4.0)
    sd = np.hypot(seen.sigma_px[det], sd_px[hit])
    count = layout.corner_count[pairs.part[hit]]
    # Clutter: anywhere in the frame, any size within e^3, corners off a window's shape by a tenth of its size.
    loose = 0.1 * np.sqrt(size.prod(axis=1))
    log_clutter = (
        np.log(rates.clutter)
        - np.log(seen.image_size[0] * seen.image_size[1])
        - np.log(3.0 * size).sum(axis=1)
        - (2 * count - 4) * np.log(np.sqrt(2 * np.pi) * loose)
    )
    # Cauchy-like tails: a corner taken at the wrong edge of a frame does not veto the part.
    square = count * (matching.distance_px[hit] / sd) ** 2
    tail = count * np.log1p(square / count)
    log_peak = np.log(rate[hit]) - 2 * count * np.log(np.sqrt(2 * np.pi) * sd) - log_clutter
    scores = np.maximum(seen.class_score[det], 1e-3)
    log_class = np.log(scores[np.arange(len(det)), layout.part_class[pairs.part[hit]]] / scores.max(axis=1))
    # The cap is on what a perfect fit would bring, so that a worse fit still counts less; one sd is no worse.
    gain = np.minimum(log_peak, rates.part_cap) + log_class - np.maximum(tail - count * _ONE_SD_TAIL, 0.0)
    # However bad the fit, the part may have been missed and something else stand there.
    odds[hit] = np.maximum(gain, odds[hit])
    return odds


def detection_rate(pairs: Pairs, seen: Seen, rates: DetectionRates, blur_px: FloatArray) -> FloatArray:
    """Detection rate ``(n,)`` of each expected part: lower near the frame's border, seen obliquely, or small."""
    if len(pairs.part) == 0:
        return np.empty(0)
    low, high = bounding_box(pairs.corners_px)
    edge = np.minimum(low, np.array(seen.image_size) - 1 - high).min(axis=1)
    doubtful = (edge < 8.0) | (pairs.cosine < 0.35) | ((high - low).min(axis=1) < 14.0)
    inside = ndtr(edge / np.maximum(blur_px, 1e-9))
    return np.asarray(np.where(doubtful, 0.4, 1.0) * rates.found * inside)


def view_log_odds(
    hypotheses: int, hypothesis: IntArray, odds: FloatArray, found: BoolArray, rates: DetectionRates
) -> FloatArray:
    """Log odds ``(H,)`` of a view from those of its expected parts.

    What parts found bring is softly capped, for lucky lattices; what missed parts take away is capped less, since a
    hypothesis that expects what is not there has no such excuse; and each detection explained is one clutter fewer,
    which matters where clutter is rare.

    Args:
        hypotheses: H.
        hypothesis: ``(n,)`` whose part it is.
        odds: ``(n,)`` of ``part_log_odds``, or of a second look.
        found: ``(n,)`` whether a detection was taken for the part.
        rates: caps and clutter.
    """
    gain = np.bincount(hypothesis, weights=np.maximum(odds, 0.0), minlength=hypotheses)
    loss = np.bincount(hypothesis, weights=np.minimum(odds, 0.0), minlength=hypotheses)
    explained = np.bincount(hypothesis, weights=found.astype(np.float64), minlength=hypotheses)
    cap = rates.view_cap
    # A view may have been matched at the wrong place altogether: no one view speaks against more than this.
    return np.asarray(
        cap * np.tanh(gain / cap) + np.maximum(loss, -_FLOOR_SHARE * cap) + explained * np.log1p(1.0 / rates.clutter)
    )


def most_log_odds(hypotheses: int, pairs: Pairs, seen: Seen, rates: DetectionRates, blur_px: FloatArray) -> FloatArray:
    """Log odds ``(H,)`` that a view would bring if all parts that are expected whole and clear were found perfectly."""
    clear = detection_rate(pairs, seen, rates, blur_px) > 0.9 * rates.found
    return view_log_odds(hypotheses, pairs.hypothesis, np.where(clear, rates.part_cap, 0.0), clear, rates)


def edge_log_odds(score: FloatArray) -> FloatArray:
    """Log odds of a part being there from its outline's edge score (``detectors.edges``), hidden parts allowed for.

    The table is log of the share of true outlines over that of wrong ones (anywhere, or a third of a window aside) per
    bin of the score; it was read off photographs, see docs/results.md.
    """
    there = np.exp(np.interp(score, _EDGE_SCORE, _EDGE_ODDS))
    return np.asarray(np.log((1.0 - _HIDDEN) * there + _HIDDEN))


_EDGE_SCORE = (0.2, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)
_EDGE_ODDS = (-3.5, -3.0, -1.3, -0.1, 0.5, 2.8, 3.6)
_HIDDEN = 0.15
_ONE_SD_TAIL = float(np.log(2.0))
_FLOOR_SHARE = 0.4
