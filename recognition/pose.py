"""Pose of an uncalibrated camera from matched corners: the estimator of design §3, with what it cannot see by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, Pose4
from recognition.motion import cross_matrix
from recognition.observability import NAMES, open_directions, unobservable
from recognition.pose_search import Minima, polish, search
from recognition.pose_start import normalise_pixels
from recognition.priors import Priors
from recognition.projected import mixed_information
from recognition.rigid import Pose6
from recognition.varpro import covariance, start_state
from recognition.views import Observations, View, gather
from rig.errors import DegenerateGeometryError, InputError

FloatArray = npt.NDArray[np.float64]

_RIVAL_COST = 18.0  # -2 log likelihood above the best: beyond this a second minimum is no rival
_MOST_RIVALS = 6
_USUAL_DISTANCE = 6.0  # in radii of the points: which member of an unobservable family stands for it
_FAMILY_COST, _TIE_COST = 1.0, 1e-9  # costs that count as equal, within a family and between separate minima


@dataclass(frozen=True, slots=True)
class Alternative:
    """A second minimum that the views do not exclude: another pose, its residual, its cost above the best one's."""

    pose: Pose4 | Pose6
    residual_px: float
    cost_above: float


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """A pose and how sure it is.

    Attributes:
        pose: points -> camera of the first view, p_cam = R p + t; its ``theta_deg, x_mm, y_mm, z_mm``. ``Pose4`` for
            4 degrees of freedom, ``Pose6`` (with ``rotation``, ``roll_deg``, ``pitch_deg``) for 6.
        covariance: ``(4, 4)`` of theta, x, y, z in [deg, mm, mm, mm], or ``(6, 6)`` of a small rotation about the
            camera's X, Y, Z axes, then x, y, z. Marginal over internals and nuisances, at the given ``sigma_px``. A
            direction on which the views are silent has a huge but finite variance (10^13 times that with all else
            known), so the matrix can be inverted, added and sampled; ``unobservable`` is the place to ask.
        unobservable: directions that the views leave open (sd above 0.5 rad or half the distance), in words, for the
            centre of the points in the first camera's frame; e.g. "x_mm against principal point u0". Empty if none.
        residual_px: root mean square of one residual coordinate.
        alternatives: second minima within -2 log likelihood 18, best first; empty where something is unobservable,
            since there the whole family is.
        internals: ``(V, 4)`` fx, fy, u0, v0 that fit best in each view: a by-product, as unsure as the pose is.
        cost: -2 log of likelihood times priors, up to a constant.
    """

    pose: Pose4 | Pose6
    covariance: FloatArray = field(repr=False)
    unobservable: tuple[str, ...]
    residual_px: float
    alternatives: tuple[Alternative, ...]
    internals: FloatArray = field(repr=False)
    cost: float

    @property
    def sd(self) -> Mapping[str, float]:
        """Standard deviations by name: theta_deg, x_mm, y_mm, z_mm (for 6 DOF also rx_deg, rz_deg)."""
        values = np.sqrt(np.diag(self.covariance))
        return {name: float(v) for name, v in zip(NAMES[len(values)], values, strict=True)}


def estimate_pose(
    points_mm: npt.ArrayLike | None = None,
    pixels: npt.ArrayLike | None = None,
    dof: int = 4,
    priors: Priors | None = None,
    *,
    views: Sequence[View] | None = None,
    sigma_px: float = 0.5,
    start: Pose4 | Pose6 | None = None,
    tail_sd: float | None = None,
) -> PoseEstimate:
    """Estimate where the points are from the camera of the first view. Nothing needs a calibration or a start.

    Args:
        points_mm: ``(n, 3)`` corners of one view in the object frame; or give ``views``.
        pixels: ``(n, 2)`` where they were seen.
        dof: 4 (upright camera: theta, x, y, z) or 6.
        priors: soft knowledge of the camera; ``None``: no priors, the pure invariants.
        views: several views with known moves between them, in place of ``points_mm`` and ``pixels``.
        sigma_px: noise of one corner coordinate, with ``points_mm`` and ``pixels`` (views carry their own).
        start: a pose to start from instead of the search; its minimum is returned, without alternatives.
        tail_sd: corners further off than about so many sd lose their pull; ``None``: least squares.

    Raises:
        InputError: shapes do not match, NaN or infinity, or both or neither of the two ways to pass views.
        DegenerateGeometryError: too few, repeated or collinear points, or no pose that has the points in front of
            the camera and positive focal lengths.
    """
    if (points_mm is None) != (pixels is None) or (points_mm is None) == (views is None):
        raise InputError("pass either points_mm and pixels, or views", where="estimate_pose")
    if views is None:
        views = [View(points_mm, pixels, sigma_px=sigma_px)]  # type: ignore[arg-type]  # ``gather`` makes arrays of them.
    seen = gather(views, dof)
    centre = seen.points_mm.mean(axis=0)
    centred = replace(seen, points_mm=seen.points_mm - centre)
    if start is None:
        minima = search(centred, dof, priors, tail_sd)
    else:
        if isinstance(start, Pose4) != (dof == 4):
            raise InputError(f"the start is a {type(start).__name__}, which does not have {dof} dof", where="start")
        shift = (start.rotation @ centre + start.translation_mm)[None]
        rotation = np.radians([start.theta_deg]) if isinstance(start, Pose4) else start.rotation[None]
        minima = polish(centred, start_state(rotation, shift, priors), priors, tail_sd)
    if minima is None:
        high = np.abs(centred.points_mm[:, 1]).max()
        if dof == 4 and high < 1e-6 * np.abs(centred.points_mm).max():
            raise DegenerateGeometryError(
                "all points lie in one horizontal plane: with a rotation about Y alone, their height trades against fy "
                "and v0. Add a point above or below them"
            )
        raise DegenerateGeometryError(
            "no pose has all points in front of the camera and positive focal lengths: the corners are mirrored, "
            "mismatched, or in another order than the pixels"
        )
    return _estimate(minima, centred, centre, dof)


