"""Second chances for hypotheses that explain a view worse than they could: the view found anew, or what it lacks.

A view may have been matched when the fit was still poor, or its zoom setting told from a single part: then the panes of
a window may stand for its outline, or the near wall alone be matched and the far wing missed. Matching to the nearest
again does not leave such a minimum.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from recognition.association import match, vote_shift
from recognition.hypotheses import Hypotheses, best, forget, gather, join, refine
from recognition.likelihood import most_log_odds
from recognition.seen import Seen
from recognition.tracking import (
    World,
    expected_blur,
    expected_internals,
    expected_parts,
    expected_sd,
    look_in,
    part_gate,
    rescore,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_SHORT = 2.5
"""A view is worth mending if so many nats are wanting to what it could bring."""
_HOPELESS = 5.0
"""One that would stay so many nats behind the best even if nothing were wanting is not worth its time."""
_MODES = 4
"""In how many ways, at most, a view is found anew: the one with most votes is not always right."""
_CHILDREN = 80
"""About so many are tried."""
_REACH_PX = 60.0
"""How far parts may be displaced against those matched in the same view, for 1,280 px width."""


def mended(world: World, hypotheses: Hypotheses, views: list[Seen]) -> Hypotheses:
    """Children of those hypotheses that fall short in some view, scored; none of a hypothesis that explains all."""
    if len(hypotheses) == 0 or len(views) < 2:
        return hypotheses.take(np.empty(0, dtype=np.int64))
    # Nothing can be mended where nothing was detected.
    found = np.array([view.count > 0 for view in views])
    short = np.where(found, shortfall(world, hypotheses, views), 0.0)
    hopeful = hypotheses.log_weight + np.maximum(short, 0.0).sum(axis=1) > hypotheses.log_weight.max() - _HOPELESS
    hypotheses, short = hypotheses.take(np.flatnonzero(hopeful)), short[hopeful]
    worst = (short == short.max(axis=1, keepdims=True)) & (short > _SHORT)
    anew = (worst | (hypotheses.odds < 0)) & found
    # What is left must still tell where the object is.
    matched = np.stack([(m.part >= 0).any(axis=1) for m in hypotheses.matches], axis=1)
    anew &= (matched & ~anew).any(axis=1)[:, None]
    more = short > _SHORT
    children = join(_found_anew(world, hypotheses, views, anew), _completed(world, hypotheses, views, more))
    if len(children) == 0:
        return children
    every = range(len(views))
    ahead = best(rescore(world, children, views, every), _CHILDREN // 2)
    return rescore(world, ahead, views, every)


def shortfall(world: World, hypotheses: Hypotheses, views: list[Seen]) -> FloatArray:
    """``(H, V)`` log odds wanting in each view to those if all parts that it expects whole were found."""
    short = np.zeros((len(hypotheses), len(views)))
    for k, seen in enumerate(views):
        internals = expected_internals(world, hypotheses, views, k)
        pairs = expected_parts(world, hypotheses, views, k, internals)
        blur = expected_blur(world, hypotheses, views, k, pairs, expected_sd(world, pairs, internals))
        short[:, k] = most_log_odds(len(hypotheses), pairs, seen, world.rates, blur) - hypotheses.odds[:, k]
    return short


def _found_anew(world: World, hypotheses: Hypotheses, views: list[Seen], which: npt.NDArray[np.bool_]) -> Hypotheses:
    """Some views ``(H, V)`` forgotten, the others fitted, and those views searched as if they were new."""
    rows = np.flatnonzero(which.any(axis=1))
    which = which[rows]
    priors = world.priors(views[0].image_size)
    children = refine(world.layout, forget(hypotheses.take(rows), which), views, priors)
    for k in range(len(views)):
        lacking, rest = np.flatnonzero(which[:, k]), np.flatnonzero(~which[:, k])
        if lacking.size:
            modes = max(1, _CHILDREN // (2 * lacking.size))
            again = look_in(world, children.take(lacking), views, k, modes=min(modes, _MODES))
            children = join(children.take(rest), again)
            which = np.concatenate([which[rest], np.repeat(which[lacking], len(again) // lacking.size, axis=0)])
    return children


def _completed(world: World, hypotheses: Hypotheses, views: list[Seen], which: npt.NDArray[np.bool_]) -> Hypotheses:
    """Parts that some views ``(H, V)`` lack looked for together, displaced against those that are matched there."""
    rows = np.flatnonzero(which.any(axis=1))
    children, which = hypotheses.take(rows), which[rows]
    for k in range(len(views)):
        lacking = np.flatnonzero(which[:, k])
        if lacking.size:
            children = children.put(lacking, complete(world, children.take(lacking), views, k))
    return children


def complete(world: World, hypotheses: Hypotheses, views: list[Seen], view: int) -> Hypotheses:
    """Match a view with the parts that it lacks shifted together, by the shift that finds most of them."""
    seen = views[view]
    n = len(hypotheses)
    internals = expected_internals(world, hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals)
    sd = expected_sd(world, pairs, internals)
    matching = match(world.layout, pairs, seen, part_gate(pairs, 0.08, sd))
    lost = np.flatnonzero(matching.detection < 0)
    reach = np.full(n, _REACH_PX * seen.image_size[0] / 1280.0)
    shifts = vote_shift(pairs.take(lost), seen, n, reach).shift_px
    corners = pairs.corners_px.copy()
    corners[lost] += shifts[pairs.hypothesis[lost], 0][:, None]
    moved = replace(pairs, corners_px=corners)
    matches = list(hypotheses.matches)
    again = match(world.layout, moved, seen, part_gate(moved, 0.25, sd), foremost=True)
    matches[view] = gather(again, seen, n, sd)
    return replace(hypotheses, matches=tuple(matches))
