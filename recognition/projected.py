"""The projected problem: for given placements, the best internals, the cost, and the normal equations of what is left.

Shape legend: H hypotheses, N points (padded; weight 0), G groups of views that share internals, P parameters of the
placement and nuisances. Internals are (fx, fy, u0, v0). Eliminating them by a Schur complement gives the same
Gauss-Newton step as Kaufman's variable projection, and the marginal information of the placement, priors included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from recognition.internals import add_priors, prior_cost, solve_pairs
from recognition.motion import IntArray, Normalised, State, normalise, replaced
from recognition.priors import Priors

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_MIN_DEPTH_MM = 1e-3
_FALLBACK_FOCAL_PX = 1000.0
_FURTHEST = 2000.0
"""Depth in extents of the points beyond which a fit is refused: a camera at infinity often fits, and is never meant."""


@dataclass(frozen=True, slots=True)
class Problem:
    """The data of H hypotheses: see ``refine_batch`` for the fields."""

    points_mm: FloatArray
    pixels: FloatArray
    weight: FloatArray
    view: IntArray
    cameras: FloatArray
    group: IntArray
    groups: int
    priors: Priors | None = None
    tail_sd: float | None = None
    placement_prior: tuple[FloatArray, FloatArray] | None = None

    def take(self, index: IntArray) -> Problem:
        """The problem of some of the hypotheses."""
        prior = self.placement_prior
        return Problem(
            self.points_mm[index],
            self.pixels[index],
            self.weight[index],
            self.view[index],
            self.cameras,
            self.group[index],
            self.groups,
            self.priors,
            self.tail_sd,
            None if prior is None else (prior[0][index], prior[1][index]),
        )


@dataclass(frozen=True, slots=True)
class Linearised:
    """One evaluation: cost, internals, robust weights, and the normal equations after eliminating the internals."""

    cost: FloatArray  # (H,)
    internals: FloatArray  # (H, G, 4)
    information: FloatArray  # (H, P, P)
    gradient: FloatArray  # (H, P)
    residuals: FloatArray  # (H, N, 2)
    inner_hessian: FloatArray  # (H, G, 4, 4)
    in_front: BoolArray  # (H,) and not absurdly far

    @property
    def valid(self) -> BoolArray:
        """``(H,)`` all points in front, no focal length negative (0 is undetermined), everything finite."""
        positive = np.all(self.internals[..., :2] >= 0, axis=(1, 2))
        return np.asarray(self.in_front & positive & np.isfinite(self.cost))

    def where(self, chosen: BoolArray, other: Linearised) -> Linearised:
        """This evaluation where ``chosen`` (H,), else ``other``."""
        pairs = zip(self._arrays(), other._arrays(), strict=True)
        return Linearised(*(np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))

    def take(self, index: IntArray) -> Linearised:
        """The evaluation of some of the hypotheses."""
        return Linearised(*(a[index] for a in self._arrays()))

    def put(self, index: IntArray, part: Linearised) -> Linearised:
        """This evaluation with those of some hypotheses replaced."""
        return Linearised(*(replaced(a, index, b) for a, b in zip(self._arrays(), part._arrays(), strict=True)))

    def _arrays(self) -> list[npt.NDArray[Any]]:
        return [getattr(self, name) for name in Linearised.__slots__]


def linearise(problem: Problem, state: State, before: Linearised | None) -> Linearised:
    """Evaluate the projected problem at a state; the internals start from ``before`` and are solved again.

    A state that makes numbers overflow gets an infinite cost, without a warning: it is only a step that was too long.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _linearise(problem, state, before)


