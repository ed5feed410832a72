"""Bundle adjustment with known moves: where points of the target fall in the pictures, and steps to a better fit.

Shape legend: M observations, N points, V views, C = 10 common unknowns, S = C + 4 V shared unknowns (C alone where the
moves are taken as exact). The common unknowns are log fx, log fy/fx, u0, v0, k (one radial term), then the mount's
arm_x, arm_z (mm), pan zero, roll, pitch (radians). Each view's own four are what its pose as told is off by: theta, x,
y, z.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.alignment.moves import Moves
from recognition.alignment.tracks import Tracks
from recognition.geometry import Mount, rotation_y

FloatArray = npt.NDArray[np.float64]

C = 10
LOG_F, LOG_ASPECT, U0, V0, RADIAL, ARM_X, ARM_Z, PAN, ROLL, PITCH = range(C)


@dataclass(frozen=True, slots=True)
class Unknowns:
    """What is estimated: ``common`` (C,), ``motion`` (V, 4) theta, x, y, z in radians and mm, ``points`` (N, 3) mm."""

    common: FloatArray
    motion: FloatArray
    points: FloatArray = field(repr=False)


@dataclass(frozen=True, slots=True)
class Priors:
    """Gaussians on the unknowns, wide where nothing is known.

    Attributes:
        mean, sd: ``(C,)`` of the common unknowns.
        motion_sd: ``(4,)`` theta, x, y, z of a view, radians and mm; all zero: the moves are exact.
        anchors: ``(N, 3)`` about where the points are; anchor_sd_mm: how unsure that is.
    """

    mean: FloatArray
    sd: FloatArray
    motion_sd: FloatArray
    anchors: FloatArray = field(repr=False)
    anchor_sd_mm: float

    @property
    def exact_moves(self) -> bool:
        """The moves are not estimated."""
        return not self.motion_sd.any()


@dataclass(frozen=True, slots=True)
class Linear:
    """The problem at some unknowns: pixels and their derivatives, all in standard deviations.

    ``residuals`` (M, 2), ``by_common`` (M, 2, C), ``by_motion`` (M, 2, 4), ``by_point`` (M, 2, 3), ``depth`` (M,) mm.
    """

    residuals: FloatArray
    by_common: FloatArray
    by_motion: FloatArray
    by_point: FloatArray
    depth: FloatArray


def linearise(unknowns: Unknowns, tracks: Tracks, moves: Moves) -> Linear:
    """Seen minus predicted pixels, and minus their derivatives' sign: derivatives are those of the prediction."""
    common, at = unknowns.common, moves.table + unknowns.motion
    f, k = focal(common), common[RADIAL]
    pan = rotation_y(at[:, 0])[tracks.view]
    tilt = Mount(roll_deg=np.degrees(common[ROLL]), pitch_deg=np.degrees(common[PITCH])).tilt
    zero, pitch = rotation_y(common[PAN]), Mount(pitch_deg=np.degrees(common[PITCH])).tilt
    hung = tilt @ zero
    turned = np.einsum("mij,mj->mi", pan, unknowns.points[tracks.point] - at[tracks.view, 1:])
    upright = (turned - [common[ARM_X], 0.0, common[ARM_Z]]) @ zero.T
    cam = upright @ tilt.T
    by_point = hung @ pan
    nothing = np.zeros(len(cam))
    rolled = cam @ pitch
    by_common = np.stack(
        [
            -np.broadcast_to(hung[:, 0], cam.shape),
            -np.broadcast_to(hung[:, 2], cam.shape),
            _about_y(upright) @ tilt.T,
            np.stack([-rolled[:, 1], rolled[:, 0], nothing], axis=1) @ pitch.T,
            np.stack([nothing, -cam[:, 2], cam[:, 1]], axis=1),
        ],
        axis=2,
    )
    by_motion = np.concatenate([(_about_y(turned) @ hung.T)[:, :, None], -by_point], axis=2)
    depth = cam[:, 2]
    safe = np.where(np.abs(depth) < 1e-6, 1e-6, depth)
    flat = cam[:, :2] / safe[:, None]
    radius2 = (flat**2).sum(axis=1)
    bent = flat * (1.0 + k * radius2)[:, None]
    # d flat / d cam, then d bent / d flat = (1 + k r^2) I + 2 k flat flat^T, then the focal lengths.
    by_cam = np.zeros((len(cam), 2, 3))
    by_cam[:, 0, 0] = by_cam[:, 1, 1] = 1.0 / safe
    by_cam[:, :, 2] = -flat / safe[:, None]
    bend = (1.0 + k * radius2)[:, None, None] * np.eye(2) + 2.0 * k * flat[:, :, None] * flat[:, None, :]
    by_cam = f[:, None] * (bend @ by_cam)
    inside = np.zeros((len(cam), 2, 5))
    inside[:, :, LOG_F] = bent * f
    inside[:, 1, LOG_ASPECT] = bent[:, 1] * f[1]
    inside[:, 0, U0] = inside[:, 1, V0] = 1.0
    inside[:, :, RADIAL] = f * flat * radius2[:, None]
    predicted = bent * f + common[[U0, V0]]
    return Linear(
        tracks.pixels - predicted,
        np.concatenate([inside, by_cam @ by_common], axis=2),
        by_cam @ by_motion,
        by_cam @ by_point,
        depth,
    )


