"""Carrying hypotheses through views: start them from one view, look for them in the next, refine them over all.

A value's way: proposals -> (expected parts -> matches -> joint refinement) x 2 -> matches -> log odds of the view.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from recognition.association import BEYOND_PX, NO_VOTES, OpenScale, match, vote_shift
from recognition.geometry import rotation_y
from recognition.hypotheses import MOST_MATCHES, Hypotheses, gather, no_matches, out_of_reach, refine
from recognition.layout import Layout, compile_layout
from recognition.likelihood import part_log_odds, view_log_odds
from recognition.modelbase import ModelBase
from recognition.place_prior import PlacePrior, by_area, read_prior
from recognition.priors import Priors
from recognition.proposals import Proposals, Surroundings, focal_range, surroundings
from recognition.rates import DetectionRates
from recognition.seen import Seen
from recognition.settings import BenchBounds
from recognition.visibility import LEAST_PART_PX, Pairs, Walls, bounding_box, parts_in_view, walls_of

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_REACH_PX = (320.0, 120.0, 60.0)
"""How far a view's picture may lie from its prediction after one, two, three and more views, for 1,280 px width."""
_REACH_NEW_PX = 260.0
_PERSPECTIVE = 0.045
"""Share of the shift by a motion error that remains as perspective when the internals have taken up what they can."""
_FURTHEST_SHARE = 0.4
"""However open a place, its picture is searched for no further than this share of the width."""
_BEYOND_COST = 40.0
"""What a hypothesis pays, in -2 log, for parts outside of the bench's range of distances."""
_BORDER_PX = 12.0
"""A part that is expected so far beyond the frame may show in it, fits being what they are, for 1,280 px width."""
_VOTED_PX, _VOTED_SHARE = 18.0, 0.45
"""A vote is as coarse as its cells and as the steps of the scale: in px for 1,280 px width, whatever a part's size is,
but for this share of it, beyond which its neighbour may be meant."""
_SCALE_STEP, _SCALE_SLACK = 1.17, 1.2
"""At a zoom setting seen for the first time, focal lengths are tried in such steps, and so far beyond the range."""


_FOCAL_SD, _CENTRE_SD = 0.05, 0.03
"""How far guessed internals may be off: the focal length by ratio at the same zoom, the principal point in widths."""


@dataclass(frozen=True)
class World:
    """What stays the same during a run: model base as arrays, bounds of the bench, rates of the detector, prior."""

    layout: Layout
    around: Surroundings
    walls: Walls
    bounds: BenchBounds
    rates: DetectionRates
    places: PlacePrior

    def priors(self, image_size: tuple[int, int]) -> Priors:
        """Soft knowledge of any camera, with the lens's range from the bench."""
        size = (float(image_size[0]), float(image_size[1]))
        low, high = focal_range(self.bounds, image_size[0])
        # An error of the rig's pose looks like another principal point.
        away = np.sqrt(self.bounds.distance_min_mm * self.bounds.distance_max_mm)
        shift = np.sqrt(low * high) * np.hypot(np.radians(self.bounds.motion_sd_deg), self.bounds.motion_sd_mm / away)
        centre_sd = float(np.hypot(_CENTRE_SD, shift / image_size[0]))
        return Priors(image_size=size, focal_range_px=(low, high), principal_point_sd=centre_sd)


def make_world(base: ModelBase, bounds: BenchBounds, rates: DetectionRates, prior: Path | None = None) -> World:
    """Compile a model base for recognition; ``prior``: a file of places sampled off-line, instead of by area.

    Raises:
        InputError: the prior cannot be used for this base.
    """
    layout = compile_layout(base)
    walls = walls_of(layout)
    places = by_area(layout, walls) if prior is None else read_prior(prior, layout)
    return World(layout, surroundings(layout), walls, bounds, rates, places)


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
    return refine(world.layout, fresh, views, world.priors(views[view].image_size))


def add_view(hypotheses: Hypotheses, views: list[Seen], room: int = MOST_MATCHES) -> Hypotheses:
    """Add a view (the last of ``views``), not matched yet; new internals groups begin unknown.

    ``room``: for so many matches in it.
    """
    n = len(hypotheses)
    groups = max(v.group for v in views) + 1
    internals = np.zeros((n, groups, 4))
    internals[:, : hypotheses.internals.shape[1]] = hypotheses.internals
    return replace(
        hypotheses,
        internals=internals,
        odds=np.concatenate([hypotheses.odds, np.zeros((n, 1))], axis=1),
        matches=(*hypotheses.matches, no_matches(n, views[-1], room)),
    )


