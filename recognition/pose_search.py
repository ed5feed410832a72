"""Search for a pose without a start: many starts, all refined at once, the distinct minima kept, best first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.geometry import rotation_y
from recognition.motion import State
from recognition.pose_start import linear_starts, normalise_pixels, rotation_grid
from recognition.priors import Priors
from recognition.projected import Linearised, Problem
from recognition.varpro import minimise, start_state
from recognition.views import Observations

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_MOST_STARTS = 400
_MOST_MINIMA = 24
_SAME_ANGLE_RAD = 0.01
_SAME_FRACTION = 0.01  # of the distance


@dataclass(frozen=True, slots=True)
class Minima:
    """Distinct minima, best first: their problem (H of them), states and evaluations, in the centred object frame."""

    problem: Problem
    state: State
    fit: Linearised


def search(seen: Observations, dof: int, priors: Priors | None, tail_sd: float | None) -> Minima | None:
    """All distinct minima found, or ``None`` if no start led to points in front and positive focal lengths.

    ``seen.points_mm`` must have their centre at the origin.
    """
    state = _starts(seen, dof, priors)
    if len(state.shift) == 0:
        return None
    coarse = _problem(seen, len(state.shift), priors, tail_sd, normalised=priors is None)
    state, fit, _ = minimise(coarse, state, iterations=15, tolerance=1e-6)
    best = _distinct(state, fit)
    if len(best) == 0:
        return None
    fine = _problem(seen, len(best), priors, tail_sd, normalised=False)
    state, fit, _ = minimise(fine, state.take(best), iterations=150, tolerance=1e-18)
    best = _distinct(state, fit)
    return Minima(fine.take(best), state.take(best), fit.take(best)) if len(best) else None


def polish(seen: Observations, state: State, priors: Priors | None, tail_sd: float | None) -> Minima | None:
    """The minima that given starts lead to."""
    problem = _problem(seen, len(state.shift), priors, tail_sd, normalised=False)
    state, fit, _ = minimise(problem, state, iterations=200, tolerance=1e-18)
    best = _distinct(state, fit)
    return Minima(problem.take(best), state.take(best), fit.take(best)) if len(best) else None


def _starts(seen: Observations, dof: int, priors: Priors | None) -> State:
    """Starts from the view that has most points, expressed in the frame of the first view's camera."""
    anchor = int(np.argmax(np.bincount(seen.view)))
    mine = seen.view == anchor
    points = seen.points_mm[mine]
    centre = points.mean(axis=0)
    pixels, mean, sd = normalise_pixels(seen.pixels[mine])
    expected = np.zeros(2)
    if priors is not None and priors.image_size is not None and priors.principal_point_sd is not None:
        expected = ((np.array(priors.image_size) - 1) / 2 - mean) / sd
    rotations, angles = rotation_grid(dof)
    which, shift, misfit = linear_starts(points - centre, pixels, expected, rotations)
    order = np.argsort(misfit, kind="stable")[:_MOST_STARTS]
    which, shift = which[order], shift[order]
    shift = shift - rotations[which] @ centre
    theta, back = seen.cameras[anchor, 0], rotation_y(-seen.cameras[anchor, 0])
    shift = shift @ back.T + seen.cameras[anchor, 1:]
    return start_state(angles[which] - theta if dof == 4 else back @ rotations[which], shift, priors)


def _problem(seen: Observations, h: int, priors: Priors | None, tail_sd: float | None, *, normalised: bool) -> Problem:
    """The same observations for H starts. Normalised pixels make the path, too, independent of the internals."""
    n = len(seen.view)
    group = seen.group[seen.view]
    pixels, weight = seen.pixels, seen.weight
    if normalised:
        pixels, weight = pixels.copy(), 100.0 * weight / weight.max()
        for g in np.unique(group):
            pixels[group == g] = normalise_pixels(pixels[group == g])[0]
    return Problem(
        np.broadcast_to(seen.points_mm, (h, n, 3)),
        np.broadcast_to(pixels, (h, n, 2)),
        np.broadcast_to(weight, (h, n)),
        np.broadcast_to(seen.view, (h, n)),
        seen.cameras,
        np.broadcast_to(group, (h, n)),
        int(seen.group.max()) + 1,
        priors,
        tail_sd if not normalised else None,
    )


def _distinct(state: State, fit: Linearised) -> IntArray:
    """Indices of the valid ones, best first, leaving out those that are the same as a better one."""
    order = np.argsort(fit.cost, kind="stable")
    order = order[fit.valid[order]]
    taken: list[int] = []
    rotation = state.rotation if state.rotation.ndim == 3 else rotation_y(state.rotation)
    for k in order:
        if len(taken) == _MOST_MINIMA:
            break
        if taken:
            chord = np.linalg.norm(rotation[taken] - rotation[k], axis=(1, 2)) / np.sqrt(2.0)
            apart = np.linalg.norm(state.shift[taken] - state.shift[k], axis=1)
            near = (chord < _SAME_ANGLE_RAD) & (apart < _SAME_FRACTION * np.linalg.norm(state.shift[k]))
            if near.any():
                continue
        taken.append(int(k))
    return np.array(taken, dtype=np.int64)
