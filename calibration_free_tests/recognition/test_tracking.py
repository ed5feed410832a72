"""Hypotheses are carried through views: found again at other zooms, and judged by what they should have seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    BOUNDS,
    INTERNALS,
    OBJECT_IN_RIG,
    SIZE,
    Faults,
    before_front,
    believed,
    camera_of,
    in_rig,
    pixels_of,
    seen_from,
    three_buildings,
    true_rows,
    visible,
    world_of,
)
from recognition import tracking
from recognition.belief import Belief
from recognition.geometry import CameraPose, Pose4
from recognition.hypotheses import Hypotheses, no_matches
from recognition.modelbase import ModelBase, ObjectModel
from recognition.parts import DetectedPart
from recognition.proposals import focal_range
from recognition.rates import DetectionRates
from recognition.seen import Seen, see
from recognition.settings import Effort
from recognition.tracking import (
    World,
    add_view,
    doubt_px,
    expected_internals,
    expected_parts,
    expected_sd,
    guess_internals,
    look_in,
    match_view,
    score_view,
    settle,
)

BASE = three_buildings()
WORLD = world_of(BASE)
FIRST, SECOND = before_front(300.0, turn_deg=15.0), before_front(480.0, 200.0, 360.0, turn_deg=-10.0)
ASIDE = before_front(560.0, 200.0, 330.0)
PLACEMENT = np.array([np.radians(OBJECT_IN_RIG.theta_deg), *OBJECT_IN_RIG.translation_mm])


def at_truth(views: list[Seen], things: tuple[int, ...] = (0,)) -> Hypotheses:
    """Hypotheses at the true placement, of these objects, that know the internals and have matched nothing."""
    n = len(things)
    groups = max(v.group for v in views) + 1
    return Hypotheses(
        np.array(things),
        np.tile(PLACEMENT, (n, 1)),
        np.zeros((n, 4, 4)),
        np.tile(INTERNALS, (n, groups, 1)),
        np.zeros(n),
        np.zeros((n, len(views))),
        tuple(no_matches(n, v) for v in views),
    )


def test_the_truth_expects_what_is_seen() -> None:
    views = [seen_from(BASE, BASE.objects[0], FIRST)]
    pairs = expected_parts(WORLD, at_truth(views), views, 0, INTERNALS[None])
    expected = {WORLD.layout.part_ids[p] for p in pairs.part}
    assert expected >= {part.id for part, _ in visible(BASE.objects[0], FIRST)}


def test_the_true_object_explains_a_view_better_than_the_others() -> None:
    views = [seen_from(BASE, BASE.objects[1], FIRST)]
    found = score_view(WORLD, at_truth(views, (0, 1, 2)), views, 0)
    assert found.odds[:, 0].argmax() == 1
    assert found.odds[1, 0] > 0


def test_an_empty_view_speaks_against_who_expects_parts_and_not_without_end() -> None:
    views = [seen_from(BASE, None, FIRST)]
    away = PLACEMENT + np.array([0.0, 0.0, 0.0, -5000.0])
    hypotheses = at_truth(views, (0, 0))
    hypotheses.placement[1] = away
    odds = score_view(WORLD, hypotheses, views, 0).odds[:, 0]
    assert odds[0] < -3.0
    assert odds[1] == 0.0
    assert odds[0] >= -WORLD.rates.view_cap


def at_the_border(inside_px: float) -> CameraPose:
    """A camera to whose frame's left border the outermost part of the front comes so near, to half a pixel."""
    for x_mm in np.arange(300.0, 420.0, 0.5):
        camera = before_front(float(x_mm))
        left = min(
            float(pixels_of(part.corners_mm, camera)[:, 0].min()) for part, _ in visible(BASE.objects[0], camera)
        )
        if abs(left - inside_px) < 0.5:
            return camera
    raise AssertionError("no such camera")


