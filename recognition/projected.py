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

from recognition.internals import add_priors, prior_cost, settle, solve_pairs
from recognition.kernels import projection as kernels
from recognition.motion import IntArray, State, arrays, camera_rows, replaced
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
    internals = _solve_internals(problem, state, before)
    sums = _joint_sums(problem, state, internals)
    hessian, inner_gradient, pose, gradient = sums.inner, sums.inner_gradient, sums.pose, sums.gradient
    add_priors(hessian, inner_gradient, internals, problem.priors)
    cost = sums.cost + prior_cost(internals, problem.priors).sum(axis=-1)
    cost = cost + _add_state_priors(problem, state, pose, gradient)
    solved = solve_pairs(hessian, np.concatenate([sums.mixed, inner_gradient[..., None]], axis=-1))
    h, g, _, p = sums.mixed.shape
    taken = sums.mixed.reshape(h, g * 4, p).transpose(0, 2, 1) @ solved.reshape(h, g * 4, p + 1)
    information, gradient = pose - taken[..., :-1], gradient - taken[..., -1]
    cost = np.where(sums.in_front & np.isfinite(cost), cost, np.inf)
    return Linearised(cost, internals, information, gradient, sums.residuals, hessian, sums.in_front)


def mixed_information(problem: Problem, state: State, fit: Linearised) -> tuple[FloatArray, FloatArray]:
    """Diagonal ``(H, P)`` of the information of the pose at given internals, and that between both ``(H, G, 4, P)``."""
    sums = _joint_sums(problem, state, fit.internals)
    return np.asarray(np.einsum("hpp->hp", sums.pose)), sums.mixed


@dataclass(frozen=True, slots=True)
class _Sums:
    """What ``kernels.joint_sums`` returns."""

    residuals: FloatArray
    pose: FloatArray
    gradient: FloatArray
    mixed: FloatArray
    inner: FloatArray
    inner_gradient: FloatArray
    cost: FloatArray
    in_front: BoolArray


def _joint_sums(problem: Problem, state: State, internals: FloatArray) -> _Sums:
    return _Sums(
        *kernels.joint_sums(
            problem.points_mm,
            problem.pixels,
            problem.weight,
            problem.view,
            problem.group,
            camera_rows(problem.cameras),
            *arrays(state),
            problem.tail_sd or 0.0,
            internals,
            _MIN_DEPTH_MM,
            _FURTHEST,
        )
    )


def _solve_internals(problem: Problem, state: State, before: Linearised | None) -> FloatArray:
    """The internals ``(H, G, 4)`` that fit best at a state; robust weights and priors are those at the last ones."""
    rotation, _, shift, tilt, radial = arrays(state)
    data, rhs = kernels.inner_sums(
        problem.points_mm,
        problem.pixels,
        problem.weight,
        np.zeros_like(problem.pixels) if before is None else before.residuals,
        problem.view,
        problem.group,
        problem.groups,
        camera_rows(problem.cameras),
        rotation,
        shift,
        tilt,
        radial,
        problem.tail_sd or 0.0,
    )
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
        internals = before.internals
    return settle(data, rhs, internals, problem.priors, 4 if before is None else 2)


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
