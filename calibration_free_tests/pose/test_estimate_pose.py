"""``estimate_pose``: the same for every camera, honest about what it cannot see, loud about nonsense."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import recognition
from calibration_free_tests.pose.scenes import GENERAL, INTERNALS, RECESSED, SIZE, TWO_FACES, WINDOW, picture
from recognition import Priors, View, estimate_pose
from recognition.geometry import CameraPose, Pose4, project, rotation_y
from recognition.rigid import Pose6
from rig.errors import DegenerateGeometryError, InputError

FloatArray = npt.NDArray[np.float64]
POSE = Pose4(30.0, 5.0, -8.0, 250.0)
POSE6 = Pose6.from_angles(25.0, np.array([5.0, -8.0, 250.0]), roll_deg=14.0, pitch_deg=-20.0)


def picture6(points_mm: FloatArray, pose: Pose6, internals: FloatArray = INTERNALS) -> FloatArray:
    return project(points_mm @ pose.rotation.T + pose.translation_mm, internals)


@settings(max_examples=25, deadline=None)
@given(
    fx=st.floats(100, 10000),
    aspect=st.floats(0.5, 2.0),
    u0=st.floats(-2000, 3000),
    v0=st.floats(-2000, 3000),
    theta=st.floats(-70, 70),
    z=st.floats(180, 700),
)
def test_the_estimate_ignores_all_four_internals(
    fx: float, aspect: float, u0: float, v0: float, theta: float, z: float
) -> None:
    pose = Pose4(theta, 10.0, -5.0, z)
    internals = np.array([fx, fx * aspect, u0, v0])
    found, plain = estimate_pose(TWO_FACES, picture(TWO_FACES, pose, internals)), picture(TWO_FACES, pose)
    same = estimate_pose(TWO_FACES, plain).pose
    assert found.pose.theta_deg == pytest.approx(same.theta_deg, abs=1e-6)
    np.testing.assert_allclose(found.pose.translation_mm, same.translation_mm, atol=1e-6)
    np.testing.assert_allclose(found.pose.translation_mm, pose.translation_mm, atol=1e-6)
    np.testing.assert_allclose(found.internals[0], internals, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("points", [RECESSED, TWO_FACES, GENERAL, GENERAL[:5]])
def test_six_degrees_of_freedom_from_clean_corners(points: FloatArray) -> None:
    for internals in (INTERNALS, np.array([3000.0, 2000.0, -500.0, 1500.0])):
        found = estimate_pose(points, picture6(points, POSE6, internals), dof=6)
        poses = [found.pose, *(a.pose for a in found.alternatives)]
        assert any(np.allclose(p.translation_mm, POSE6.translation_mm, atol=1e-6) for p in poses)
        assert found.residual_px < 1e-8
        assert found.covariance.shape == (6, 6)


def test_six_degrees_of_freedom_find_a_camera_that_hangs_upside_down() -> None:
    pose = Pose6.from_angles(-20.0, np.array([0.0, 10.0, 200.0]), roll_deg=10.0, pitch_deg=170.0)
    found = estimate_pose(TWO_FACES, picture6(TWO_FACES, pose), dof=6).pose
    np.testing.assert_allclose(found.translation_mm, pose.translation_mm, atol=1e-6)


def test_a_planar_part_without_priors_says_what_it_cannot_see() -> None:
    found = estimate_pose(WINDOW, picture(WINDOW, POSE))
    assert found.residual_px < 1e-6
    assert any(name.startswith("x_mm against") and "principal point u0" in name for name in found.unobservable)
    assert any(
        name.startswith("z_mm against") and "theta_deg" in name and "focal length" in name
        for name in found.unobservable
    )
    assert len(found.unobservable) == 2
    assert found.sd["x_mm"] > 1e3
    assert found.sd["y_mm"] < 10.0


def test_a_planar_part_seen_head_on_leaves_three_directions_open() -> None:
    found = estimate_pose(WINDOW, picture(WINDOW, Pose4(0.0, 5.0, -8.0, 250.0)))
    assert len(found.unobservable) == 3
    assert any("principal point v0" in name for name in found.unobservable)


def test_soft_priors_close_a_planar_part() -> None:
    found = estimate_pose(WINDOW, picture(WINDOW, Pose4(30.0, 5.0, -8.0, 150.0)), priors=Priors(image_size=SIZE))
    assert found.unobservable == ()
    assert 5.0 < found.sd["z_mm"] < 80.0
    assert 1.0 < found.sd["theta_deg"] < 6.0


def test_points_off_the_plane_leave_nothing_open() -> None:
    for points in (RECESSED, TWO_FACES):
        assert estimate_pose(points, picture(points, POSE)).unobservable == ()


def moved_views(points: FloatArray, pose: Pose4, internals: list[FloatArray], group: str | None) -> list[View]:
    """Three views from known places; ``pose`` is points -> camera of the first."""
    cameras = [CameraPose(3.0, 10, 20, 30), CameraPose(-12.0, 70, 20, 35), CameraPose(14.0, -60, 15, 20)]
    placement = cameras[0].to_camera().inverse() @ pose
    return [
        View(points, picture(points, camera.to_camera() @ placement, k), camera, group)
        for camera, k in zip(cameras, internals, strict=False)
    ]


def test_known_moves_with_locked_zoom_make_a_planar_part_observable() -> None:
    found = estimate_pose(views=moved_views(WINDOW, POSE, [INTERNALS] * 3, "locked"))
    assert found.unobservable == ()
    assert found.pose.theta_deg == pytest.approx(30.0, abs=1e-6)
    np.testing.assert_allclose(found.pose.translation_mm, POSE.translation_mm, atol=1e-6)


def test_known_moves_with_free_zoom_give_the_pose_of_the_first_view() -> None:
    zooms = [INTERNALS, INTERNALS * 1.7, np.array([400.0, 402.0, 640.0, 500.0])]
    found = estimate_pose(views=moved_views(TWO_FACES, POSE, zooms, None))
    np.testing.assert_allclose(found.pose.translation_mm, POSE.translation_mm, atol=1e-6)
    np.testing.assert_allclose(found.internals, zooms, rtol=1e-5)


def test_six_degrees_of_freedom_take_several_views() -> None:
    cameras = [CameraPose(0.0, 0, 0, 0), CameraPose(10.0, 50, 0, 0)]
    views = []
    for camera in cameras:
        world = TWO_FACES @ POSE6.rotation.T + POSE6.translation_mm
        seen = (world - camera.centre_mm) @ rotation_y(np.radians(camera.theta_deg)).T
        views.append(View(TWO_FACES, project(seen, INTERNALS), camera, "locked"))
    found = estimate_pose(views=views, dof=6)
    np.testing.assert_allclose(found.pose.translation_mm, POSE6.translation_mm, atol=1e-6)


def test_the_pose_is_that_of_the_frame_in_which_the_points_are_given(rng: np.random.Generator) -> None:
    far = np.array([900.0, -300.0, 400.0])
    pixels = picture(TWO_FACES, POSE) + 0.3 * rng.standard_normal((12, 2))
    here, there = estimate_pose(TWO_FACES, pixels), estimate_pose(TWO_FACES + far, pixels)
    moved = POSE.rotation @ far
    np.testing.assert_allclose(there.pose.theta_deg, here.pose.theta_deg, atol=1e-6)
    np.testing.assert_allclose(
        there.pose.translation_mm, here.pose.translation_mm - here.pose.rotation @ far, atol=1e-6
    )
    # The same uncertainty, seen from an origin far away: the pan's error swings it.
    swing = np.eye(4)
    swing[1:, 0] = np.radians(1.0) * np.cross(moved, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(there.covariance, swing @ here.covariance @ swing.T, rtol=0.05, atol=0.5)


def test_second_minima_are_reported() -> None:
    # Four points in general position: as many invariants as unknowns, and two poses that explain them exactly.
    found = estimate_pose(GENERAL[:4], picture(GENERAL[:4], Pose4(30.0, 5.0, -8.0, 150.0)))
    assert found.residual_px < 1e-8
    assert len(found.alternatives) >= 1
    poses = np.array([p.translation_mm for p in [found.pose, *(a.pose for a in found.alternatives)]])
    assert np.abs(poses - [5.0, -8.0, 150.0]).max(axis=1).min() < 1e-6


def test_a_mirrored_picture_is_refused_or_does_not_fit() -> None:
    pixels = picture(TWO_FACES, POSE) * [-1.0, 1.0]
    try:
        found = estimate_pose(TWO_FACES, pixels)
    except DegenerateGeometryError:
        return
    assert found.residual_px > 2.0


def test_nuisances_take_up_a_tilted_mount_and_a_bent_lens() -> None:
    tilted = Pose6.from_angles(30.0, np.array([5.0, -8.0, 250.0]), roll_deg=0.6, pitch_deg=-0.5)
    seen = TWO_FACES @ tilted.rotation.T + tilted.translation_mm
    radius = (seen[:, :2] ** 2).sum(axis=1) / seen[:, 2] ** 2
    bent = np.column_stack([seen[:, :2] / seen[:, 2:] * (1 - 0.1 * radius[:, None]), np.ones(len(seen))])
    pixels = project(bent, INTERNALS)
    plain = estimate_pose(TWO_FACES, pixels, priors=Priors(image_size=SIZE), sigma_px=0.1)
    carried = Priors(image_size=SIZE, tilt_sd_deg=0.5, radial_sd=0.1)
    found = estimate_pose(TWO_FACES, pixels, priors=carried, sigma_px=0.1)
    assert found.residual_px < 0.3 * plain.residual_px
    assert abs(found.pose.theta_deg - 30.0) < abs(plain.pose.theta_deg - 30.0)
    assert np.all(np.diag(found.covariance) > np.diag(plain.covariance))


DEGENERATE: dict[str, tuple[FloatArray, str]] = {
    "three points": (GENERAL[:3], "too few"),
    "repeated": (GENERAL[[0, 1, 2, 3, 1]], "repeated"),
    "collinear": (np.outer(np.arange(6.0), [1.0, 2.0, 0.5]), "collinear"),
    "all but one collinear": (np.vstack([np.outer(np.arange(5.0), [1.0, 2.0, 0.5]), [[3.0, -5.0, 2.0]]]), "collinear"),
}


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("dof", [4, 6])
def test_degenerate_points_are_refused_with_the_reason(name: str, dof: int) -> None:
    points, reason = DEGENERATE[name]
    with pytest.raises(DegenerateGeometryError, match=reason):
        estimate_pose(points, picture(points, POSE), dof=dof)


def test_points_of_one_height_are_refused_with_the_reason() -> None:
    level = GENERAL * [1.0, 0.0, 1.0]
    with pytest.raises(DegenerateGeometryError, match="one horizontal plane"):
        estimate_pose(level, picture(level, POSE))


def test_a_part_seen_edge_on_is_refused() -> None:
    pixels = picture(WINDOW, POSE)
    pixels[:, 0] = 600.0
    with pytest.raises(DegenerateGeometryError, match="edge-on"):
        estimate_pose(WINDOW, pixels)


def test_points_behind_the_camera_cannot_be_the_answer() -> None:
    found = estimate_pose(TWO_FACES, picture(TWO_FACES, POSE))
    poses = [found.pose, *(a.pose for a in found.alternatives)]
    for pose in poses:
        assert np.all((TWO_FACES @ pose.rotation.T + pose.translation_mm)[:, 2] > 0)
    assert np.all(found.internals[:, :2] > 0)


@pytest.mark.parametrize(
    ("points", "pixels", "reason"),
    [
        (np.full((5, 3), np.nan), np.zeros((5, 2)), "not finite"),
        (GENERAL, np.full((6, 2), np.inf), "not finite"),
        (GENERAL, np.zeros((5, 2)), r"shape \(6, 2\)"),
        (GENERAL[:, :2], np.zeros((6, 2)), r"shape \(n, 3\)"),
        (GENERAL, None, "either"),
        (None, None, "either"),
        ([["a", "b", "c"]], [[0, 0]], "numbers"),
    ],
)
def test_wrong_shapes_and_numbers_are_refused(points: Any, pixels: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        estimate_pose(points, pixels)


def test_degrees_of_freedom_other_than_four_and_six_are_refused() -> None:
    with pytest.raises(InputError, match="4 or 6"):
        estimate_pose(GENERAL, picture(GENERAL, POSE), dof=5)


@pytest.mark.parametrize("field", ["aspect_sd", "principal_point_sd", "tilt_sd_deg", "radial_sd"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_priors_refuse_impossible_widths(field: str, value: float) -> None:
    with pytest.raises(InputError, match="positive"):
        replace(Priors(), **{field: value})


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_any_clean_view_of_general_points_is_explained_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-50, 50, (8, 3))
    pose = Pose4.of(rng.uniform(-180, 180), np.array([*rng.uniform(-20, 20, 2), rng.uniform(200, 600)]))
    assume(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] > 15)
    found = estimate_pose(points, picture(points, pose))
    np.testing.assert_allclose(found.pose.translation_mm, pose.translation_mm, atol=1e-6)


def test_nothing_here_asks_for_a_calibration() -> None:
    from recognition import invariants, jk_solve, pose, rotation_known, varpro

    banned = {"k", "camera_matrix", "intrinsics", "internals", "focal", "calibration", "dist_coeffs"}
    for module in (recognition.pose, invariants, jk_solve, pose, rotation_known, varpro):
        for name, function in inspect.getmembers(module, inspect.isfunction):
            if function.__module__ != module.__name__ or name.startswith("_"):
                continue
            required = {p.name.lower() for p in inspect.signature(function).parameters.values() if p.default is p.empty}
            assert not required & banned, f"{module.__name__}.{name} requires {required & banned}"
    assert not banned & {name.lower() for name in View.__dataclass_fields__}
