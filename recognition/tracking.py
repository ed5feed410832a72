"""Carrying hypotheses through views: start them from one view, look for them in the next, refine them over all.

A value's way: proposals -> (expected parts -> matches -> joint refinement) x 2 -> matches -> log odds of the view.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from recognition.association import match, vote_shift
from recognition.hypotheses import Hypotheses, gather, no_matches, refine
from recognition.layout import Layout, compile_layout
from recognition.likelihood import part_log_odds, view_log_odds
from recognition.modelbase import ModelBase
from recognition.priors import Priors
from recognition.proposals import Proposals, Surroundings, focal_range, surroundings
from recognition.rates import DetectionRates
from recognition.seen import Seen
from recognition.settings import BenchBounds
from recognition.visibility import Pairs, Walls, parts_in_view, walls_of

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_REACH_PX = (320.0, 120.0, 60.0)
"""How far a view's picture may lie from its prediction after one, two, three and more views, for 1,280 px width."""


@dataclass(frozen=True)
class World:
    """What stays the same during a run: the model base as arrays, the bench's bounds, and the detector's rates."""

    layout: Layout
    around: Surroundings
    walls: list[Walls]
    bounds: BenchBounds
    rates: DetectionRates

    def priors(self, image_size: tuple[int, int]) -> Priors:
        """Soft knowledge of any camera, with the lens's range from the bench."""
        size = (float(image_size[0]), float(image_size[1]))
        return Priors(image_size=size, focal_range_px=focal_range(self.bounds, image_size[0]))


def make_world(base: ModelBase, bounds: BenchBounds, rates: DetectionRates) -> World:
    """Compile a model base for recognition."""
    layout = compile_layout(base)
    return World(layout, surroundings(layout), walls_of(layout), bounds, rates)


def start(world: World, proposals: Proposals, views: list[Seen], view: int) -> Hypotheses:
    """Hypotheses from what view number ``view`` suggests, evaluated on that view alone; other views are unmatched."""
    n = len(proposals.part)
    groups = max(v.group for v in views) + 1
    internals = np.zeros((n, groups, 4))
    internals[:, views[view].group] = proposals.internals
    empty = [no_matches(n, v) for v in views]
    fresh = Hypotheses(
        world.layout.object_of[proposals.part],
        proposals.placement,
        np.zeros((n, 4, 4)),
        internals,
        np.zeros(n),
        np.zeros((n, len(views))),
        tuple(empty),
    )
    fresh = match_view(world, fresh, views, view, loose=0.2)
    fresh = refine(world.layout, fresh, views, world.priors(views[view].image_size))
    return fresh


def add_view(hypotheses: Hypotheses, views: list[Seen]) -> Hypotheses:
    """Room for one more view (the last of ``views``), not matched yet; new internals groups begin unknown."""
    n = len(hypotheses)
    groups = max(v.group for v in views) + 1
    internals = np.zeros((n, groups, 4))
    internals[:, : hypotheses.internals.shape[1]] = hypotheses.internals
    return replace(
        hypotheses,
        internals=internals,
        odds=np.concatenate([hypotheses.odds, np.zeros((n, 1))], axis=1),
        matches=(*hypotheses.matches, no_matches(n, views[-1])),
    )


def expected_internals(hypotheses: Hypotheses, views: list[Seen], view: int) -> FloatArray:
    """``(H, 4)`` internals for a view: those of its group, or of the latest view known, as a first guess."""
    guess = hypotheses.internals[:, views[view].group].copy()
    for other in reversed(views):
        unknown = guess[:, 0] <= 0
        if not unknown.any():
            break
        guess[unknown] = hypotheses.internals[unknown, other.group]
    return guess


def expected_parts(
    world: World, hypotheses: Hypotheses, views: list[Seen], view: int, internals: FloatArray, margin_px: float = 2.0
) -> Pairs:
    """Parts that each hypothesis expects in a view."""
    seen = views[view]
    return parts_in_view(
        world.layout,
        world.walls,
        hypotheses.object_of,
        hypotheses.placement,
        seen.camera_row,
        internals,
        seen.image_size,
        margin_px=margin_px,
    )


def match_view(
    world: World, hypotheses: Hypotheses, views: list[Seen], view: int, *, loose: float, shift: FloatArray | None = None
) -> Hypotheses:
    """Match one view within a gate of ``loose`` times a part's size, moved by ``shift`` ``(H, 2)`` px if given."""
    seen = views[view]
    internals = expected_internals(hypotheses, views, view)
    if shift is not None:
        internals[:, 2:] += shift
    pairs = expected_parts(world, hypotheses, views, view, internals)
    size = np.ptp(pairs.corners_px, axis=1).min(axis=1) if len(pairs.part) else np.empty(0)
    floor = 4.0 * world.rates.corner_sd_px
    gate = np.maximum(loose * size, floor) + 1.0
    found = gather(match(world.layout, pairs, seen, gate), seen, len(hypotheses), world.rates.corner_sd_px)
    matches = list(hypotheses.matches)
    matches[view] = found
    known = hypotheses.internals.copy()
    known[:, seen.group] = internals
    return replace(hypotheses, matches=tuple(matches), internals=known)


def score_view(world: World, hypotheses: Hypotheses, views: list[Seen], view: int) -> Hypotheses:
    """Match one view at its final gate, and note the log odds that it brings."""
    seen = views[view]
    internals = expected_internals(hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals)
    gate = np.full(len(pairs.part), 1.0 + 6.0 * world.rates.corner_sd_px)
    matching = match(world.layout, pairs, seen, gate)
    odds = part_log_odds(world.layout, matching, seen, world.rates)
    column = view_log_odds(len(hypotheses), pairs.hypothesis, odds, matching.detection >= 0, world.rates)
    table = hypotheses.odds.copy()
    table[:, view] = column
    matches = list(hypotheses.matches)
    matches[view] = gather(matching, seen, len(hypotheses), world.rates.corner_sd_px)
    return replace(hypotheses, odds=table, matches=tuple(matches))


def settle(world: World, hypotheses: Hypotheses, views: list[Seen], rounds: tuple[float, ...] = (0.08,)) -> Hypotheses:
    """Alternate matching and refinement over all views, then score each view."""
    priors = world.priors(views[0].image_size)
    for loose in rounds:
        for k in range(len(views)):
            hypotheses = match_view(world, hypotheses, views, k, loose=loose)
        hypotheses = refine(world.layout, hypotheses, views, priors)
    for k in range(len(views)):
        hypotheses = score_view(world, hypotheses, views, k)
    return hypotheses


def look_in(world: World, hypotheses: Hypotheses, views: list[Seen], view: int, *, modes: int = 1) -> Hypotheses:
    """Find each hypothesis in a view where it may be displaced: the best image shifts, one child hypothesis for each.

    Needed for a new view, whose prediction is uncertain, and for an old view of a place that a new view suggests.
    """
    seen = views[view]
    n = len(hypotheses)
    if n == 0 or seen.count == 0:
        return hypotheses
    internals = expected_internals(hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals, margin_px=-120.0)
    matched = sum(((m.part >= 0).any(axis=1)).astype(int) for k, m in enumerate(hypotheses.matches) if k != view)
    reach = np.array(_REACH_PX)[np.clip(matched - 1, 0, len(_REACH_PX) - 1)] * seen.image_size[0] / 1280.0
    shifts, _ = vote_shift(pairs, seen, n, reach, modes=modes)
    rows = np.repeat(np.arange(n), modes)
    children = hypotheses.take(rows)
    return match_view(world, children, views, view, loose=0.25, shift=shifts.reshape(-1, 2))
