"""The set of hypotheses, each an object placed in the rig frame with the part matches of every view so far.

Shape legend: H hypotheses, V views, G internals groups, M matches of a view (padded), C corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.association import Matching
from recognition.layout import Layout
from recognition.priors import Priors
from recognition.seen import Seen
from recognition.varpro import refine_batch
from recognition.visibility import camera_in_objects

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MOST_MATCHES = 24
TAIL_SD = 3.0


@dataclass(frozen=True, slots=True)
class ViewMatches:
    """Matches of one view: part ``(H, M)`` (-1 padded), corners ``(H, M, C, 2)`` px, weight ``(H, M)`` 1/px."""

    part: IntArray
    corners_px: FloatArray = field(repr=False)
    weight: FloatArray = field(repr=False)

    def take(self, rows: IntArray) -> ViewMatches:
        """Those hypotheses."""
        return ViewMatches(self.part[rows], self.corners_px[rows], self.weight[rows])


def no_matches(hypotheses: int, seen: Seen, room: int = MOST_MATCHES) -> ViewMatches:
    """Nothing matched yet; ``room`` for so many."""
    corners = seen.corners_px.shape[1]
    return ViewMatches(
        np.full((hypotheses, room), -1),
        np.zeros((hypotheses, room, corners, 2)),
        np.zeros((hypotheses, room)),
    )


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """H hypotheses.

    Attributes:
        object_of: ``(H,)`` index of the object.
        placement: ``(H, 4)`` object -> rig, radians and mm.
        covariance: ``(H, 4, 4)`` of the placement.
        internals: ``(H, G, 4)``; zero focal length where a group has not been seen.
        prior_cost: ``(H,)`` what the fit pays for its internals, in -2 log.
        odds: ``(H, V)`` log odds that each view brings.
        matches: one for each view.
    """

    object_of: IntArray
    placement: FloatArray
    covariance: FloatArray = field(repr=False)
    internals: FloatArray = field(repr=False)
    prior_cost: FloatArray = field(repr=False)
    odds: FloatArray = field(repr=False)
    matches: tuple[ViewMatches, ...] = field(repr=False)

    @staticmethod
    def empty(views: Sequence[Seen] = ()) -> Hypotheses:
        """No hypotheses, with room for the views."""
        groups = max((v.group for v in views), default=0) + 1
        return Hypotheses(
            np.empty(0, dtype=np.int64),
            np.empty((0, 4)),
            np.empty((0, 4, 4)),
            np.empty((0, groups, 4)),
            np.empty(0),
            np.empty((0, len(views))),
            tuple(no_matches(0, v) for v in views),
        )

    def __len__(self) -> int:
        return len(self.object_of)

    def put(self, rows: IntArray, others: Hypotheses) -> Hypotheses:
        """The set with some hypotheses replaced, as many as there are rows."""
        rest = np.setdiff1d(np.arange(len(self)), rows)
        order = np.empty(len(self), dtype=np.int64)
        order[np.concatenate([rest, rows])] = np.arange(len(self))
        return join(self.take(rest), others).take(order)

    def take(self, rows: IntArray) -> Hypotheses:
        """Those hypotheses, in that order."""
        return Hypotheses(
            self.object_of[rows],
            self.placement[rows],
            self.covariance[rows],
            self.internals[rows],
            self.prior_cost[rows],
            self.odds[rows],
            tuple(m.take(rows) for m in self.matches),
        )

    @property
    def log_weight(self) -> FloatArray:
        """``(H,)`` log odds of all views together, less what the internals cost."""
        return np.asarray(self.odds.sum(axis=1) - 0.5 * self.prior_cost)


def join(a: Hypotheses, b: Hypotheses) -> Hypotheses:
    """Both sets; they must know the same views."""
    return Hypotheses(
        np.concatenate([a.object_of, b.object_of]),
        np.concatenate([a.placement, b.placement]),
        np.concatenate([a.covariance, b.covariance]),
        np.concatenate([a.internals, b.internals]),
        np.concatenate([a.prior_cost, b.prior_cost]),
        np.concatenate([a.odds, b.odds]),
        tuple(
            ViewMatches(
                np.concatenate([m.part, n.part]),
                np.concatenate([m.corners_px, n.corners_px]),
                np.concatenate([m.weight, n.weight]),
            )
            for m, n in zip(a.matches, b.matches, strict=True)
        ),
    )


def _plausible(internals: FloatArray, image_size: tuple[int, int]) -> BoolArray:
    """``(H, G)`` whether a lens could be so: a principal point within half a width of the centre, nearly square pixels.

    Without this a hypothesis could escape a view's evidence by internals under which nothing is in the frame.
    """
    fx, fy, u0, v0 = np.moveaxis(internals, -1, 0)
    width, height = image_size
    near = (np.abs(u0 - width / 2) < _PRINCIPAL_REACH * width) & (np.abs(v0 - height / 2) < _PRINCIPAL_REACH * width)
    with np.errstate(divide="ignore", invalid="ignore"):
        square = np.abs(np.log(fy / fx)) < _ASPECT_REACH
    return np.asarray((fx > 0) & (fy > 0) & near & square)


def _seen_groups(hypotheses: Hypotheses, groups: IntArray, count: int) -> BoolArray:
    """``(H, G)`` whether any view of a group has matches."""
    seen = np.zeros((len(hypotheses), count), dtype=bool)
    for group, found in zip(groups, hypotheses.matches, strict=True):
        seen[:, group] |= (found.part >= 0).any(axis=1)
    return seen


_PRINCIPAL_REACH, _ASPECT_REACH = 0.5, 0.15


def gather(matching: Matching, seen: Seen, hypotheses: int, sd_px: FloatArray) -> ViewMatches:
    """Matches as padded arrays, the nearest ``MOST_MATCHES`` of each hypothesis; ``sd_px`` ``(n,)`` of a corner."""
    corners = seen.corners_px.shape[1]
    part = np.full((hypotheses, MOST_MATCHES), -1)
    px = np.zeros((hypotheses, MOST_MATCHES, corners, 2))
    weight = np.zeros((hypotheses, MOST_MATCHES))
    hit = np.flatnonzero(matching.detection >= 0)
    row = matching.pairs.hypothesis[hit]
    order = np.lexsort((matching.distance_px[hit], row))
    hit, row = hit[order], row[order]
    first = np.searchsorted(row, row)
    column = np.arange(len(row)) - first
    hit, row, column = (a[column < MOST_MATCHES] for a in (hit, row, column))
    det = matching.detection[hit]
    part[row, column] = matching.pairs.part[hit]
    px[row, column] = seen.corners_px[det]
    weight[row, column] = 1.0 / np.hypot(seen.sigma_px[det], sd_px[hit])
    return ViewMatches(part, px, weight)


def best(hypotheses: Hypotheses, most: int) -> Hypotheses:
    """The ones of greatest weight, best first."""
    return hypotheses.take(np.argsort(-hypotheses.log_weight, kind="stable")[:most])


def forget(hypotheses: Hypotheses, which: BoolArray) -> Hypotheses:
    """Take back the matches of some views ``(H, V)``."""
    matches = []
    for k, found in enumerate(hypotheses.matches):
        gone = which[:, k, None]
        matches.append(replace(found, part=np.where(gone, -1, found.part), weight=np.where(gone, 0.0, found.weight)))
    return replace(hypotheses, matches=tuple(matches))


def forget_contradicted(hypotheses: Hypotheses) -> Hypotheses:
    """Take back the matches of views that speak against their hypothesis: likely wrong, they would bend its fit."""
    return forget(hypotheses, hypotheses.odds < 0)


def out_of_reach(
    layout: Layout, hypotheses: Hypotheses, views: list[Seen], nearest_mm: float, farthest_mm: float
) -> BoolArray:
    """``(H,)`` whether a part that is matched stands nearer to, or farther from, its camera than the bench allows."""
    beyond = np.zeros(len(hypotheses), dtype=bool)
    for found, seen in zip(hypotheses.matches, views, strict=True):
        _, centre = camera_in_objects(hypotheses.placement, seen.camera_row)
        away = np.linalg.norm(layout.centre_mm[found.part] - centre[:, None], axis=2)
        wrong = (away < 0.9 * nearest_mm) | (away > 1.1 * farthest_mm)
        beyond |= (wrong & (found.part >= 0)).any(axis=1)
    return beyond


def refine(
    layout: Layout, hypotheses: Hypotheses, views: list[Seen], priors: Priors, *, iterations: int = 6
) -> Hypotheses:
    """One placement for each hypothesis from all its matches in all views, internals eliminated."""
    if len(hypotheses) == 0:
        return hypotheses
    points, pixels, weights, index = [], [], [], []
    corners = layout.corners_mm.shape[1]
    real = np.arange(corners)[None] < layout.corner_count[:, None]
    for k, found in enumerate(hypotheses.matches):
        used = int((found.part >= 0).sum(axis=1).max(initial=0))
        part = found.part[:, :used]
        points.append(layout.corners_mm[part].reshape(len(hypotheses), -1, 3))
        pixels.append(found.corners_px[:, :used].reshape(len(hypotheses), -1, 2))
        weight = found.weight[:, :used, None] * real[part]
        weights.append(weight.reshape(len(hypotheses), -1))
        index.append(np.full((len(hypotheses), used * corners), k))
    if not sum(p.shape[1] for p in points):
        return replace(hypotheses, internals=np.zeros_like(hypotheses.internals))
    groups = np.array([v.group for v in views])
    fit = refine_batch(
        hypotheses.placement,
        np.concatenate(points, axis=1),
        np.concatenate(pixels, axis=1),
        np.concatenate(weights, axis=1),
        np.concatenate(index, axis=1),
        np.array([v.camera_row for v in views]),
        groups,
        priors,
        iterations=iterations,
        tail_sd=TAIL_SD,
        tolerance=0.05,
    )
    usable = fit.valid & np.isfinite(fit.placement).all(axis=1)
    internals = np.where(usable[:, None, None], 0.0, hypotheses.internals)
    width = fit.internals.shape[1]
    internals[:, :width] = np.where(usable[:, None, None], fit.internals, internals[:, :width])
    # With priors alone the fit invents internals for a group without matches; they are not known.
    internals[~_plausible(internals, views[0].image_size) | ~_seen_groups(hypotheses, groups, internals.shape[1])] = 0.0
    total = np.concatenate(weights, axis=1)
    square = (fit.residuals**2).sum(axis=2) * total**2
    corner_cost = TAIL_SD**2 * np.log1p(square / TAIL_SD**2)
    left = np.clip(fit.cost - corner_cost.sum(axis=1), 0.0, 200.0)
    return replace(
        hypotheses,
        placement=np.where(usable[:, None], fit.placement, hypotheses.placement),
        covariance=np.where(usable[:, None, None], fit.covariance, hypotheses.covariance),
        internals=internals,
        prior_cost=np.where(usable, left, 200.0),
    )
