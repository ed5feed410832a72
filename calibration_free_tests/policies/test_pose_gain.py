"""How much a view sharpens a pose, by the estimator's own covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import before_front
from calibration_free_tests.recognition.test_policies import AWAY, situation
from recognition.pose_gain import pose_bits
from recognition.predict import Prediction
from recognition.varpro import refine_batch

CAMERAS = [before_front(480.0, turn_deg=-10.0), before_front(200.0, 260.0), AWAY]
NOW = situation(CAMERAS)
PREDICTION: Prediction = NOW.predict()
SAMPLE = NOW.belief.hypotheses.take(PREDICTION.rows)


def bits_of(rows: list[int]) -> np.ndarray:
    return pose_bits(NOW.world, SAMPLE, NOW.views, PREDICTION.shown, np.array(rows))


def one_fit(row: int, candidate: int) -> float:
    """Halvings of the volume by a fit of one hypothesis to what it matched and to what it would see there."""
    world, shown = NOW.world, PREDICTION.shown
    taken = SAMPLE.matches[0].part[row] >= 0
    new = np.flatnonzero((shown.candidate == candidate) & (shown.hypothesis == row) & (shown.chance > 0.0))[:12]
    parts = np.concatenate([SAMPLE.matches[0].part[row][taken], shown.pairs.part[new]])
    pixels = np.concatenate([SAMPLE.matches[0].corners_px[row][taken], shown.pairs.corners_px[new]])
    sure = world.rates.found * np.sqrt(shown.chance[new])
    weight = np.concatenate([SAMPLE.matches[0].weight[row][taken], sure])
    view = np.repeat([0, 1], [taken.sum(), len(new)])
    volumes = []
    for upto in (int(taken.sum()), len(parts)):
        fit = refine_batch(
            SAMPLE.placement[[row]],
            world.layout.corners_mm[parts[:upto]].reshape(1, -1, 3),
            pixels[:upto].reshape(1, -1, 2),
            np.repeat(weight[:upto], 4)[None],
            np.repeat(view[:upto], 4)[None],
            np.array([NOW.views[0].camera_row, shown.cameras[candidate]]),
            np.array([0, 1]),
            world.priors(NOW.views[0].image_size),
            iterations=0,
        )
        volumes.append(np.linalg.slogdet(fit.covariance[0])[1])
    return float(0.5 * (volumes[0] - volumes[1]) / np.log(2.0))


def test_bits_are_the_halvings_of_the_volume_that_a_fit_with_the_new_view_has() -> None:
    bits = bits_of([0, 1])
    for candidate in (0, 1):
        for row in (0, 1):
            assert bits[candidate, row] == pytest.approx(one_fit(row, candidate), abs=0.01)
    assert bits[:2, 0].min() > 0.5


def test_hypotheses_asked_for_together_get_what_each_gets_alone() -> None:
    together = bits_of([2, 0, 5])
    assert together == pytest.approx(np.concatenate([bits_of([row]) for row in (2, 0, 5)], axis=1))


def test_a_view_of_nothing_sharpens_no_pose() -> None:
    assert (bits_of([0, 1, 2])[2] == 0.0).all()


def test_parts_that_are_hardly_seen_sharpen_it_less() -> None:
    faint = replace(PREDICTION.shown, chance=0.1 * PREDICTION.shown.chance)
    less = pose_bits(NOW.world, SAMPLE, NOW.views, faint, np.array([0]))
    assert (less[:2, 0] < bits_of([0])[:2, 0]).all()
    assert less[:2, 0].min() > 0.0
