"""Hypotheses that explain a view worse than they could get a second chance: a wrong match is not kept for ever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration_free_tests.recognition.synthetic import (
    INTERNALS,
    OBJECT_IN_RIG,
    SIZE,
    before_front,
    in_rig,
    pixels_of,
    three_buildings,
    visible,
    world_of,
)
from recognition.hypotheses import Hypotheses, no_matches
from recognition.mending import complete, mended, shortfall
from recognition.parts import DetectedPart
from recognition.seen import Seen, see
from recognition.tracking import match_view, rescore, settle

BASE = three_buildings()
THING = BASE.objects[0]
WORLD = world_of(BASE)
CAMERAS = (before_front(300.0, turn_deg=15.0), before_front(480.0, 200.0, 360.0, turn_deg=-10.0))
PLACEMENT = np.array([np.radians(OBJECT_IN_RIG.theta_deg), *OBJECT_IN_RIG.translation_mm])


def view_of(number: int, *, panes: bool = False) -> Seen:
    """A view with internals of its own; ``panes``: within each outline a smaller one, as window panes give."""
    camera = CAMERAS[number]
    parts = []
    for part, px in visible(THING, camera):
        parts.append(DetectedPart(px, {part.part_class: 0.95}, 0.1))
        if panes:
            inner = part.centre_mm + 0.84 * (part.corners_mm - part.centre_mm)
            parts.append(DetectedPart(pixels_of(inner, camera), {part.part_class: 0.9}, 0.1))
    return see(parts, in_rig(camera), SIZE, number, 0.0, [c.name for c in BASE.classes], 4)


def at_truth(views: list[Seen]) -> Hypotheses:
    return Hypotheses(
        np.array([0]),
        PLACEMENT[None],
        np.zeros((1, 4, 4)),
        np.tile(INTERNALS, (1, len(views), 1)),
        np.zeros(1),
        np.zeros((1, len(views))),
        tuple(no_matches(1, v) for v in views),
    )


def only_panes(seen: Seen) -> Seen:
    """The view with the inner outlines alone."""
    rows = np.arange(1, seen.count, 2)
    return replace(
        seen,
        corners_px=seen.corners_px[rows],
        corner_count=seen.corner_count[rows],
        sigma_px=seen.sigma_px[rows],
        class_score=seen.class_score[rows],
        source=seen.source[rows],
        likeness=seen.likeness[rows],
        foremost=np.arange(len(rows)),
    )


def test_a_hypothesis_that_explains_all_is_not_mended() -> None:
    views = [view_of(0), view_of(1)]
    settled = settle(WORLD, at_truth(views), views)
    assert shortfall(WORLD, settled, views).max() < 1.0
    assert len(mended(WORLD, settled, views)) == 0


def test_one_view_alone_is_not_mended() -> None:
    views = [view_of(0)]
    assert len(mended(WORLD, at_truth(views), views)) == 0


def test_a_view_matched_to_panes_is_found_anew() -> None:
    views = [view_of(0), view_of(1, panes=True)]
    every = range(2)
    bent = rescore(WORLD, settle(WORLD, at_truth(views), [views[0], only_panes(views[1])]), views, ())
    # Matched again to the nearest, it stays with the panes ...
    stuck = rescore(WORLD, bent, views, every)
    right = settle(WORLD, at_truth(views), views)
    assert stuck.log_weight[0] < right.log_weight[0] - 5.0
    # ... and mended, it explains as much as the truth does.
    best = mended(WORLD, stuck, views)
    assert best.log_weight.max() > right.log_weight[0] - 1.0


def test_parts_displaced_against_those_matched_are_found_together() -> None:
    """As on a wall at another depth, while the placement is still off: some parts match, the others all lie aside."""
    seen = view_of(0)
    aside = (seen.centre_px[:, 0] > np.median(seen.centre_px[:, 0])) * 28.0
    views = [replace(seen, corners_px=seen.corners_px + aside[:, None, None] * [1.0, 0.0])]
    matched = [
        int((found.matches[0].part >= 0).sum())
        for found in (
            match_view(WORLD, at_truth(views), views, 0, loose=0.25),
            complete(WORLD, at_truth(views), views, 0),
        )
    ]
    assert matched == [int((aside == 0).sum()), seen.count]
