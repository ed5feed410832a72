"""Variable projection: object placements that fit many views at once, internals eliminated, batched over hypotheses.

This is the maximum-likelihood form of the paper's inner camera invariants (design §3): its zero set is that of J and
K, it weighs noise correctly, takes any number of points and views, and carries soft priors as extra rows.

Shape legend: H hypotheses, N points (padded; weight 0), V views, G groups of views that share internals, P parameters
of the placement (4: phi, dx, dy, dz). Internals are (fx, fy, u0, v0).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.internals import log_determinant
from recognition.motion import IntArray, State
from recognition.priors import Priors
from recognition.projected import Linearised, Problem, linearise

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

UNKNOWN_VARIANCE = 1e13  # of a direction without information, in units of the variance with all other directions known

# Less damping than this would let rounding errors drift along directions that nothing determines.
_LEAST_DAMPING = 1e-9


@dataclass(frozen=True, slots=True)
class Refined:
    """What ``refine_batch`` returns.

    Attributes:
        placement: ``(H, 4)`` phi (radians), dx, dy, dz (mm) of p_rig = Ry(phi) p + d.
        covariance: ``(H, 4, 4)`` of the placement, radians and mm, marginal over internals and nuisances, at the given
            noise. Directions that nothing determines have a huge but finite variance (``UNKNOWN_VARIANCE``).
        internals: ``(H, G, 4)``; zeros for a group without points.
        residuals: ``(H, N, 2)`` observed minus predicted, pixels; 0 for padding.
        rms_px: ``(H,)`` root mean square of one residual coordinate, over all points of non-zero weight.
        cost: ``(H,)`` -2 log of (likelihood x priors) up to a constant: sum of squared residuals in sd (or the robust
            loss) and of the priors. ``inf`` where a point lies behind its camera.
        log_det_information: ``(H,)`` of the joint information of placement and internals (flat where the data are
            silent, so compare only hypotheses on the same views); for Laplace evidence: -cost/2 - this/2.
        valid: ``(H,)`` all points in front of their cameras, no focal length negative (0: undetermined), cost finite.
        converged: ``(H,)`` the last step was negligible.
    """

    placement: FloatArray
    covariance: FloatArray
    internals: FloatArray
    residuals: FloatArray = field(repr=False)
    rms_px: FloatArray
    cost: FloatArray
    log_det_information: FloatArray
    valid: BoolArray
    converged: BoolArray


def refine_batch(
    start: FloatArray,
    points_mm: FloatArray,
    pixels: FloatArray,
    weight: FloatArray,
    view: IntArray,
    cameras: FloatArray,
    group: IntArray,
    priors: Priors | None = None,
    *,
    iterations: int = 10,
    tail_sd: float | None = None,
    placement_prior: tuple[FloatArray, FloatArray] | None = None,
    tolerance: float = 1e-3,
) -> Refined:
    """Refine the placements of H hypotheses at once by Levenberg-Marquardt on the projected problem.

    Args:
        start: ``(H, 4)`` phi (radians), dx, dy, dz (mm): object -> rig, p_rig = Ry(phi) p + d.
        points_mm: ``(H, N, 3)`` corners in the object frame.
        pixels: ``(H, N, 2)`` where they were seen.
        weight: ``(H, N)`` 1 / sigma_px of a corner coordinate; 0 for padding.
        view: ``(H, N)`` int, the view of each corner, an index into ``cameras``.
        cameras: ``(V, 4)`` theta (radians), cx, cy, cz (mm): the known camera poses in the rig frame.
        group: ``(V,)`` int, the internals group of each view (views of one locked zoom share a group).
        priors: soft knowledge of the internals and nuisances; ``None``: none at all.
        iterations: at most so many steps.
        tail_sd: corners further off than about so many sd lose their pull (Cauchy loss); ``None``: pure least squares.
        placement_prior: Gaussian on the placement: mean ``(H, 4)`` and precision ``(H, 4, 4)``, radians and mm.
        tolerance: a hypothesis has converged when its next step would lower the cost by less than this.
    """
    group = np.asarray(group, dtype=np.int64)
    view = np.asarray(view, dtype=np.int64)
    problem = Problem(
        points_mm,
        pixels,
        weight,
        view,
        cameras,
        group[view],
        int(group.max(initial=0)) + 1,
        priors,
        tail_sd,
        placement_prior,
    )
    state = start_state(np.asarray(start[:, 0]), np.asarray(start[:, 1:]), priors)
    state, fit, converged = minimise(problem, state, iterations, tolerance)
    return _refined(problem, state, fit, converged)


def start_state(rotation: FloatArray, shift: FloatArray, priors: Priors | None) -> State:
    """A state with the nuisances that the priors ask for, all zero."""
    h = len(shift)
    tilt = np.zeros((h, 2)) if priors is not None and priors.tilt_sd_deg is not None else None
    radial = np.zeros(h) if priors is not None and priors.radial_sd is not None else None
    return State(rotation, shift, tilt, radial)


def minimise(problem: Problem, state: State, iterations: int, tolerance: float) -> tuple[State, Linearised, BoolArray]:
    """Levenberg-Marquardt on all hypotheses at once; a step that raises the cost, or puts a point behind, is undone."""
    fit = linearise(problem, state, None)
    return _descend(problem, state, fit, np.full(len(fit.cost), 1e-3), iterations, tolerance)


def _descend(
    problem: Problem, state: State, fit: Linearised, lam: FloatArray, iterations: int, tolerance: float
) -> tuple[State, Linearised, BoolArray]:
    converged = np.zeros(len(lam), dtype=bool)
    for done in range(iterations):
        step, promise = _damped_step(fit, lam)
        converged = promise < tolerance
        going = np.flatnonzero(~converged)
        if 2 * len(going) <= len(lam):
            # Most have arrived: go on with the others alone, for time is linear in their number.
            if len(going) > 0:
                left = problem.take(going), state.take(going), fit.take(going), lam[going]
                sub_state, sub_fit, sub_converged = _descend(*left, iterations - done, tolerance)
                state, fit = state.put(going, sub_state), fit.put(going, sub_fit)
                converged[going] = sub_converged
            break
        moved = state.moved(step)
        trial = linearise(problem, moved, fit)
        better = (trial.cost <= fit.cost) & np.isfinite(trial.cost)
        state, fit = moved.where(better, state), trial.where(better, fit)
        lam = np.clip(np.where(better, lam * 0.1, lam * 10.0), _LEAST_DAMPING, 1e12)
    return state, fit, converged


def _damped_step(fit: Linearised, lam: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The step ``(H, P)`` and how much the undamped quadratic model promises to gain, ``(H,)``."""
    p = fit.gradient.shape[-1]
    # A start where nothing can be evaluated stays where it is.
    system = np.concatenate([fit.information, fit.gradient[:, :, None]], axis=2)
    sound = np.asarray(np.isfinite(system).all(axis=(1, 2)))
    if not sound.all():
        fit = replace(
            fit,
            information=np.where(sound[:, None, None], fit.information, np.eye(p)),
            gradient=np.where(sound[:, None], fit.gradient, 0.0),
        )
    scale = _unit_scale(fit.information)
    scaled = fit.information * scale[:, :, None] * scale[:, None, :]
    damped = scaled + lam[:, None, None] * np.eye(p) + 1e-13 * np.eye(p)
    scaled_gradient = fit.gradient * scale
    step = -np.linalg.solve(damped, scaled_gradient[..., None])[..., 0]
    promise = -np.einsum("hp,hp->h", step, scaled_gradient)
    return step * scale, promise