def _estimate(minima: Minima, seen: Observations, centre: FloatArray, dof: int) -> PoseEstimate:
    names = _open_names(minima, 0, seen, dof)
    best = _most_central(minima, seen, _FAMILY_COST if names else _TIE_COST)
    if best != 0:
        names = _open_names(minima, best, seen, dof)
    cost, counted = minima.fit.cost, 2 * len(seen.view)
    residual = np.sqrt((minima.fit.residuals**2).sum(axis=(1, 2)) / counted)
    rivals = [k for k in range(len(cost)) if k != best and cost[k] <= cost[best] + _RIVAL_COST][:_MOST_RIVALS]
    alternatives = tuple(
        Alternative(_pose(minima, k, centre), float(residual[k]), float(cost[k] - cost[best])) for k in rivals
    )
    return PoseEstimate(
        pose=_pose(minima, best, centre),
        covariance=_covariance_deg_mm(minima, best, centre, dof),
        unobservable=names,
        residual_px=float(residual[best]),
        alternatives=() if names else alternatives,
        internals=minima.fit.internals[best][seen.group],
        cost=float(cost[best]),
    )


def _most_central(minima: Minima, seen: Observations, margin: float) -> int:
    """Of those that fit equally well, the one with principal points amid the corners and at a usual distance.

    Some choice must be made; this one depends on no internals, so the answer is the same for every camera.
    """
    good = np.flatnonzero(minima.fit.cost <= minima.fit.cost[0] + margin)
    radius = float(np.sqrt((seen.points_mm**2).sum(axis=1).mean()))
    off = 0.1 * np.log(np.linalg.norm(minima.state.shift[good], axis=1) / (_USUAL_DISTANCE * radius)) ** 2
    for g in np.unique(seen.group):
        _, mean, sd = normalise_pixels(seen.pixels[seen.group[seen.view] == g])
        off += (((minima.fit.internals[good, g, 2:] - mean) / sd) ** 2).sum(axis=1)
    return int(good[np.argmin(off)])


def _open_names(minima: Minima, k: int, seen: Observations, dof: int) -> tuple[str, ...]:
    at = np.array([k])
    state, fit, problem = minima.state.take(at), minima.fit.take(at), minima.problem.take(at)
    distance = float(np.linalg.norm(state.shift[0]))
    basis = open_directions(covariance(fit.information)[0, :dof, :dof], distance)
    diagonal, mixed = mixed_information(problem, state, fit)
    return unobservable(basis, fit.inner_hessian[0], mixed[0, ..., :dof], diagonal[0, :dof], distance)


def _pose(minima: Minima, k: int, centre: FloatArray) -> Pose4 | Pose6:
    """The pose of the object frame, from that of the centred one."""
    rotation, shift = minima.state.rotation[k], minima.state.shift[k]
    if rotation.ndim == 0:
        turned = Pose4.of(float(np.degrees(rotation)), shift)
        return Pose4.of(turned.theta_deg, shift - turned.rotation @ centre)
    return Pose6(rotation, shift - rotation @ centre)


def _covariance_deg_mm(minima: Minima, k: int, centre: FloatArray, dof: int) -> FloatArray:
    """Marginal covariance of the pose of the object frame: t = shift - R centre moves with the rotation."""
    pose = _pose(minima, k, np.zeros(3))
    change = np.eye(dof)
    by_rotation = cross_matrix(pose.rotation @ centre)
    change[-3:, : dof - 3] = by_rotation if dof == 6 else by_rotation[:, 1:2]
    change[: dof - 3] *= 180.0 / np.pi
    full = covariance(minima.fit.information[k : k + 1])[0, :dof, :dof]
    return np.asarray(change @ full @ change.T)


__all__ = ["Alternative", "CameraPose", "PoseEstimate", "Priors", "View", "estimate_pose"]
