"""Six numbers hold the image of a vertical wall in any upright camera."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.recognition.synthetic import pixels_of
from recognition.geometry import CameraPose
from recognition.wallfit import fit_wall, wall_to_image

FloatArray = npt.NDArray[np.float64]

WINDOW = np.array([[-20, -27.5], [20, -27.5], [20, 27.5], [-20, 27.5]])
ELSEWHERE = np.array([[95.0, 40], [-130, -60], [60, -110], [-75, 140], [0, 0]])


def on_wall(flat: FloatArray) -> FloatArray:
    return np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)


def internals(seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    fx, fy = rng.uniform(300, 3000, 2)
    return np.array([fx, fy, *rng.uniform(-200, 900, 2)])


@given(
    turn_deg=st.floats(-60, 60),
    x_mm=st.floats(-60, 60),
    y_mm=st.floats(-60, 60),
    distance_mm=st.floats(350, 2000),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=60, deadline=None)
def test_one_window_tells_where_all_of_the_wall_is_seen(
    turn_deg: float, x_mm: float, y_mm: float, distance_mm: float, seed: int
) -> None:
    camera = CameraPose(turn_deg, x_mm, y_mm, -distance_mm)
    lens = internals(seed)
    fit = fit_wall(WINDOW[None], pixels_of(on_wall(WINDOW), camera, lens)[None], np.array([0.5]))
    predicted, depth = wall_to_image(fit.numbers[:, None], ELSEWHERE[None])
    expected = pixels_of(on_wall(ELSEWHERE), camera, lens)
    scale = np.ptp(pixels_of(on_wall(WINDOW), camera, lens), axis=0).max()
    assert fit.rms_px[0] < 1e-5 * scale
    assert np.abs(predicted[0] - expected).max() < 1e-3 * scale
    assert (depth > 0).all()


def test_depth_is_relative_to_the_middle_of_the_part() -> None:
    camera, lens = CameraPose(30.0, 10.0, 5.0, -500.0), internals(3)
    fit = fit_wall(WINDOW[None], pixels_of(on_wall(WINDOW), camera, lens)[None], np.array([0.5]))
    _, depth = wall_to_image(fit.numbers[:, None], ELSEWHERE[None])
    z = (on_wall(ELSEWHERE) - camera.centre_mm) @ camera.to_camera().rotation[2]
    middle = -camera.centre_mm @ camera.to_camera().rotation[2]
    assert np.allclose(depth[0], z / middle, rtol=1e-4)


def test_points_behind_the_camera_have_negative_depth() -> None:
    camera = CameraPose(60.0, 0.0, 0.0, -300.0)
    fit = fit_wall(WINDOW[None], pixels_of(on_wall(WINDOW), camera)[None], np.array([0.5]))
    _, depth = wall_to_image(fit.numbers[:, None], np.array([[[2000.0, 0], [-2000.0, 0]]]))
    assert sorted(np.sign(depth[0])) == [-1, 1]


def test_repeated_corners_do_no_harm() -> None:
    px = pixels_of(on_wall(WINDOW), CameraPose(25.0, 30.0, 10.0, -400.0))
    padded = fit_wall(
        np.concatenate([WINDOW, WINDOW[[-1, -1]]])[None], np.concatenate([px, px[[-1, -1]]])[None], np.array([0.5])
    )
    assert np.allclose(padded.numbers, fit_wall(WINDOW[None], px[None], np.array([0.5])).numbers, rtol=1e-4)


def test_what_no_upright_camera_could_see_has_a_residual() -> None:
    px = pixels_of(on_wall(WINDOW), CameraPose(25.0, 30.0, 10.0, -400.0))
    tilt = np.radians(20.0)
    turned = px @ np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    assert fit_wall(WINDOW[None], turned[None], np.array([0.5])).rms_px[0] > 2.0


@pytest.mark.parametrize("turn_deg", [0.0, 20.0, 45.0])
def test_the_spread_of_the_perspective_term_is_as_said(turn_deg: float) -> None:
    rng = np.random.default_rng(5)
    px = pixels_of(on_wall(WINDOW), CameraPose(turn_deg, 0.0, 0.0, -300.0))
    sigma = 0.3
    noisy = px + rng.normal(0, sigma, (4000, 4, 2))
    fit = fit_wall(np.tile(WINDOW, (4000, 1, 1)), noisy, np.full(4000, sigma))
    assert np.std(fit.numbers[:, 2]) == pytest.approx(float(np.median(fit.c_sd)), rel=0.2)