def test_a_part_at_the_border_is_not_lost_by_a_fit_that_puts_it_beyond() -> None:
    camera = at_the_border(4.6)
    views = [seen_from(BASE, BASE.objects[0], camera)]
    hypotheses = at_truth(views)
    hypotheses.internals[:, :, 2] -= 3.9
    found = score_view(WORLD, hypotheses, views, 0)
    matched = {WORLD.layout.part_ids[p] for p in found.matches[0].part[0] if p >= 0}
    assert matched == {part.id for part, _ in visible(BASE.objects[0], camera)}


def test_a_part_that_may_show_at_the_border_and_does_not_is_no_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    lens = INTERNALS - [0.0, 0.0, 9.0, 0.0]
    views = [seen_from(BASE, BASE.objects[0], at_the_border(4.6), internals=lens)]
    hypotheses = at_truth(views)
    hypotheses.internals[:, :, 2] = lens[2]
    # What tells that the view's internals are no guess any more is that something was matched in it.
    hypotheses = score_view(WORLD, hypotheses, views, 0)
    doubted = score_view(WORLD, hypotheses, views, 0)
    monkeypatch.setattr(tracking, "_BORDER_PX", -2.0)
    sure = score_view(WORLD, hypotheses, views, 0)
    assert doubted.odds[0, 0] == pytest.approx(sure.odds[0, 0], abs=0.02)


def test_small_parts_are_matched_as_coarsely_as_votes_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Votes are as coarse as their cells, whatever a part's size: a far wall's windows are small, and so were lost."""
    far = before_front(420.0, distance_mm=900.0)
    views = [seen_from(BASE, BASE.objects[0], far)]
    hypotheses = at_truth(views)
    hypotheses.internals[:, :, 2:] += [5.0, -4.0]
    asked = hypotheses.internals[:, 0]
    shown = {part.id for part, _ in visible(BASE.objects[0], far)}
    found_of_all = {True: 0.9, False: 0.0}
    for voted, share in found_of_all.items():
        found = match_view(WORLD, hypotheses, views, 0, loose=0.1, internals=asked, voted=voted)
        matched = {WORLD.layout.part_ids[p] for p in found.matches[0].part[0] if p >= 0}
        assert share <= len(matched & shown) / len(shown) <= (1.0 if voted else 0.1)


@pytest.mark.parametrize(("scale", "zoom"), [(0.75, 0.2), (0.9, 0.5), (1.0, 0.5), (1.1, 0.5), (1.4, 0.9)])
def test_a_place_is_found_again_through_internals_never_seen_before(scale: float, zoom: float) -> None:
    """Focus and zoom both change the focal length; of the zoom it is only known that more of it is longer."""
    lens = INTERNALS * [scale, scale, 1.0, 1.0] + [0.0, 0.0, 25.0, -18.0]
    near = before_front(470.0, 200.0, 330.0 * scale)
    views = [seen_from(BASE, BASE.objects[0], FIRST, group=0, zoom=0.5)]
    before = settle(WORLD, at_truth(views), views)
    views.append(seen_from(BASE, BASE.objects[0], near, group=1, zoom=zoom, internals=lens))
    found = settle(WORLD, look_in(WORLD, add_view(before, views), views, 1), views)
    truth = {part.id for part, _ in visible(BASE.objects[0], near, lens)}
    matched = {WORLD.layout.part_ids[p] for p in found.matches[1].part[0] if p >= 0}
    assert matched == truth
    assert found.internals[0, 1, 0] == pytest.approx(lens[0], rel=0.03)
    assert found.odds[0, 1] > 5.0


def test_a_new_view_begins_without_evidence() -> None:
    views = [seen_from(BASE, BASE.objects[0], FIRST, group=0)]
    before = settle(WORLD, at_truth(views), views)
    views.append(seen_from(BASE, BASE.objects[0], SECOND, group=1))
    after = add_view(before, views)
    assert after.odds.shape == (1, 2)
    assert after.odds[0, 1] == 0.0
    assert (after.matches[1].part == -1).all()
    assert after.internals[0, 1].tolist() == [0.0] * 4
    assert np.array_equal(after.internals[:, 0], before.internals[:, 0])


def test_known_internals_of_a_zoom_setting_are_used_again() -> None:
    views = [seen_from(BASE, BASE.objects[0], FIRST, group=0), seen_from(BASE, BASE.objects[0], SECOND, group=0)]
    before = settle(WORLD, at_truth(views[:1]), views[:1])
    both = add_view(before, views)
    assert np.array_equal(expected_internals(WORLD, both, views, 1), before.internals[:, 0])


def test_the_guess_at_another_zoom_is_longer_for_more_zoom_and_within_the_lens() -> None:
    views = [seen_from(BASE, BASE.objects[0], FIRST, group=0, zoom=0.3)]
    before = settle(WORLD, at_truth(views), views)
    wide, same, tele = (guess_internals(WORLD, before, views, None, zoom)[0, 0] for zoom in (0.0, 0.3, 1.0))
    low, high = focal_range(BOUNDS, SIZE[0])
    assert wide < same < tele <= high
    assert same == pytest.approx(before.internals[0, 0, 0])
    assert wide > 0.5 * low


def test_bounds_tell_the_lens_and_nothing_else_of_the_camera() -> None:
    priors = WORLD.priors(SIZE)
    assert priors.focal_range_px == pytest.approx(focal_range(BOUNDS, SIZE[0]))
    assert priors.image_size == SIZE


def paned_view(base: ModelBase, thing: ObjectModel, camera: CameraPose, group: int) -> Seen:
    """Every window has 4 x 4 panes that repeat the facade's own proportions eight times smaller, and all are found."""
    rng = np.random.default_rng(group)
    parts = []
    for part, px in visible(thing, camera):
        parts.append(DetectedPart(px + rng.normal(0, 0.3, (4, 2)), {part.part_class: 0.95}, 0.3))
        for row in range(4):
            for column in range(4):
                low = part.corners_mm[0] + [2.5 + 10.0 * column, 2.8 + 11.25 * row, 0]
                flat = np.array([[0, 0, 0], [5, 0, 0], [5, 6.875, 0], [0, 6.875, 0]])
                pane = pixels_of(low + flat, camera) + rng.normal(0, 0.2, (4, 2))
                parts.append(DetectedPart(pane, {"DW4": 0.9}, 0.3))
    order = rng.permutation(len(parts))
    names = [c.name for c in base.classes]
    return see([parts[i] for i in order], in_rig(camera), SIZE, group, 0.0, names, 4)


