"""Objects that are not in the model base but look much like one that is: what they would explain better than it does.

"None of these" competes from the first view. An object all unlike those of the base is told by views that no place
explains. One that shares most of its layout with a known one - the next house of the row, the model as rebuilt - is
told only by what is missing where the known one has parts, and by what stands where it has none, more often than the
detector misses and errs. So they compete only where it was measured how often it does.

Shape legend: H hypotheses, n expected parts, Q shares.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.association import match
from recognition.hypotheses import Hypotheses
from recognition.likelihood import detection_rate
from recognition.seen import Seen
from recognition.tracking import World, expected_blur, expected_internals, expected_parts, expected_sd

FloatArray = npt.NDArray[np.float64]

SHARES = (0.1, 0.2, 0.4)
"""Shares of a known object's parts that its relatives have elsewhere; each is as likely."""
MOST_NATS = 4.0
"""One view says no more for a relative than this: it may have been matched at the wrong place."""


def log_odds_of_relatives(world: World, hypotheses: Hypotheses, views: list[Seen]) -> FloatArray:
    """``(H,)`` log odds of a relative of each hypothesis's object, at the same place, against the object itself."""
    total = np.zeros((len(hypotheses), len(SHARES)))
    for k in range(len(views)):
        total += np.clip(_of_view(world, hypotheses, views, k), -MOST_NATS, MOST_NATS)
    return np.asarray(np.logaddexp.reduce(total, axis=1) - np.log(len(SHARES)))


def _of_view(world: World, hypotheses: Hypotheses, views: list[Seen], view: int) -> FloatArray:
    """``(H, Q)`` of one view: each expected part found or missed, and detections that it does not explain."""
    seen, n = views[view], len(hypotheses)
    internals = expected_internals(world, hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals)
    sd = expected_sd(world, pairs, internals)
    matching = match(world.layout, pairs, seen, 1.0 + 6.0 * sd)
    rate = detection_rate(pairs, seen, world.rates, expected_blur(world, hypotheses, views, view, pairs, sd))
    found = matching.detection >= 0
    odds = np.zeros((n, len(SHARES)))
    explained = np.bincount(pairs.hypothesis[found], minlength=n)
    expected = np.bincount(pairs.hypothesis, weights=rate, minlength=n)
    for q, share in enumerate(SHARES):
        each = np.where(found, np.log1p(-share), np.log1p(-rate * (1.0 - share)) - np.log1p(-rate))
        odds[:, q] = np.bincount(pairs.hypothesis, weights=each, minlength=n)
        elsewhere = share * expected
        strange = np.maximum(len(np.unique(seen.foremost)) - explained, 0)
        odds[:, q] += strange * np.log1p(elsewhere / world.rates.clutter) - elsewhere
    return odds