def focal(common: FloatArray) -> FloatArray:
    """``(2,)`` fx, fy."""
    return np.exp([common[LOG_F], common[LOG_F] + common[LOG_ASPECT]])


def _about_y(vectors: FloatArray) -> FloatArray:
    """e_y x v: the derivative of Ry(theta) v in theta, v being turned already."""
    return np.stack([vectors[:, 2], np.zeros(len(vectors)), -vectors[:, 0]], axis=1)


@dataclass(frozen=True, slots=True)
class Reduced:
    """Normal equations of the shared unknowns, in units of their priors' sd, with the points eliminated.

    ``information`` (S, S) and ``gradient`` (S,) with the priors; the rest serves to find the points' step.
    """

    information: FloatArray
    gradient: FloatArray
    own: FloatArray
    own_gradient: FloatArray
    mixed: FloatArray
    influence: FloatArray


def shared_sd(priors: Priors, views: int) -> FloatArray:
    """``(S,)`` prior sd of the shared unknowns."""
    return priors.sd if priors.exact_moves else np.concatenate([priors.sd, np.tile(priors.motion_sd, views)])


def reduce(
    linear: Linear, weight: FloatArray, unknowns: Unknowns, tracks: Tracks, priors: Priors, damping: float = 0.0
) -> Reduced:
    """Eliminate the points (Schur complement). ``weight`` (M,) is 1 / sd of an observation, loss of pull included."""
    n, v = len(unknowns.points), len(unknowns.motion)
    sd = shared_sd(priors, v)
    s = len(sd)
    w = weight[:, None, None]
    r, jc, jp = linear.residuals * weight[:, None], linear.by_common * w * priors.sd, linear.by_point * w
    first = np.searchsorted(tracks.point, np.arange(n))

    def per_point(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, first, axis=0))

    own = per_point(jp.transpose(0, 2, 1) @ jp) + np.eye(3) / priors.anchor_sd_mm**2
    own_gradient = (
        per_point(np.einsum("mki,mk->mi", jp, r)) - (unknowns.points - priors.anchors) / priors.anchor_sd_mm**2
    )
    mixed = np.zeros((n, 3, s))
    mixed[:, :, :C] = per_point(jp.transpose(0, 2, 1) @ jc)
    shared = np.zeros((n, s))
    shared[:, :C] = per_point(np.einsum("mki,mk->mi", jc, r))
    information = np.zeros((s, s))
    information[:C, :C] = np.einsum("mki,mkj->ij", jc, jc)
    if s > C:
        jm = linear.by_motion * w * priors.motion_sd
        # A point is seen once in a view, so each cell gets one observation.
        cells, pulls = np.zeros((n, 3, v, 4)), np.zeros((n, v, 4))
        cells[tracks.point, :, tracks.view] = jp.transpose(0, 2, 1) @ jm
        pulls[tracks.point, tracks.view] = np.einsum("mki,mk->mi", jm, r)
        mixed[:, :, C:], shared[:, C:] = cells.reshape(n, 3, -1), pulls.reshape(n, -1)
        for view in range(v):
            here, span = tracks.view == view, slice(C + 4 * view, C + 4 * view + 4)
            information[span, span] = np.einsum("mki,mkj->ij", jm[here], jm[here])
            information[:C, span] = np.einsum("mki,mkj->ij", jc[here], jm[here])
            information[span, :C] = information[:C, span].T
    own = own + damping * own * np.eye(3)
    solved = np.linalg.solve(own, np.concatenate([mixed, own_gradient[:, :, None]], axis=2))
    influence = shared - np.einsum("nis,ni->ns", mixed, solved[:, :, -1])
    information -= mixed.reshape(-1, s).T @ solved[:, :, :-1].reshape(-1, s)
    return Reduced(
        information + np.eye(s), influence.sum(axis=0) - _off(unknowns, priors), own, own_gradient, mixed, influence
    )


