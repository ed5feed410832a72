"""The belief over configurations: hypotheses weighed by all views, "none of these" beside them; nothing is killed.

Hypotheses that fall behind are forgotten only as particles: each new view proposes places afresh and tries them on all
earlier views, so a place that was missed or dropped comes back when it explains what is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from recognition.geometry import rotation_y
from recognition.hypotheses import Hypotheses, best, join, no_matches, refine
from recognition.mending import mended
from recognition.proposals import propose
from recognition.relatives import log_odds_of_relatives
from recognition.seen import Seen
from recognition.settings import Effort
from recognition.tracking import World, add_view, look_in, match_view, rescore, score_view, settle, start
from recognition.visibility import camera_in_objects

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

NONE_PRIOR = 0.05
"""Prior probability that the object is not in the model base."""
_FAR_BEHIND, _ALWAYS_KEPT = 30.0, 60
_RIVALS, _REPAIRED = 120, 40
_PER_MATCH = 3.0
_LEADS = 1e-3
_LEADERS, _AS_GOOD = 12, 3.0
_RICHEST = 2
_MOST_MODES = 4
_TELLS = 3
"""A second view leaves one in so many of the places that a first one suggests."""


@dataclass(frozen=True, slots=True)
class Belief:
    """Weighed configurations, best first.

    ``probability`` ``(H,)`` sums with ``none`` to 1.
    """

    hypotheses: Hypotheses
    probability: FloatArray
    none: float

    @staticmethod
    def empty() -> Belief:
        """Before the first view."""
        return Belief(Hypotheses.empty(), np.empty(0), 1.0)

    @property
    def entropy_bits(self) -> float:
        """Entropy over configurations and "none"."""
        p = np.append(self.probability, self.none)
        p = p[p > 0]
        return float(-(p * np.log2(p)).sum())

    @property
    def left(self) -> int:
        """Configurations that together hold 99.9 % of what is not "none"."""
        total = self.probability.sum()
        if total <= 0:
            return 0
        return int(np.searchsorted(np.cumsum(self.probability) / total, 0.999) + 1)

    def by_object(self, objects: int) -> FloatArray:
        """``(O,)`` probability of each object (eq. 7 of the paper: the sum over its configurations)."""
        total = np.bincount(self.hypotheses.object_of, weights=self.probability, minlength=objects)
        return np.asarray(total, dtype=np.float64)


def update(world: World, before: Hypotheses | None, views: list[Seen], effort: Effort) -> Hypotheses:
    """Hypotheses after the last of ``views``: those carried on, and those that the new view suggests.

    Args:
        world: what stays the same.
        before: hypotheses after the views before; ``None`` at the first view.
        views: all views, the new one last.
        effort: limits of the work.
    """
    last = len(views) - 1
    carried = None
    if before is not None and len(before):
        carried = add_view(before, views)
        if views[last].count:
            # The fewer are left, the more ways of each can be tried.
            modes = max(effort.modes, min(_MOST_MODES, effort.refined // len(carried)))
            carried = look_in(world, carried, views, last, modes=modes)
        carried = _refine_ahead(world, carried, views, effort.refined)
        carried = thin(carried, views[last], effort.tracked)
        # Settled, a view that one did not know may be found at the wrong place; so each also stays as it was.
        ahead = np.arange(min(effort.fresh // 2, len(carried)))
        carried = join(settle(world, carried.take(ahead), views), carried)
    if views[last].count == 0:
        return _repair(world, carried, views) if carried is not None else Hypotheses.empty(views)
    fresh = _fresh(world, views, effort, effort.proposals if carried is None else effort.fresh, last)
    everything = fresh if carried is None else join(carried, fresh)
    return _repair(world, thin(everything, views[last], effort.tracked), views)


def _repair(world: World, hypotheses: Hypotheses, views: list[Seen]) -> Hypotheses:
    """Let the leading hypotheses compete with themselves mended."""
    children = mended(world, best(hypotheses, _REPAIRED), views)
    return thin(join(hypotheses, children), views[-1], len(hypotheses)) if len(children) else hypotheses


def _refine_ahead(world: World, hypotheses: Hypotheses, views: list[Seen], most: int) -> Hypotheses:
    """Refine and score those that match most of the new view; each also stays as it was, without the new matches.

    A wrong match can bend a fit until it expects nothing anywhere; so all views are scored again, and the unbent fit
    competes.
    """
    last = len(views) - 1
    matched = (hypotheses.matches[last].part >= 0).sum(axis=1)
    order = np.argsort(-(hypotheses.log_weight + _PER_MATCH * matched), kind="stable")
    ahead = rescore(world, hypotheses.take(order[:most]), views, range(len(views)))
    return join(ahead, score_view(world, hypotheses, views, last))


def fit_leaders(world: World, hypotheses: Hypotheses, views: list[Seen]) -> Hypotheses:
    """The set with its leading hypotheses fitted to all that they match: what is told of them is their fit's.

    Of a hypothesis with and without a new view's matches in its fit the latter pays less for internals, and may lead.
    """
    lead = np.argsort(-hypotheses.log_weight, kind="stable")[:_LEADERS]
    again = rescore(world, hypotheses.take(lead), views, range(len(views)))
    good = again.log_weight > hypotheses.log_weight[lead] - _AS_GOOD
    return hypotheses.put(lead[good], again.take(np.flatnonzero(good)))


def _fresh(world: World, views: list[Seen], effort: Effort, most: int, source: int) -> Hypotheses:
    """Places that one view suggests, tried on all views so far."""
    proposals = propose(
        world.layout,
        world.around,
        views[source],
        world.bounds,
        anchors=effort.anchors,
        most=most,
        per_part=effort.per_part,
        focals=effort.focals,
    )
    if len(proposals.part) == 0:
        return Hypotheses.empty(views)
    fresh = thin(start(world, proposals, views, source), views[source], most)
    # One view of regular rows suggests more places than can be tried on all views; another with much in it tells most.
    others = sorted((k for k in range(len(views)) if k != source and views[k].count), key=lambda k: -views[k].count)
    for k in others:
        fresh = look_in(world, fresh, views, k)
        if k == others[0] and len(others) > 1:
            fresh = thin(rescore(world, fresh, views, (k, source)), views[-1], max(1, most // _TELLS))
    # Found by votes, views are matched coarsely; settling would lose what a fit has not brought into its gates.
    return settle(world, refine(world.layout, fresh, views, world.priors(views[source].image_size)), views)


def challengers(world: World, views: list[Seen], effort: Effort) -> Hypotheses:
    """All places that the views with most in them suggest, as if nothing had been believed before.

    What is believed has come through the eye of a needle: at each view only the places that were ahead went on. A place
    of which the first views missed much may have been dropped, though all views together speak for it.
    """
    richest = sorted((k for k in range(len(views)) if views[k].count), key=lambda k: -views[k].count)[:_RICHEST]
    found = Hypotheses.empty(views)
    for k in richest:
        found = join(found, _fresh(world, views, effort, 2 * effort.fresh, k))
    return found


def rivals(world: World, hypotheses: Hypotheses, views: list[Seen], row: int) -> Hypotheses:
    """Every other place that shows the part in the middle of a hypothesis's matches, tried on all views.

    Views taken to follow one hypothesis may never propose its rival: a mirror image, a repeated wing. Before a run
    ends, the leading hypothesis is therefore moved to every part of the same shape, and each such place may explain
    all views better.
    """
    anchor = _central_part(world, hypotheses, views, row)
    if anchor is None:
        return hypotheses.take(np.empty(0, dtype=np.int64))
    layout = world.layout
    size = layout.size_mm
    alike = (layout.part_class == layout.part_class[anchor]) & (np.abs(size / size[anchor] - 1.0).max(axis=1) < 0.06)
    alike[anchor] = False
    part = np.flatnonzero(alike)
    phi, shift = hypotheses.placement[row, 0], hypotheses.placement[row, 1:]
    at = rotation_y(phi) @ layout.centre_mm[anchor] + shift
    angle = np.arctan2(layout.along[:, 2], layout.along[:, 0])
    turned = phi + angle[part] - angle[anchor]
    placement = np.concatenate(
        [turned[:, None], at - np.einsum("hij,hj->hi", rotation_y(turned), layout.centre_mm[part])], axis=1
    )
    moved = hypotheses.take(np.full(len(part), row))
    moved = replace(
        moved,
        object_of=layout.object_of[part],
        placement=placement,
        matches=tuple(no_matches(len(part), view) for view in views),
    )
    # The leader's fit is good, so its rivals' parts must stand nearly where it puts them.
    for k in range(len(views)):
        moved = match_view(world, moved, views, k, loose=0.15)
    found = sum((m.part >= 0).sum(axis=1) for m in moved.matches)
    ahead = np.argsort(-found, kind="stable")[:_RIVALS]
    moved = rescore(world, moved.take(ahead), views, range(len(views)))
    return join(settle(world, moved, views), moved)


def _central_part(world: World, hypotheses: Hypotheses, views: list[Seen], row: int) -> int | None:
    """The part that most views match, nearest to the middle of all parts matched."""
    matched = np.concatenate([m.part[row][m.part[row] >= 0] for m in hypotheses.matches])
    if matched.size == 0:
        return None
    part, times = np.unique(matched, return_counts=True)
    middle = world.layout.centre_mm[matched].mean(axis=0)
    away = np.linalg.norm(world.layout.centre_mm[part] - middle, axis=1)
    return int(part[np.lexsort((away, -times))[0]])


def thin(hypotheses: Hypotheses, seen: Seen, most: int) -> Hypotheses:
    """Best first, one for each configuration: of two that place the camera alike, the better stays."""
    weight = hypotheses.log_weight
    order = np.argsort(-weight, kind="stable")[: 4 * most]
    # Far behind the best, a hypothesis is not worth its time; should it be right, it will be proposed again.
    order = order[(weight[order] > weight.max(initial=0.0) - _FAR_BEHIND) | (np.arange(len(order)) < _ALWAYS_KEPT)]
    hypotheses = hypotheses.take(order)
    pan, centre = camera_in_objects(hypotheses.placement, seen.camera_row)
    # A scale to compare camera positions on: the distance to the parts, through the part sizes that it shows.
    reach = _distance(hypotheses, seen)
    features = np.concatenate(
        [
            centre / (0.04 * reach[:, None]),
            np.cos(pan)[:, None] / 0.03,
            np.sin(pan)[:, None] / 0.03,
            hypotheses.object_of[:, None] * 1e6,
        ],
        axis=1,
    )
    features = np.nan_to_num(features, nan=1e12, posinf=1e12, neginf=-1e12)
    keep = np.ones(len(order), dtype=bool)
    pairs = cKDTree(features).query_pairs(1.0, output_type="ndarray")
    # Sorted best first, so the larger index of a pair is the worse; a dropped one still drops its own neighbours,
    # which only thins chains of near-duplicates a little further.
    keep[pairs.max(axis=1)] = False
    return hypotheses.take(np.flatnonzero(keep)[:most])


def _distance(hypotheses: Hypotheses, seen: Seen) -> FloatArray:
    """``(H,)`` distance from the camera to the object's placement origin, at least; a scale only."""
    away = hypotheses.placement[:, 1:] - seen.camera.centre_mm
    return np.asarray(np.maximum(np.linalg.norm(away, axis=1), 1.0))