def _linearise(problem: Problem, state: State, before: Linearised | None) -> Linearised:
    seen = normalise(state, problem.points_mm, problem.view, problem.cameras)
    square = problem.weight**2
    robust = square if before is None else square * _robust_weight(before.residuals, problem)
    internals = _solve_internals(problem, seen, robust, None if before is None else before.internals)
    each = _per_point(problem, internals)
    residuals = _residuals(problem, seen, each)
    if problem.tail_sd is not None:
        robust = square * _robust_weight(residuals, problem)
    pose, gradient, mixed, inner_gradient = _outer_equations(problem, seen, robust, residuals, each)
    hessian = _inner_hessian(problem, seen, robust)
    add_priors(hessian, inner_gradient, internals, problem.priors)
    cost = _data_cost(problem, residuals) + prior_cost(internals, problem.priors).sum(axis=-1)
    cost = cost + _add_state_priors(problem, state, pose, gradient)
    solved = solve_pairs(hessian, np.concatenate([mixed, inner_gradient[..., None]], axis=-1))
    taken = np.einsum("hgap,hgaq->hpq", mixed, solved)
    information, gradient = pose - taken[..., :-1], gradient - taken[..., -1]
    furthest = _FURTHEST * np.ptp(problem.points_mm, axis=1).max(axis=-1, keepdims=True)
    possible = (seen.depth > _MIN_DEPTH_MM) & (seen.depth < furthest)
    in_front = np.all(possible | (problem.weight == 0), axis=1)
    cost = np.where(in_front & np.isfinite(cost), cost, np.inf)
    return Linearised(cost, internals, information, gradient, residuals, hessian, in_front)


def mixed_information(problem: Problem, state: State, fit: Linearised) -> tuple[FloatArray, FloatArray]:
    """Diagonal ``(H, P)`` of the information of the pose at given internals, and that between both ``(H, G, 4, P)``."""
    seen = normalise(state, problem.points_mm, problem.view, problem.cameras)
    weight = problem.weight**2 * _robust_weight(fit.residuals, problem)
    pose, _, mixed, _ = _outer_equations(problem, seen, weight, fit.residuals, _per_point(problem, fit.internals))
    return np.asarray(np.einsum("hpp->hp", pose)), mixed


def _robust_weight(residuals: FloatArray, problem: Problem) -> FloatArray:
    """``(H, N)`` weights of the Cauchy loss on a corner's distance, both coordinates together."""
    if problem.tail_sd is None:
        return np.ones(problem.weight.shape)
    square = problem.weight**2 * np.einsum("hnk,hnk->hn", residuals, residuals)
    return np.asarray(1.0 / (1.0 + square / problem.tail_sd**2))


def _data_cost(problem: Problem, residuals: FloatArray) -> FloatArray:
    """``(H,)`` -2 log likelihood up to a constant."""
    square = problem.weight**2 * np.einsum("hnk,hnk->hn", residuals, residuals)
    if problem.tail_sd is not None:
        square = problem.tail_sd**2 * np.log1p(square / problem.tail_sd**2)
    return np.asarray(square.sum(axis=1))


def _per_group(problem: Problem, values: FloatArray) -> FloatArray:
    """Sums over the points of each group: ``(H, K, N)`` -> ``(H, G, K)``."""
    h, k, n = values.shape
    if problem.groups == 1:
        return np.asarray((values.reshape(-1, n) @ np.ones(n)).reshape(h, 1, k))
    one_hot = (problem.group[:, :, None] == np.arange(problem.groups)).astype(np.float64)
    return np.asarray((values @ one_hot).transpose(0, 2, 1))


def _per_point(problem: Problem, internals: FloatArray) -> FloatArray:
    """Each point's internals: ``(H, G, 4)`` -> ``(H, N, 4)``."""
    if problem.groups == 1:
        return internals
    return np.take_along_axis(internals, problem.group[:, :, None], axis=1)


def _inner_hessian(problem: Problem, seen: Normalised, w: FloatArray) -> FloatArray:
    """The data's ``(H, G, 4, 4)`` in the internals (fx, fy, u0, v0)."""
    wx, wy = w * seen.x, w * seen.y
    sums = _per_group(problem, np.stack([wx * seen.x, wx, wy * seen.y, wy, w], axis=1))
    hessian = np.zeros((*sums.shape[:2], 4, 4))
    for k, (a, b) in enumerate([(0, 0), (0, 2), (1, 1), (1, 3)]):
        hessian[..., a, b] = hessian[..., b, a] = sums[..., k]
    hessian[..., 2, 2] = hessian[..., 3, 3] = sums[..., 4]
    return hessian


