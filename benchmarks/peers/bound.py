"""The Cramer-Rao bound of the scenes: how exact any unbiased solver can be, by what it knows of the internals.

The derivatives are taken numerically from the projection itself, so that the bound owes nothing to our estimator.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchmarks.peers.scenes import DRIFT_ASPECT, DRIFT_PX, Scenes, project
from benchmarks.peers.score import Errors, errors
from recognition.motion import rotation_exp

FloatArray = npt.NDArray[np.float64]

UNKNOWN, DRIFT_KNOWN, KNOWN = "unknown", "drift known", "known"
_STEP_RAD, _STEP_MM = 1e-6, 1e-4


def bound(scenes: Scenes, dof: int, internals: str) -> FloatArray:
    """Covariances ``(H, dof, dof)`` of a small rotation (radians; about Y, or about X, Y, Z) and a shift, mm.

    Args:
        scenes: where the truth is.
        dof: 4 or 6.
        internals: ``UNKNOWN``: nothing; ``DRIFT_KNOWN``: Gaussians of the true drift about the nominal camera (a
            Bayesian bound); ``KNOWN``: a perfect calibration of every view.
    """
    axes = np.eye(6)[[1, 3, 4, 5]] if dof == 4 else np.eye(6)
    pose = np.stack([_derivative(scenes, axis) for axis in axes], axis=-1) / scenes.noise_px
    information = np.einsum("hvnca,hvncb->hab", pose, pose)
    if internals == KNOWN:
        return np.linalg.inv(information)
    inner = _inner_derivative(scenes) / scenes.noise_px
    own = np.einsum("hvnca,hvncb->hvab", inner, inner)
    if internals == DRIFT_KNOWN:
        own = own + _drift_information(scenes)
    mixed = np.einsum("hvnca,hvncb->hvab", inner, pose)
    taken = np.einsum("hvab,hvac->hbc", mixed, np.linalg.solve(own, mixed))
    return np.linalg.inv(information - taken)


def sampled(rng: np.random.Generator, scenes: Scenes, covariance: FloatArray) -> Errors:
    """Errors that an unbiased, efficient solver would make: one Gaussian draw a scene."""
    count, dof = covariance.shape[:2]
    draws = np.einsum("hab,hb->ha", np.linalg.cholesky(covariance), rng.standard_normal((count, dof)))
    step = np.zeros((count, 6))
    step[:, [1, 3, 4, 5] if dof == 4 else slice(None)] = draws
    truth = scenes.rotation, scenes.pose[:, 1:]
    return errors(rotation_exp(step[:, :3]) @ truth[0], truth[1] + step[:, 3:], *truth)


def _derivative(scenes: Scenes, axis: FloatArray) -> FloatArray:
    """Pixels ``(H, V, N, 2)`` by radian or millimetre along one axis of rotation and shift."""
    step = np.array([_STEP_RAD] * 3 + [_STEP_MM] * 3) * axis
    sides = []
    for sign in (1.0, -1.0):
        rotation = rotation_exp(sign * step[None, :3]) @ scenes.rotation
        shift = scenes.pose[:, 1:] + sign * step[3:]
        sides.append(project(scenes.points_mm, rotation, shift, scenes.cameras, scenes.internals))
    return np.asarray((sides[0] - sides[1]) / (2.0 * step.sum()))


def _inner_derivative(scenes: Scenes) -> FloatArray:
    """Pixels ``(H, V, N, 2)`` by fx, fy, u0, v0; they are linear in them."""
    columns = []
    for k in range(4):
        unit = np.zeros_like(scenes.internals)
        unit[..., k] = 1.0
        columns.append(project(scenes.points_mm, scenes.rotation, scenes.pose[:, 1:], scenes.cameras, unit))
    return np.stack(columns, axis=-1)


def _drift_information(scenes: Scenes) -> FloatArray:
    """Of fx, fy, u0, v0 ``(H, V, 4, 4)``: fx about the nominal focal length, fy about fx, the centre."""
    fx = scenes.internals[..., 0]
    out = np.zeros((*fx.shape, 4, 4))
    by_aspect = 1.0 / (DRIFT_ASPECT * fx) ** 2
    out[..., 0, 0] = 1.0 / DRIFT_PX**2 + by_aspect
    out[..., 1, 1] = by_aspect
    out[..., 0, 1] = out[..., 1, 0] = -by_aspect
    out[..., 2, 2] = out[..., 3, 3] = 1.0 / DRIFT_PX**2
    return out