def weigh(world: World, hypotheses: Hypotheses) -> Belief:
    """Normalise the weights: the prior over places, against the prior of "none of these".

    A hypothesis whose matches have all been taken back explains nothing; there may be more of these than places, and
    what they hold belongs to "none of these".
    """
    place = _first_place(hypotheses)
    log_prior = np.where(place >= 0, np.log1p(-NONE_PRIOR) + world.places.log_weight[place], -np.inf)
    log_weight = np.append(hypotheses.log_weight + log_prior, np.log(NONE_PRIOR))
    log_weight -= log_weight.max()
    p = np.exp(log_weight)
    p /= p.sum()
    order = np.argsort(-p[:-1], kind="stable")
    return Belief(hypotheses.take(order), p[:-1][order], float(p[-1]))


def with_relatives(world: World, belief: Belief, views: list[Seen]) -> Belief:
    """The belief where "none of these" holds relatives of the leading places, too (``recognition.relatives``).

    They compete only on a bench whose rates were measured: a guess does not tell them from the objects known.
    """
    lead = np.flatnonzero(belief.probability > _LEADS)[:_REPAIRED]
    if lead.size == 0 or not world.rates.measured:
        return belief
    kin = np.exp(log_odds_of_relatives(world, belief.hypotheses.take(lead), views))
    more = NONE_PRIOR / (1.0 - NONE_PRIOR) * float(belief.probability[lead] @ kin)
    total = 1.0 + more
    return replace(belief, probability=belief.probability / total, none=(belief.none + more) / total)


def _first_place(hypotheses: Hypotheses) -> IntArray:
    """``(H,)`` the part that each hypothesis matches best in the first view where it matches any; -1 where in none."""
    place = np.full(len(hypotheses), -1)
    for found in hypotheses.matches:
        place = np.where(place >= 0, place, found.part[:, 0])
    return place