def _off(unknowns: Unknowns, priors: Priors) -> FloatArray:
    """``(S,)`` shared unknowns less their prior means, in sd."""
    common = (unknowns.common - priors.mean) / priors.sd
    return common if priors.exact_moves else np.concatenate([common, (unknowns.motion / priors.motion_sd).ravel()])


def step(unknowns: Unknowns, reduced: Reduced, priors: Priors, damping: float) -> Unknowns:
    """The unknowns after one damped Gauss-Newton step."""
    s = len(reduced.gradient)
    information = reduced.information + damping * np.diag(np.diag(reduced.information))
    shared = np.linalg.solve(information, reduced.gradient)
    own = np.linalg.solve(reduced.own, (reduced.own_gradient - reduced.mixed @ shared)[:, :, None])[:, :, 0]
    moved = shared * shared_sd(priors, len(unknowns.motion))
    motion = unknowns.motion if s == C else unknowns.motion + moved[C:].reshape(-1, 4)
    return Unknowns(unknowns.common + moved[:C], motion, unknowns.points + own)


def cost(linear: Linear, unknowns: Unknowns, priors: Priors, sigma_px: float, tail_sd: float) -> float:
    """-2 log of likelihood (two-dimensional Cauchy-like tails from ``tail_sd`` on) times priors, up to a constant."""
    if not (np.all(np.isfinite(linear.residuals)) and np.all(linear.depth > 0)):
        return float("inf")
    square = (linear.residuals**2).sum(axis=1) / sigma_px**2
    far = ((unknowns.points - priors.anchors) ** 2).sum() / priors.anchor_sd_mm**2
    return float(tail_sd**2 * np.log1p(square / tail_sd**2).sum() + (_off(unknowns, priors) ** 2).sum() + far)


def pull(linear: Linear, sigma_px: float, tail_sd: float) -> FloatArray:
    """``(M,)`` 1 / sd of each observation, less for those far off: the weights of the tails in ``cost``."""
    square = (linear.residuals**2).sum(axis=1) / sigma_px**2
    return np.asarray(1.0 / (sigma_px * np.sqrt(1.0 + square / tail_sd**2)))


def adjust(
    unknowns: Unknowns,
    tracks: Tracks,
    moves: Moves,
    priors: Priors,
    *,
    sigma_px: float,
    tail_sd: float,
    iterations: int,
) -> tuple[Unknowns, Linear, float]:
    """Levenberg-Marquardt: the fitted unknowns, the problem there, and its cost (`inf` for an impossible start)."""
    linear = linearise(unknowns, tracks, moves)
    best = cost(linear, unknowns, priors, sigma_px, tail_sd)
    damping = 1e-3
    for _ in range(iterations):
        if not np.isfinite(best) or damping > 1e8:
            break
        reduced = reduce(linear, pull(linear, sigma_px, tail_sd), unknowns, tracks, priors, damping)
        trial = step(unknowns, reduced, priors, damping)
        there = linearise(trial, tracks, moves)
        value = cost(there, trial, priors, sigma_px, tail_sd)
        if value < best:
            gain, unknowns, linear, best, damping = best - value, trial, there, value, max(damping * 0.2, 1e-9)
            if gain < 1e-4:
                break
        else:
            damping *= 5.0
    return unknowns, linear, best


def keep(unknowns: Unknowns, priors: Priors, left: npt.NDArray[np.int64]) -> tuple[Unknowns, Priors]:
    """The same with some of the points only."""
    return replace(unknowns, points=unknowns.points[left]), replace(priors, anchors=priors.anchors[left])