def test_panes_that_look_like_a_farther_facade_lose_as_the_camera_moves() -> None:
    """Each view fits them better than the windows, at internals of its own; what the moves make of that adds up."""
    world: World = world_of(BASE, DetectionRates(found=0.6, clutter=80.0, corner_sd_px=0.5))
    effort = Effort.for_clutter(80.0)
    cameras = [
        before_front(300.0, turn_deg=12.0),
        before_front(420.0, 150.0, turn_deg=-8.0),
        before_front(300.0, 150.0),
        before_front(520.0, 250.0, 380.0, turn_deg=20.0),
        before_front(200.0, 200.0, turn_deg=-15.0),
    ]
    views = [paned_view(BASE, BASE.objects[1], c, k) for k, c in enumerate(cameras)]
    _, one = believed(world, views[:1], effort)
    right = true_rows(one.hypotheses, views[0], 1, cameras[0], within_mm=60.0)
    rivals = far_away(world, one, views[:1])
    counts = (one.hypotheses.matches[0].part >= 0).sum(axis=1)
    assert counts[rivals].max() > counts[right].max(), "the panes win by number"
    left = []
    for n in (2, 5):
        _, belief = believed(world, views[:n], effort)
        left.append(belief.probability[far_away(world, belief, views[:n])].sum())
        assert 0 in true_rows(belief.hypotheses, views[n - 1], 1, cameras[n - 1], within_mm=30.0)
    assert left[1] < left[0] / 3, "they are still there after two views, and all but gone after five"
    assert left[1] < 0.02


