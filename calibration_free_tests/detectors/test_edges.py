"""The model-driven measurement finds outlines where they are, and says so when there are none."""

from __future__ import annotations

import numpy as np
import pytest

from calibration_free_tests.detectors.drawing import as_photo, draw_polygon
from recognition.detectors.edges import EdgeField, measure_outlines

QUAD = np.array([[60.3, 50.2], [140.7, 62.4], [139.6, 170.8], [60.9, 160.1]])


def _photo(rng, quad=QUAD, wall=180.0, inside=70.0):
    image = np.full((240, 220), wall)
    draw_polygon(image, quad, inside)
    return as_photo(image, rng)


def test_corners_of_a_shifted_prediction_come_back_to_the_outline():
    rng = np.random.default_rng(1)
    edge_field = EdgeField(_photo(rng))
    predicted = QUAD + rng.uniform(-3, 3, (20, 1, 2)) + rng.uniform(-1, 1, (20, 4, 2))
    evidence = measure_outlines(edge_field, predicted)
    error = np.linalg.norm(evidence.corners_px - QUAD, axis=-1)
    assert error.max() < 0.3
    assert np.median(error) < 0.12
    assert evidence.support.min() > 0.9


@pytest.mark.parametrize("reverse", [False, True])
def test_offset_is_positive_outward_in_either_sense_of_rotation(reverse):
    edge_field = EdgeField(_photo(np.random.default_rng(2)))
    centre = QUAD.mean(axis=0)
    smaller = centre + (QUAD - centre) * 0.95
    polygon = smaller[::-1] if reverse else smaller
    offset = measure_outlines(edge_field, polygon[None]).offset_px
    assert (offset > 1.0).all()


def test_true_outline_scores_far_above_a_blank_wall():
    edge_field = EdgeField(_photo(np.random.default_rng(3)))
    blank = QUAD * 0.3 + [150, 10]
    score = measure_outlines(edge_field, np.stack([QUAD, blank])).score
    assert score[0] > 0.85
    assert score[1] < 0.3


def test_an_outline_that_differs_in_hue_alone_is_seen():
    image = np.full((240, 220, 3), 120.0)
    draw_polygon(image, QUAD, (90.0, 120.0, 150.0))
    evidence = measure_outlines(EdgeField(as_photo(image, np.random.default_rng(4))), QUAD[None] + 1.5)
    assert np.abs(evidence.corners_px - QUAD).max() < 0.4


def test_one_hidden_side_keeps_its_prediction_and_its_low_support():
    image = np.full((240, 220), 180.0)
    draw_polygon(image, QUAD, 70.0)
    image[:, 128:] = 120.0  # something in front hides the right side
    evidence = measure_outlines(EdgeField(as_photo(image, np.random.default_rng(5))), QUAD[None])
    assert evidence.support[0, 1] < 0.3
    assert evidence.offset_px[0, 1] == 0.0
    assert evidence.support[0, [0, 2, 3]].min() > 0.6
    assert evidence.score[0] > 0.4


def test_sides_outside_the_picture_are_not_counted():
    edge_field = EdgeField(_photo(np.random.default_rng(6))[:, :100])
    evidence = measure_outlines(edge_field, QUAD[None])
    assert evidence.visible[0, 1] == 0.0
    assert evidence.support[0, 3] > 0.9
    assert np.isfinite(evidence.corners_px).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 1, 3), (2, 7), (40, 40, 3)])
def test_tiny_or_black_pictures_give_no_evidence(shape):
    evidence = measure_outlines(EdgeField(np.zeros(shape, np.uint8)), QUAD[None])
    assert evidence.score[0] == 0.0
    assert np.allclose(evidence.corners_px[0], QUAD)


def test_no_outlines_give_empty_evidence():
    evidence = measure_outlines(EdgeField(np.zeros((20, 20), np.uint8)), np.zeros((0, 4, 2)))
    assert evidence.score.shape == (0,)
    assert evidence.corners_px.shape == (0, 4, 2)


def test_a_strong_inner_edge_does_not_draw_the_outline_away_from_its_weaker_outer_edge():
    image = np.full((240, 220), 150.0)
    draw_polygon(image, QUAD, 125.0)
    inner = QUAD + 5.0 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    draw_polygon(image, inner, 60.0)
    edge_field = EdgeField(as_photo(image, np.random.default_rng(7)))
    assert np.abs(measure_outlines(edge_field, QUAD[None] + 1.0).corners_px - QUAD).max() < 1.0
