"""Looking again where a hypothesis says: edges along the outlines of expected parts that the detector did not find.

A missed detection is weak evidence; an outline without edges is strong evidence against, and one with edges on all
sides gives corners that sharpen the pose. Only hypotheses that predict to a few pixels can be looked up so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from recognition.association import match
from recognition.hypotheses import MOST_MATCHES, Hypotheses, ViewMatches, gather, refine
from recognition.likelihood import edge_log_odds, part_log_odds, view_log_odds
from recognition.seen import Seen
from recognition.tracking import World, expected_blur, expected_internals, expected_parts, expected_sd
from recognition.visibility import Pairs, bounding_box

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

RADIUS_PX = 6.0
GOOD_SCORE = 0.6
CORNER_SD_PX = 1.2


def look_again(world: World, hypotheses: Hypotheses, views: list[Seen]) -> Hypotheses:
    """Second look at all views: refine with the corners it finds, then score the views with what it saw."""
    if len(hypotheses) == 0 or all(v.edges is None for v in views):
        return hypotheses
    for k in range(len(views)):
        hypotheses = _look(world, hypotheses, views, k)
    hypotheses = refine(world.layout, hypotheses, views, world.priors(views[0].image_size), iterations=4)
    for k in range(len(views)):
        hypotheses = _look(world, hypotheses, views, k)
    return hypotheses


def _look(world: World, hypotheses: Hypotheses, views: list[Seen], view: int) -> Hypotheses:
    seen = views[view]
    internals = expected_internals(world, hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals)
    sd = expected_sd(world, pairs, internals)
    matching = match(world.layout, pairs, seen, 1.0 + 6.0 * sd)
    blur = expected_blur(world, hypotheses, views, view, pairs, sd)
    odds = part_log_odds(world.layout, matching, seen, world.rates, blur, sd)
    found = gather(matching, seen, len(hypotheses), sd)
    low, high = bounding_box(pairs.corners_px)
    inside = (low >= 2.0).all(axis=1) & (high <= np.array(seen.image_size) - 3.0).all(axis=1)
    unseen = np.flatnonzero((matching.detection < 0) & (blur < RADIUS_PX) & inside)
    if seen.edges is not None and unseen.size:
        score, corners = _measure(world, seen, pairs.take(unseen))
        odds[unseen] = np.maximum(edge_log_odds(score), -4.0)
        good = score >= GOOD_SCORE
        better = unseen[good]
        found = _append(found, pairs.take(better), corners[good], 1.0 / np.hypot(CORNER_SD_PX, sd[better]))
    table = hypotheses.odds.copy()
    table[:, view] = view_log_odds(len(hypotheses), pairs.hypothesis, odds, matching.detection >= 0, world.rates)
    matches = list(hypotheses.matches)
    matches[view] = found
    return replace(hypotheses, odds=table, matches=tuple(matches))


def _measure(world: World, seen: Seen, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Edge score ``(n,)`` and measured corners ``(n, C, 2)``; outlines that agree to a pixel are measured once."""
    from recognition.detectors.edges import measure_outlines

    assert seen.edges is not None
    score = np.zeros(len(pairs.part))
    corners = pairs.corners_px.copy()
    count = world.layout.corner_count[pairs.part]
    for n in np.unique(count):
        rows = np.flatnonzero(count == n)
        outlines = pairs.corners_px[rows, :n]
        _, first, back = np.unique(
            np.rint(outlines / 1.5).reshape(len(rows), -1), axis=0, return_index=True, return_inverse=True
        )
        evidence = measure_outlines(seen.edges, outlines[first], radius_px=RADIUS_PX)
        score[rows] = evidence.score[back.ravel()]
        corners[rows, :n] = evidence.corners_px[back.ravel()]
        corners[rows, n:] = corners[rows, n - 1 : n]
    return score, corners


def _append(found: ViewMatches, pairs: Pairs, corners: FloatArray, weight: FloatArray) -> ViewMatches:
    """More matches, as far as there is room."""
    part, px, weights = found.part.copy(), found.corners_px.copy(), found.weight.copy()
    used = (part >= 0).sum(axis=1)
    first = np.searchsorted(pairs.hypothesis, pairs.hypothesis)
    column = used[pairs.hypothesis] + np.arange(len(first)) - first
    ok = column < MOST_MATCHES
    row, column = pairs.hypothesis[ok], column[ok]
    part[row, column] = pairs.part[ok]
    px[row, column] = corners[ok]
    weights[row, column] = weight[ok]
    return ViewMatches(part, px, weights)