def expected_internals(world: World, hypotheses: Hypotheses, views: list[Seen], view: int) -> FloatArray:
    """``(H, 4)`` internals for a view: those of its group, or a guess from the latest view known."""
    return guess_internals(world, hypotheses, views, views[view].group, views[view].zoom)


def guess_internals(
    world: World, hypotheses: Hypotheses, views: list[Seen], group: int | None, zoom: float
) -> FloatArray:
    """``(H, 4)`` internals at a zoom setting: those of its group where known, else scaled from a view that is known.

    Nothing is known of the zoom but that 0 is widest and 1 longest, and the lens's widest possible range; so the focal
    length is guessed to run through half that range geometrically.
    """
    unset = np.zeros((len(hypotheses), 4))
    guess = hypotheses.internals[:, group].copy() if group is not None else unset
    low, high = focal_range(world.bounds, views[0].image_size[0])
    guessed = guess[:, 0] <= 0
    for other in reversed(views):
        unknown = guess[:, 0] <= 0
        if not unknown.any():
            break
        rows = hypotheses.internals[unknown, other.group].copy()
        rows[:, :2] *= (high / low) ** (0.5 * (zoom - other.zoom))
        guess[unknown] = rows
    # What views tell is not clipped: the bench's range of the lens is soft.
    guess[guessed, :2] = np.clip(guess[guessed, :2], 0.0, high)
    return guess


def expected_parts(world: World, hypotheses: Hypotheses, views: list[Seen], view: int, internals: FloatArray) -> Pairs:
    """Parts that each hypothesis expects in a view, and those that may show at its border."""
    seen = views[view]
    return parts_in_view(
        world.layout,
        world.walls,
        hypotheses.object_of,
        hypotheses.placement,
        seen.camera_row,
        internals,
        seen.image_size,
        margin_px=-_BORDER_PX * seen.image_size[0] / 1280.0,
    )


def expected_blur(
    world: World, hypotheses: Hypotheses, views: list[Seen], view: int, pairs: Pairs, sd_px: FloatArray
) -> FloatArray:
    """``(n,)`` sd, px, of where parts are expected in a view: ``sd_px`` where the view has told its internals.

    Where it has not, they are guessed, and what is expected near the frame's border may well lie beyond it.
    """
    seen = views[view]
    width, height = seen.image_size
    low, high = focal_range(world.bounds, width)
    # A guess under which nothing was matched is still a guess, and it was scaled from a view that is known.
    told = np.array([(found.part >= 0).any(axis=1) for found in hypotheses.matches])
    way = np.where(told, np.abs([[other.zoom - seen.zoom] for other in views]), 1.0).min(axis=0)
    focal_sd = np.hypot(_FOCAL_SD, 0.25 * way * np.log(high / low))[pairs.hypothesis]
    away = np.linalg.norm(pairs.corners_px.mean(axis=1) - np.array([width, height]) / 2, axis=1)
    same = np.array([other.group == seen.group for other in views])
    unknown = ~told[same].any(axis=0)[pairs.hypothesis]
    return np.where(unknown, np.hypot(_CENTRE_SD * width, focal_sd * away), sd_px)


def match_view(
    world: World,
    hypotheses: Hypotheses,
    views: list[Seen],
    view: int,
    *,
    loose: float,
    internals: FloatArray | None = None,
    foremost: bool = False,
    voted: bool = False,
) -> Hypotheses:
    """Match one view within a gate of ``loose`` times a part's size, seen through ``internals`` ``(H, 4)`` if given.

    ``foremost``: as for ``match``; ``voted``: the internals are what parts have voted for, and as coarse.
    """
    seen = views[view]
    if internals is None:
        internals = expected_internals(world, hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals)
    sd = expected_sd(world, pairs, internals)
    gate = part_gate(pairs, loose, sd)
    if voted:
        coarse = _VOTED_PX * seen.image_size[0] / 1280.0
        gate = np.maximum(gate, np.minimum(coarse, part_gate(pairs, _VOTED_SHARE, np.zeros(len(sd)))))
    matching = match(world.layout, pairs, seen, gate, foremost=foremost)
    found = gather(matching, seen, len(hypotheses), sd)
    matches = list(hypotheses.matches)
    matches[view] = found
    known = hypotheses.internals.copy()
    known[:, seen.group] = internals
    return replace(hypotheses, matches=tuple(matches), internals=known)


