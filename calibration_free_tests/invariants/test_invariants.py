"""J and K depend on no internals, come in independent sets, and have the ranks of design §3."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.pose.scenes import GENERAL, INTERNALS, RECESSED, TWO_FACES, WINDOW
from recognition.geometry import Pose4, project
from recognition.invariants import SMALL, choose_triplets, invariants_jacobian, ratio_gradient, ratio_invariants
from recognition.jk_solve import numerical_rank
from recognition.motion import State
from recognition.rigid import Pose6
from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]
SHIFT = np.array([5.0, -8.0, 250.0])
GRID = np.array([[x, y + 0.1 * x, 0.0] for x in (-20.0, -3.0, 11.0, 25.0) for y in (-15.0, 4.0, 18.0)])


def state(theta_deg: float | None) -> tuple[State, FloatArray]:
    """A 4-DOF state at that pan, or a tilted 6-DOF one for ``None``, and its rotation."""
    if theta_deg is None:
        rotation = Pose6.from_angles(25.0, SHIFT, roll_deg=4.0, pitch_deg=-6.0).rotation
        return State(rotation[None], SHIFT[None]), rotation
    rotation = Pose4.of(theta_deg, SHIFT).rotation
    return State(np.radians([theta_deg]), SHIFT[None]), rotation


def rank(points_mm: FloatArray, theta_deg: float | None) -> int:
    at, rotation = state(theta_deg)
    pixels = project(points_mm @ rotation.T + SHIFT, INTERNALS)
    triplets = choose_triplets(pixels[:, 0]), choose_triplets(pixels[:, 1])
    return numerical_rank(invariants_jacobian(at, points_mm, *triplets))


@pytest.mark.parametrize("points", [WINDOW, GRID], ids=["one window", "many coplanar points"])
def test_coplanar_points_fix_two_of_four_numbers_and_one_head_on(points: FloatArray) -> None:
    assert rank(points, 30.0) == 2
    assert rank(points, 0.0) == 1
    assert rank(points, None) == 4


@pytest.mark.parametrize("points", [RECESSED, TWO_FACES], ids=["recessed pane", "perpendicular faces"])
def test_points_off_the_plane_fix_the_whole_pose(points: FloatArray) -> None:
    assert rank(points, 30.0) == 4
    assert rank(points, None) == 6


def test_general_points_fix_the_pose_with_four_and_with_five() -> None:
    assert rank(GENERAL[:4], 30.0) == 4
    assert rank(GENERAL[:4], None) == 4  # 2 (n - 2) invariants are too few for six
    assert rank(GENERAL[:5], None) == 6


@settings(max_examples=60, deadline=None)
@given(f=st.floats(50, 20000), c=st.floats(-3000, 3000), seed=st.integers(0, 1000))
def test_invariants_ignore_focal_length_and_principal_point(f: float, c: float, seed: int) -> None:
    x = np.random.default_rng(seed).normal(size=8)
    triplets = choose_triplets(x)
    np.testing.assert_allclose(ratio_invariants(f * x + c, triplets), ratio_invariants(x, triplets), rtol=1e-7)


@settings(max_examples=60, deadline=None)
@given(n=st.integers(3, 14), seed=st.integers(0, 1000))
def test_triplets_are_independent_and_keep_the_rule(n: int, seed: int) -> None:
    u = np.random.default_rng(seed).uniform(0, 1000, n)
    triplets = choose_triplets(u)
    assert np.linalg.matrix_rank(ratio_gradient(u, triplets)) == n - 2
    i, j, k = triplets.T
    small = np.minimum(abs(u[i] - u[j]), abs(u[i] - u[k]))
    assert np.count_nonzero(small < SMALL * np.ptp(u)) <= max(n - 4, 0)  # a close pair may have no better triplet


def test_triplets_are_independent_where_points_stand_above_each_other() -> None:
    u = np.array([100.0, 100.0, 400.0, 400.0, 700.0, 700.0])
    assert np.linalg.matrix_rank(ratio_gradient(u, choose_triplets(u))) == 4


def test_the_gradient_is_the_derivative() -> None:
    u = np.array([3.0, 170.0, 420.0, 66.0])
    triplets = choose_triplets(u)
    step = 1e-4 * np.eye(4)
    numeric = [(ratio_invariants(u + s, triplets) - ratio_invariants(u - s, triplets)) / 2e-4 for s in step]
    np.testing.assert_allclose(ratio_gradient(u, triplets), np.stack(numeric, axis=1), atol=1e-8)


@pytest.mark.parametrize("u", [[], [1.0, 2.0], [5.0, 5.0, 5.0]])
def test_too_few_different_points_have_no_invariants(u: list[float]) -> None:
    with pytest.raises(DegenerateGeometryError):
        choose_triplets(np.array(u))