def _refined(problem: Problem, state: State, fit: Linearised, converged: BoolArray) -> Refined:
    counted = np.count_nonzero(problem.weight, axis=1)
    square = np.einsum("hnk,hnk->h", fit.residuals, fit.residuals)
    return Refined(
        placement=np.concatenate([state.rotation[:, None], state.shift], axis=1),
        covariance=covariance(fit.information)[:, :4, :4],
        internals=fit.internals,
        residuals=fit.residuals,
        rms_px=np.sqrt(square / np.maximum(2 * counted, 1)),
        cost=fit.cost,
        log_det_information=log_determinant(fit.inner_hessian, fit.information),
        valid=fit.valid,
        converged=converged,
    )


def covariance(information: FloatArray) -> FloatArray:
    """Inverses ``(H, P, P)`` of informations that may be singular: a silent direction gets ``UNKNOWN_VARIANCE``.

    The matrices are scaled to unit diagonal first, so that millimetres and radians may be compared.
    """
    scale, vectors, values = eigen_scaled(information)
    scaled = vectors * (1.0 / np.maximum(values, 1.0 / UNKNOWN_VARIANCE))[:, None, :] @ vectors.transpose(0, 2, 1)
    return np.asarray(scaled * scale[:, :, None] * scale[:, None, :])


def eigen_scaled(information: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Scales ``(H, P)``, eigenvectors ``(H, P, P)`` (columns) and eigenvalues ``(H, P)`` of the scaled information."""
    finite = np.where(np.isfinite(information), information, 0.0)
    scale = _unit_scale(finite)
    values, vectors = np.linalg.eigh(finite * scale[:, :, None] * scale[:, None, :])
    return scale, vectors, values


def _unit_scale(information: FloatArray) -> FloatArray:
    """Scales ``(H, P)`` that bring the diagonal to one; one where there is no information."""
    diagonal = np.einsum("hpp->hp", information)
    some = diagonal > 1e-30
    return np.asarray(np.where(some, 1.0 / np.sqrt(np.where(some, diagonal, 1.0)), 1.0))
