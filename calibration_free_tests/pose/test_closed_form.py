"""Closed-form starts: exact on clean corners whatever the internals, in any batch, and told where they cannot be."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.pose.scenes import GENERAL, RECESSED, TWO_FACES, WINDOW, picture
from recognition.closed_form import general_starts, upright_starts
from recognition.geometry import Pose4, project
from recognition.rigid import Pose6
from recognition.varpro import refine_batch

FloatArray = npt.NDArray[np.float64]
TRUE = Pose4(35.0, 12.0, -8.0, 260.0)


@pytest.mark.parametrize("points", [TWO_FACES, GENERAL, RECESSED, TWO_FACES + np.array([4000.0, -300.0, 900.0])])
@pytest.mark.parametrize("internals", [(800, 812, 655, 470), (2500, 1900, -200, 1400)])
def test_clean_corners_give_the_upright_pose_whatever_the_internals(
    points: FloatArray, internals: tuple[float, ...]
) -> None:
    pose = Pose4.of(35.0, np.array([12.0, -8.0, 260.0]) - TRUE.rotation @ points.mean(axis=0))
    found, sound = upright_starts(points[None], picture(points, pose, np.array(internals, dtype=float))[None])
    assert sound.all()
    assert np.degrees(found[0, 0]) == pytest.approx(35.0, abs=1e-6)
    np.testing.assert_allclose(found[0, 1:], pose.translation_mm, atol=1e-4)


@pytest.mark.parametrize("roll_deg", [-170.0, 0.0, 25.0])
def test_clean_corners_give_the_general_pose(roll_deg: float) -> None:
    pose = Pose6.from_angles(-20.0, np.array([3.0, 5.0, 300.0]), roll_deg=roll_deg, pitch_deg=33.0)
    pixels = project(TWO_FACES @ pose.rotation.T + pose.translation_mm, np.array([900.0, 940.0, 500.0, 600.0]))
    rotation, shift, sound = general_starts(TWO_FACES[None], pixels[None])
    assert sound.all()
    np.testing.assert_allclose(rotation[0], pose.rotation, atol=1e-8)
    np.testing.assert_allclose(shift[0], pose.translation_mm, atol=1e-5)


def test_each_set_of_a_batch_is_solved_as_it_is_alone() -> None:
    poses = [TRUE, Pose4(-50.0, 0.0, 9.0, 400.0), Pose4(140.0, -9.0, 0.0, 200.0)]
    points = np.stack([TWO_FACES, TWO_FACES[::-1], TWO_FACES * 0.5])
    pixels = np.stack([picture(p, pose) for p, pose in zip(points, poses, strict=True)])
    together, _ = upright_starts(points, pixels)
    rotation, shift, _ = general_starts(points, pixels)
    for k, pose in enumerate(poses):
        np.testing.assert_allclose(together[k], upright_starts(points[k : k + 1], pixels[k : k + 1])[0][0], atol=1e-7)
        np.testing.assert_allclose(rotation[k], pose.rotation, atol=1e-7)
        np.testing.assert_allclose(shift[k], pose.translation_mm, atol=1e-4)


def test_a_plane_is_told_as_not_sound() -> None:
    rng = np.random.default_rng(4)
    # Slanted: along the axes the solution is exactly zero, here it is rounding errors of any sign.
    slanted = np.vstack([WINDOW, WINDOW + np.array([50.0, 0.0, 0.0])]) @ Pose4(30.0, 0.0, 0.0, 0.0).rotation.T
    plane = np.broadcast_to(slanted, (100, 8, 3))
    pixels = picture(slanted, TRUE) + 0.5 * rng.standard_normal((100, 8, 2))
    found, sound = upright_starts(plane, pixels)
    assert not sound.any()
    np.testing.assert_array_equal(found, 0.0)
    assert not general_starts(plane, pixels)[2].any()


def test_mirrored_corners_are_told_as_not_sound() -> None:
    pixels = picture(TWO_FACES, TRUE) * [-1.0, 1.0] + [1279.0, 0.0]
    assert not upright_starts(TWO_FACES[None], pixels[None])[1][0]
    assert not general_starts(TWO_FACES[None], pixels[None])[2][0]


def test_from_noisy_corners_refinement_ends_in_the_minimum_next_to_the_truth() -> None:
    rng = np.random.default_rng(3)
    truth = np.array([np.radians(TRUE.theta_deg), *TRUE.translation_mm])
    pixels = picture(TWO_FACES, TRUE) + 0.5 * rng.standard_normal((200, 12, 2))
    points, one = np.broadcast_to(TWO_FACES, (200, 12, 3)), np.full((200, 12), 2.0)
    view, cameras, group = np.zeros((200, 12), dtype=np.int64), np.zeros((1, 4)), np.zeros(1, dtype=np.int64)
    start, sound = upright_starts(points, pixels)
    assert sound.all()
    found = refine_batch(start, points, pixels, one, view, cameras, group)
    best = refine_batch(np.tile(truth, (200, 1)), points, pixels, one, view, cameras, group, iterations=50)
    assert found.converged.all()
    np.testing.assert_allclose(found.cost, best.cost, rtol=1e-3)