def _solve_internals(problem: Problem, seen: Normalised, w: FloatArray, before: FloatArray | None) -> FloatArray:
    """The internals ``(H, G, 4)`` that fit best at the given coordinates; priors are linearised at the last ones."""
    data = _inner_hessian(problem, seen, w)
    u, v = problem.pixels[..., 0] * w, problem.pixels[..., 1] * w
    rhs = _per_group(problem, np.stack([seen.x * u, seen.y * v, u, v], axis=1))
    if before is None:
        internals = solve_pairs(data, rhs[..., None])[..., 0]
    if problem.priors is None:
        return solve_pairs(data, rhs[..., None])[..., 0]
    if before is None:
        focal = internals[..., :2]
        span = problem.priors.focal_range_px
        fallback = _FALLBACK_FOCAL_PX if span is None else float(np.sqrt(span[0] * span[1]))
        internals[..., :2] = np.where(np.abs(focal) > 1e-6, focal, fallback)
    else:
        internals = before
    for _ in range(4 if before is None else 2):
        hessian = data.copy()
        gradient = np.einsum("hgab,hgb->hga", data, internals) - rhs
        add_priors(hessian, gradient, internals, problem.priors)
        internals = internals - solve_pairs(hessian, gradient[..., None])[..., 0]
    return internals


def _residuals(problem: Problem, seen: Normalised, each: FloatArray) -> FloatArray:
    """Observed minus predicted pixels ``(H, N, 2)``; 0 for padding."""
    ru = problem.pixels[..., 0] - each[..., 0] * seen.x - each[..., 2]
    rv = problem.pixels[..., 1] - each[..., 1] * seen.y - each[..., 3]
    return np.where(problem.weight[..., None] > 0, np.stack([ru, rv], axis=-1), 0.0)


def _outer_equations(
    problem: Problem, seen: Normalised, w: FloatArray, residuals: FloatArray, each: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Data part of the joint normal equations: pose-pose, pose gradient, internals-pose, internals gradient."""
    root = np.sqrt(w)
    ju, jv = (root * each[..., 0])[:, None] * seen.dx, (root * each[..., 1])[:, None] * seen.dy
    ru, rv = root * residuals[..., 0], root * residuals[..., 1]
    rows = np.concatenate([ju, jv], axis=2)
    pose = rows @ rows.transpose(0, 2, 1)
    gradient = -(rows @ np.concatenate([ru, rv], axis=1)[..., None])[..., 0]
    h, p, _ = ju.shape
    mixed = np.empty((h, problem.groups, 4, p))
    for k, (column, j) in enumerate([(root * seen.x, ju), (root * seen.y, jv), (root, ju), (root, jv)]):
        mixed[:, :, k] = _per_group(problem, column[:, None] * j)
    inner = np.stack([root * seen.x * ru, root * seen.y * rv, root * ru, root * rv], axis=1)
    return pose, gradient, mixed, -_per_group(problem, inner)


def _add_state_priors(problem: Problem, state: State, information: FloatArray, gradient: FloatArray) -> FloatArray:
    """Add, in place, what is known of the placement and of the nuisances; returns its cost ``(H,)``."""
    cost = np.zeros(len(gradient))
    if problem.placement_prior is not None:
        mean, precision = problem.placement_prior
        now = np.concatenate([state.rotation[:, None], state.shift], axis=1) - mean
        pull = np.einsum("hab,hb->ha", precision, now)
        information[:, :4, :4] += precision
        gradient[:, :4] += pull
        cost = cost + np.einsum("ha,ha->h", pull, now)
    nuisances: list[tuple[FloatArray, float]] = []
    if state.tilt is not None and problem.priors is not None and problem.priors.tilt_sd_deg is not None:
        sd = float(np.radians(problem.priors.tilt_sd_deg))
        nuisances += [(state.tilt[:, 0], sd), (state.tilt[:, 1], sd)]
    if state.radial is not None and problem.priors is not None and problem.priors.radial_sd is not None:
        nuisances.append((state.radial, problem.priors.radial_sd))
    first = gradient.shape[-1] - len(nuisances)
    for k, (value, sd) in enumerate(nuisances, start=first):
        information[:, k, k] += 1.0 / sd**2
        gradient[:, k] += value / sd**2
        cost = cost + (value / sd) ** 2
    return cost