def expected_sd(world: World, pairs: Pairs, internals: FloatArray) -> FloatArray:
    """``(n,)`` sd, px, of a corner about its prediction once its view is matched, beside the detection's own.

    A rig that stands a little off where it reads back shifts a picture, which free internals take up but for the
    perspective of it: parts nearer to the camera, or farther to the side, are shifted by more.
    """
    sd_deg, sd_mm = world.bounds.motion_sd_deg, world.bounds.motion_sd_mm
    if not (sd_deg or sd_mm):
        return np.full(len(pairs.part), world.rates.corner_sd_px)
    low, high = bounding_box(pairs.corners_px)
    px_per_mm = (high - low)[:, 1] / world.layout.size_mm[pairs.part, 1]
    shift = np.hypot(internals[pairs.hypothesis, 0] * np.radians(sd_deg), px_per_mm * sd_mm)
    return np.asarray(np.hypot(world.rates.corner_sd_px, _PERSPECTIVE * shift))


def part_gate(pairs: Pairs, loose: float, sd_px: FloatArray) -> FloatArray:
    """``(n,)`` how far, px, a part may be found from where it is expected: ``loose`` times its size, or some sd."""
    low, high = bounding_box(pairs.corners_px)
    size = np.minimum(high[:, 0] - low[:, 0], high[:, 1] - low[:, 1])
    return np.asarray(np.maximum(loose * size, 4.0 * sd_px) + 1.0)


def score_view(world: World, hypotheses: Hypotheses, views: list[Seen], view: int) -> Hypotheses:
    """Match one view at its final gate, and note the log odds that it brings."""
    seen = views[view]
    internals = expected_internals(world, hypotheses, views, view)
    pairs = expected_parts(world, hypotheses, views, view, internals)
    sd = expected_sd(world, pairs, internals)
    matching = match(world.layout, pairs, seen, 1.0 + 6.0 * sd)
    blur = expected_blur(world, hypotheses, views, view, pairs, sd)
    odds = part_log_odds(world.layout, matching, seen, world.rates, blur, sd)
    column = view_log_odds(len(hypotheses), pairs.hypothesis, odds, matching.detection >= 0, world.rates)
    table = hypotheses.odds.copy()
    table[:, view] = column
    matches = list(hypotheses.matches)
    matches[view] = gather(matching, seen, len(hypotheses), sd)
    return replace(hypotheses, odds=table, matches=tuple(matches))


def settle(world: World, hypotheses: Hypotheses, views: list[Seen]) -> Hypotheses:
    """Match all views afresh, refine over all, then score each view."""
    for k in range(len(views)):
        lost = np.flatnonzero(hypotheses.internals[:, views[k].group, 0] <= 0)
        matched = match_view(world, hypotheses, views, k, loose=0.08)
        if lost.size and views[k].count:
            # Its zoom setting is not known to these, so the view has to be found first.
            matched = matched.put(lost, look_in(world, hypotheses.take(lost), views, k))
        hypotheses = matched
    return rescore(world, hypotheses, views, range(len(views)))


def rescore(world: World, hypotheses: Hypotheses, views: list[Seen], which: Iterable[int]) -> Hypotheses:
    """Refine over all views with the matches as they are, then score some views."""
    hypotheses = refine(world.layout, hypotheses, views, world.priors(views[0].image_size))
    near, far = world.bounds.distance_min_mm, world.bounds.distance_max_mm
    beyond = out_of_reach(world.layout, hypotheses, views, near, far)
    for k in which:
        hypotheses = score_view(world, hypotheses, views, k)
    return replace(hypotheses, prior_cost=hypotheses.prior_cost + _BEYOND_COST * beyond)


def _new_zoom_scales(world: World, views: list[Seen], view: int) -> tuple[float, ...]:
    """Factors of the guessed focal length to try: from no change to the lens's whole range."""
    low, high = focal_range(world.bounds, views[0].image_size[0])
    way = max((abs(views[view].zoom - other.zoom) for other in views), default=0.0)
    half = 0.5 * way * np.log(high / low) + np.log(_SCALE_SLACK)
    steps = int(np.ceil(half / np.log(_SCALE_STEP)))
    return tuple(float(v) for v in np.exp(np.linspace(-half, half, 2 * steps + 1)))


