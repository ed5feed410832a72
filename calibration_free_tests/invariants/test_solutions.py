"""The paper's solve on J and K, and the closed form for a known rotation, from clean corners."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.pose.scenes import GENERAL, INTERNALS, TWO_FACES, WINDOW, picture
from recognition.geometry import Pose4, project
from recognition.jk_solve import solve_invariants
from recognition.pose import estimate_pose
from recognition.rigid import Pose6
from recognition.rotation_known import translation_given_rotation
from rig.errors import DegenerateGeometryError

POSE = Pose4(30.0, 5.0, -8.0, 250.0)


def test_invariants_of_a_clean_view_give_the_pose_back() -> None:
    found = solve_invariants(TWO_FACES, picture(TWO_FACES, POSE), Pose4(20.0, 15.0, 0.0, 300.0))
    assert found.rank == 4
    assert found.pose.theta_deg == pytest.approx(30.0, abs=1e-6)
    np.testing.assert_allclose(found.pose.translation_mm, POSE.translation_mm, atol=1e-6)


def test_five_general_points_give_six_degrees_of_freedom() -> None:
    truth = Pose6.from_angles(25.0, np.array([5.0, -8.0, 150.0]), roll_deg=4.0, pitch_deg=-6.0)
    points = GENERAL[:5]
    pixels = project(points @ truth.rotation.T + truth.translation_mm, INTERNALS)
    found = solve_invariants(points, pixels, Pose6.from_angles(20.0, np.array([0.0, 0.0, 170.0])))
    assert found.rank == 6
    assert isinstance(found.pose, Pose6)
    np.testing.assert_allclose(found.pose.rotation, truth.rotation, atol=1e-7)
    np.testing.assert_allclose(found.pose.translation_mm, truth.translation_mm, atol=1e-6)


def test_a_planar_part_returns_near_its_start_and_says_so() -> None:
    pixels = picture(WINDOW, POSE)
    near, far = (solve_invariants(WINDOW, pixels, Pose4(25.0, 0.0, 0.0, z)) for z in (150.0, 400.0))
    assert near.rank == far.rank == 2
    assert np.abs(near.residual).max() < 1e-9
    assert np.abs(far.residual).max() < 1e-9
    assert abs(near.pose.z_mm - far.pose.z_mm) > 50.0


def test_the_reference_method_and_variable_projection_agree_on_clean_corners() -> None:
    pixels = picture(TWO_FACES, POSE)
    reference = solve_invariants(TWO_FACES, pixels, Pose4(20.0, 15.0, 0.0, 300.0)).pose
    estimate = estimate_pose(TWO_FACES, pixels).pose
    np.testing.assert_allclose(estimate.translation_mm, reference.translation_mm, atol=1e-6)


def test_a_known_rotation_leaves_a_linear_problem() -> None:
    found = translation_given_rotation(GENERAL[:4], picture(GENERAL[:4], POSE), POSE.rotation)
    np.testing.assert_allclose(found.translation_mm, POSE.translation_mm, atol=1e-8)
    np.testing.assert_allclose(found.internals, INTERNALS, atol=1e-6)


@pytest.mark.parametrize("points", [WINDOW, GENERAL[:3]], ids=["coplanar", "three points"])
def test_a_known_rotation_does_not_help_degenerate_points(points: npt.NDArray[np.float64]) -> None:
    with pytest.raises(DegenerateGeometryError):
        translation_given_rotation(points, picture(points, POSE), POSE.rotation)


def test_a_wrong_rotation_that_turns_the_object_round_is_refused() -> None:
    points = TWO_FACES
    with pytest.raises(DegenerateGeometryError):
        translation_given_rotation(points, picture(points, POSE), Pose4.of(210.0, np.zeros(3)).rotation)


def test_too_few_points_for_the_degrees_of_freedom_are_refused() -> None:
    with pytest.raises(DegenerateGeometryError, match="5 points are needed"):
        solve_invariants(GENERAL[:4], picture(GENERAL[:4], POSE), Pose6.from_angles(0.0, np.array([0.0, 0.0, 200.0])))
