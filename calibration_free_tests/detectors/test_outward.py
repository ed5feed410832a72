"""The outline around a closed one is found, and nesting is told."""

from __future__ import annotations

import numpy as np

from calibration_free_tests.detectors.drawing import as_photo, draw_polygon
from recognition.detectors.edges import EdgeField
from recognition.detectors.outward import holders, likely_part, outward_outlines

FRAME = np.array([[60.0, 50.0], [140.0, 62.0], [140.0, 170.0], [60.0, 160.0]])
PANE = FRAME + 5.0 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def test_the_frame_is_found_from_the_pane_that_segmentation_closed():
    image = np.full((240, 220), 150.0)
    draw_polygon(image, FRAME, 115.0)
    draw_polygon(image, PANE, 75.0)
    fit = outward_outlines(EdgeField(as_photo(image, np.random.default_rng(1))), PANE[None])
    assert len(fit.corners_px) == 1
    assert np.abs(fit.corners_px[0] - FRAME).max() < 0.6


def test_nothing_is_proposed_on_a_blank_wall_nor_around_very_small_outlines():
    edge_field = EdgeField(as_photo(np.full((240, 220), 150.0), np.random.default_rng(2)))
    outlines = np.stack([PANE, (PANE - PANE[0]) * 0.2 + 50.0])
    assert len(outward_outlines(edge_field, outlines).corners_px) == 0
    assert len(outward_outlines(edge_field, np.zeros((0, 4, 2))).corners_px) == 0


def test_panes_lie_in_their_window_but_not_in_the_whole_facade():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    facade, window, pane, other = 2000 * square, 100 * square + 50, 30 * square + 60, 100 * square + 400
    held = holders(np.stack([facade, window, pane, other]), 1.6, 60.0)
    assert np.argwhere(held).tolist() == [[2, 1]]


def test_the_outermost_outline_of_a_window_is_the_likeliest_part():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    frame, inner = 100 * square + 50, 92 * square + 54
    panes = [25 * square + corner for corner in ([60, 60], [110, 60], [60, 110], [110, 110])]
    likely = likely_part(np.stack([*panes, inner, frame]))
    assert likely.argmax() == 5
    assert likely[4] > 2 * likely[:4].max()