def doubt_px(layout: Layout, hypotheses: Hypotheses, seen: Seen, pairs: Pairs, internals: FloatArray) -> FloatArray:
    """``(H,)`` sd, px, of where a view shows the parts that each hypothesis expects, by its placement's covariance."""
    n = len(hypotheses)
    count = np.bincount(pairs.hypothesis, minlength=n)
    middle = np.zeros((n, 3))
    np.add.at(middle, pairs.hypothesis, layout.centre_mm[pairs.part])
    middle /= np.maximum(count, 1)[:, None]
    phi = hypotheses.placement[:, 0]
    c, s = np.cos(phi), np.sin(phi)
    x, y, z = np.moveaxis(middle, -1, 0)
    in_rig = np.stack([c * x + s * z, y, c * z - s * x], axis=1) + hypotheses.placement[:, 1:]
    slope = np.zeros((n, 3, 4))
    slope[:, 0, 0], slope[:, 2, 0] = c * z - s * x, -(c * x + s * z)
    slope[:, :, 1:] = np.eye(3)
    turn = rotation_y(np.array([seen.camera_row[0]]))[0]
    at, slope = (in_rig - seen.camera.centre_mm) @ turn.T, turn @ slope
    depth = np.maximum(at[:, 2], 1.0)[:, None]
    across = (slope[:, 0] - at[:, :1] / depth * slope[:, 2]) / depth * internals[:, :1]
    down = (slope[:, 1] - at[:, 1:2] / depth * slope[:, 2]) / depth * internals[:, 1:2]
    variance = [np.einsum("hi,hij,hj->h", j, hypotheses.covariance, j) for j in (across, down)]
    return np.where(count > 0, np.sqrt(np.maximum(np.max(variance, axis=0), 0.0)), 0.0)


def look_in(world: World, hypotheses: Hypotheses, views: list[Seen], view: int, *, modes: int = 1) -> Hypotheses:
    """Find each hypothesis in a view where it may be displaced: the best image shifts, one child hypothesis for each.

    Needed for a new view, whose prediction is uncertain, and for an old view of a place that a new view suggests. At a
    zoom setting that a hypothesis has not seen, the focal length is searched too.
    """
    seen = views[view]
    n = len(hypotheses)
    if n == 0 or seen.count == 0:
        return hypotheses
    guess = expected_internals(world, hypotheses, views, view)
    new = hypotheses.internals[:, seen.group, 0] <= 0
    scales = _new_zoom_scales(world, views, view) if new.any() else (1.0,)
    matched = sum(((m.part >= 0).any(axis=1)).astype(int) for k, m in enumerate(hypotheses.matches) if k != view)
    reach = np.array(_REACH_PX)[np.clip(matched - 1, 0, len(_REACH_PX) - 1)]
    reach = np.where(new, np.maximum(reach, _REACH_NEW_PX), reach) * seen.image_size[0] / 1280.0
    # Which parts face the camera and are not hidden does not depend on the focal length, so the widest tells for all.
    widest = np.where(new, scales[0], 1.0)
    pairs = parts_in_view(
        world.layout,
        world.walls,
        hypotheses.object_of,
        hypotheses.placement,
        seen.camera_row,
        guess * np.stack([widest, widest, np.ones(n), np.ones(n)], axis=1),
        seen.image_size,
        margin_px=-BEYOND_PX * seen.image_size[0] / 1280.0,
        least_px=LEAST_PART_PX * scales[0] / scales[-1],
    )
    doubt = 3.0 * doubt_px(world.layout, hypotheses, seen, pairs, guess)
    reach = np.maximum(reach, np.minimum(doubt, _FURTHEST_SHARE * seen.image_size[0]))
    centre = guess[:, 2:].copy()
    about = centre[pairs.hypothesis][:, None]
    as_guessed = about + (pairs.corners_px - about) / widest[pairs.hypothesis][:, None, None]
    open_scale = OpenScale(np.array(scales), new, centre)
    found = vote_shift(replace(pairs, corners_px=as_guessed), seen, n, reach, modes=modes, scale=open_scale)
    # Where there are fewer ways than asked for, the best stands for the others.
    which = np.where(found.votes > NO_VOTES, np.arange(modes), 0).ravel()
    rows = np.repeat(np.arange(n), modes)
    internals = guess[rows]
    internals[:, :2] *= found.scale[rows, which, None]
    internals[:, 2:] += found.shift_px[rows, which]
    return match_view(
        world, hypotheses.take(rows), views, view, loose=0.25, internals=internals, foremost=True, voted=True
    )
