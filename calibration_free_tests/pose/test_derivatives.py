"""Every derivative that the estimator relies on is the derivative of what it claims to be."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.pose.scenes import TWO_FACES
from recognition.internals import add_priors, prior_cost, solve_pairs
from recognition.motion import State, normalise
from recognition.priors import Priors
from recognition.rigid import Pose6

FloatArray = npt.NDArray[np.float64]
CAMERAS = np.array([[0.0, 0, 0, 0], [0.2, -40, 5, 10]])
VIEW = np.array([[0, 1] * 6])
SHIFT = np.array([[5.0, -8.0, 250.0]])
ROTATION = Pose6.from_angles(25.0, SHIFT[0], roll_deg=14.0, pitch_deg=-20.0).rotation[None]
STATES = {
    "upright": State(np.array([0.5]), SHIFT),
    "upright, tilted mount": State(np.array([0.5]), SHIFT, np.array([[0.1, -0.2]])),
    "upright, tilted mount, bent lens": State(np.array([0.5]), SHIFT, np.array([[0.1, -0.2]]), np.array([-0.3])),
    "free": State(ROTATION, SHIFT),
    "free, bent lens": State(ROTATION, SHIFT, None, np.array([-0.3])),
}


@pytest.mark.parametrize("name", STATES)
def test_normalised_coordinates_change_as_their_derivatives_say(name: str) -> None:
    state = STATES[name]
    here = normalise(state, TWO_FACES[None], VIEW, CAMERAS)
    assert here.dx.shape == (1, state.size, 12)
    for k in range(state.size):
        step = np.zeros((1, state.size))
        step[0, k] = 1e-6
        plus, minus = (normalise(state.moved(s * step), TWO_FACES[None], VIEW, CAMERAS) for s in (1.0, -1.0))
        np.testing.assert_allclose(here.dx[0, k], (plus.x - minus.x)[0] / 2e-6, atol=1e-7)
        np.testing.assert_allclose(here.dy[0, k], (plus.y - minus.y)[0] / 2e-6, atol=1e-7)


@pytest.mark.parametrize(
    "internals", [[800.0, 812.0, 655.0, 470.0], [300.0, 290.0, 100.0, 900.0], [5000.0, 5100.0, 640.0, 480.0]]
)
def test_the_priors_pull_along_the_gradient_of_their_cost(internals: list[float]) -> None:
    priors = Priors(image_size=(1280, 960), focal_range_px=(400.0, 3000.0))
    at = np.array([[internals]])
    gradient, hessian = np.zeros((1, 1, 4)), np.zeros((1, 1, 4, 4))
    add_priors(hessian, gradient, at, priors)
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-4
        slope = (prior_cost(at + step, priors) - prior_cost(at - step, priors)) / 2e-4
        assert gradient[0, 0, k] == pytest.approx(float(slope[0, 0]) / 2, rel=1e-4, abs=1e-9)


def test_a_prior_far_from_the_truth_costs_little_more_than_one_that_is_close() -> None:
    priors = Priors(image_size=(1280, 960))
    shifted = prior_cost(np.array([[[800.0, 800.0, 639.5, 479.5 + d]] for d in (0.0, 38.4, 384.0)]), priors)[:, 0]
    assert shifted[0] == 0.0
    assert shifted[1] == pytest.approx(np.log(2.0))
    assert shifted[2] < 5.0  # a Gaussian would charge 100


def test_the_closed_form_solves_the_internals() -> None:
    rng = np.random.default_rng(3)
    hessian = np.zeros((6, 2, 4, 4))
    for a, b in ((0, 2), (1, 3), (0, 1)):
        v = rng.normal(size=(6, 2, 3, 2))
        gram = np.einsum("hgni,hgnj->hgij", v, v)
        for i, row in enumerate((a, b)):
            for j, column in enumerate((a, b)):
                hessian[..., row, column] += gram[..., i, j]
    rhs = rng.normal(size=(6, 2, 4, 3))
    np.testing.assert_allclose(hessian @ solve_pairs(hessian, rhs), rhs, atol=1e-9)


def test_internals_that_nothing_determines_stay_zero() -> None:
    np.testing.assert_array_equal(solve_pairs(np.zeros((1, 1, 4, 4)), np.ones((1, 1, 4, 1))), 0.0)