def far_away(world: World, belief: Belief, views: list[Seen]) -> list[int]:
    """Hypotheses that have the parts of the latest view in which they match some at more than three times the truth."""
    rows = []
    for row in range(len(belief.hypotheses)):
        for k in range(len(views) - 1, -1, -1):
            part = belief.hypotheses.matches[k].part[row]
            if (part >= 0).any():
                middle = world.layout.centre_mm[part[part >= 0]].mean(axis=0)
                if np.linalg.norm(middle - camera_of(belief.hypotheses, row, views[k]).centre_mm) > 1000.0:
                    rows.append(row)
                break
    return rows


def test_two_views_name_object_and_place_among_misses_and_false_detections() -> None:
    faults = Faults(noise_px=0.3, missed=0.1, false=2)
    for thing in range(3):
        views = [
            seen_from(BASE, BASE.objects[thing], c, group=k, faults=faults, seed=k + 10 * thing)
            for k, c in enumerate((FIRST, SECOND, ASIDE))
        ]
        _, belief = believed(WORLD, views)
        right = true_rows(belief.hypotheses, views[-1], thing, ASIDE, within_mm=25.0)
        assert belief.probability[right].sum() > 0.98


def test_a_focal_length_that_views_tell_is_kept_beyond_the_benchs_range() -> None:
    """The bench's range of the lens is soft: what was fitted to a view must predict that very view."""
    _, high = focal_range(BOUNDS, SIZE[0])
    long = INTERNALS * np.array([1.2 * high / INTERNALS[0], 1.2 * high / INTERNALS[0], 1.0, 1.0])
    views = [seen_from(BASE, BASE.objects[0], FIRST)]
    known = at_truth(views)
    known.internals[:, 0] = long
    assert expected_internals(WORLD, known, views, 0)[0] == pytest.approx(long)


def test_a_view_is_searched_as_far_as_the_place_is_open() -> None:
    """A pan unsure by degrees throws what stands round the corner far aside; a sure one does not look there."""
    views = [seen_from(BASE, BASE.objects[0], FIRST)]
    hypotheses = at_truth(views, (0, 0))
    hypotheses.covariance[0] = np.diag([np.radians(0.1), 1.0, 1.0, 1.0]) ** 2
    hypotheses.covariance[1] = np.diag([np.radians(3.0), 1.0, 1.0, 1.0]) ** 2
    pairs = expected_parts(WORLD, hypotheses, views, 0, INTERNALS[None].repeat(2, axis=0))
    sure, open_ = doubt_px(WORLD.layout, hypotheses, views[0], pairs, INTERNALS[None].repeat(2, axis=0))
    rig = OBJECT_IN_RIG
    middle = WORLD.layout.centre_mm[pairs.part[pairs.hypothesis == 1]].mean(axis=0)
    turned = Pose4.of(rig.theta_deg + 3.0, rig.translation_mm)
    was, now = (pixels_of((p.rotation @ middle + p.translation_mm)[None], in_rig(FIRST))[0] for p in (rig, turned))
    assert open_ == pytest.approx(float(np.abs(now - was).max()), rel=0.1)
    assert sure < 5.0


def test_a_rig_that_reads_back_inexactly_is_granted_more_the_nearer_the_parts() -> None:
    views = [
        seen_from(BASE, BASE.objects[0], before_front(300.0, distance_mm=d), group=k)
        for k, d in ((0, 300.0), (1, 500.0))
    ]
    exact, loose = WORLD, world_of(BASE, bounds=replace(BOUNDS, motion_sd_mm=5.0, motion_sd_deg=1.0))
    median = []
    for k in (0, 1):
        pairs = expected_parts(WORLD, at_truth(views), views, k, INTERNALS[None])
        assert set(expected_sd(exact, pairs, INTERNALS[None])) == {exact.rates.corner_sd_px}
        median.append(float(np.median(expected_sd(loose, pairs, INTERNALS[None]))))
    assert median[0] > median[1] > exact.rates.corner_sd_px
