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
from recognition.tracking import match_view, rescore, score_view, settle

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
    return only(seen, slice(1, None, 2))


def only(seen: Seen, which: slice) -> Seen:
    """The view with some of its detections, each now the foremost of its kind."""
    rows = np.arange(seen.count)[which]
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


def test_a_view_whose_zoom_was_told_wrong_is_found_anew_by_the_others() -> None:
    """Completing cannot mend this: nothing in the view stands where it is expected, so it has to be searched again."""
    views = [view_of(0), view_of(1)]
    right = settle(WORLD, at_truth(views), views)
    wrong = replace(
        right,
        internals=right.internals * np.array([[[1, 1, 1, 1], [1.25, 1.25, 1, 1]]]),
        matches=(right.matches[0], no_matches(1, views[1])),
    )
    stuck = score_view(WORLD, wrong, views, 1)
    assert stuck.odds[0, 1] < 0.0
    assert (complete(WORLD, stuck, views, 1).matches[1].part >= 0).sum() < views[1].count / 2
    assert mended(WORLD, stuck, views).log_weight.max() > right.log_weight[0] - 1.0


def test_an_empty_view_is_nobodys_worst() -> None:
    """Nothing can be mended where nothing was detected; the view that can be mended is."""
    views = [view_of(0), view_of(1, panes=True), replace(only(view_of(0), slice(0, 0)), group=2)]
    every = range(3)
    seen_as_panes = [views[0], only_panes(views[1]), views[2]]
    bent = rescore(WORLD, settle(WORLD, at_truth(views), seen_as_panes), views, ())
    stuck = rescore(WORLD, bent, views, every)
    right = settle(WORLD, at_truth(views), views)
    assert mended(WORLD, stuck, views).log_weight.max() > right.log_weight[0] - 1.0


def test_not_all_matched_views_are_forgotten_at_once() -> None:
    """A hypothesis that both views speak against keeps what it has: there would be nothing left to search from."""
    views = [view_of(0), view_of(1)]
    both_against = replace(settle(WORLD, at_truth(views), views), odds=np.array([[-1.0, -1.0]]))
    children = mended(WORLD, both_against, views)
    assert all((m.part >= 0).any(axis=1).all() for m in children.matches)


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
