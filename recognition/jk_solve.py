"""The paper's own solve, kept as the reference: least squares on the invariants J and K, from a start."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.geometry import Pose4
from recognition.invariants import choose_triplets, invariants_jacobian, invariants_of_pose, ratio_invariants
from recognition.motion import State
from recognition.rigid import Pose6
from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class InvariantSolution:
    """A pose from invariants.

    Attributes:
        pose: points -> camera.
        residual: ``(m,)`` invariants seen minus predicted, J first, then K.
        rank: numerical rank of the invariants in the pose. Where it is less than the degrees of freedom, the pose is
            one of a family, and mostly wherever the start was (design §3).
    """

    pose: Pose4 | Pose6
    residual: FloatArray = field(repr=False)
    rank: int


def solve_invariants(points_mm: FloatArray, pixels: FloatArray, start: Pose4 | Pose6) -> InvariantSolution:
    """Least squares on the independent J and K that keep the triplet rule.

    Unweighted, as in the paper: it neither knows the noise nor gives a covariance. ``estimate_pose`` does both.

    Args:
        points_mm: ``(n, 3)``; n >= 4 for a ``Pose4`` start, n >= 5 for a ``Pose6``.
        pixels: ``(n, 2)``.
        start: points -> camera; its kind chooses 4 or 6 degrees of freedom.

    Raises:
        DegenerateGeometryError: too few points, or all in one row or column of the picture.
    """
    from scipy.optimize import least_squares  # late: scipy is slow to import

    four = isinstance(start, Pose4)
    n, least = len(points_mm), 4 if four else 5
    if n < least:
        raise DegenerateGeometryError(f"{n} points give {2 * (n - 2)} invariants; {least} points are needed")
    triplets = choose_triplets(pixels[:, 0]), choose_triplets(pixels[:, 1])
    seen = np.concatenate([ratio_invariants(pixels[:, c], triplets[c]) for c in (0, 1)])
    first = _state(start)
    unit = np.array([1.0] * (1 if four else 3) + [max(float(np.abs(start.translation_mm).max()), 1.0)] * 3)

    def misfit(step: FloatArray) -> FloatArray:
        return np.asarray(invariants_of_pose(first.moved((step * unit)[None]), points_mm, *triplets) - seen)

    solution = least_squares(misfit, np.zeros(first.size), method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    state = first.moved((solution.x * unit)[None])
    jacobian = invariants_jacobian(state, points_mm, *triplets)
    return InvariantSolution(_pose(state), -misfit(solution.x), numerical_rank(jacobian))


def numerical_rank(jacobian: FloatArray, tolerance: float = 1e-7) -> int:
    """Rank of a Jacobian whose columns have different units: columns are scaled to length one first."""
    length = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(length > tolerance * length.max(initial=0.0), length, np.inf)
    values = np.linalg.svd(scaled, compute_uv=False)
    return int(np.count_nonzero(values > tolerance * max(float(values.max(initial=0.0)), 1e-300)))


def _state(pose: Pose4 | Pose6) -> State:
    if isinstance(pose, Pose4):
        return State(np.radians([pose.theta_deg]), pose.translation_mm[None])
    return State(pose.rotation[None], pose.translation_mm[None])


def _pose(state: State) -> Pose4 | Pose6:
    if state.rotation.ndim == 1:
        return Pose4.of(float(np.degrees(state.rotation[0])), state.shift[0])
    return Pose6(state.rotation[0], state.shift[0])
