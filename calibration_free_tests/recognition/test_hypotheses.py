"""One placement fits all views of a hypothesis, and is as sure as its covariance says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.recognition.synthetic import (
    OBJECT_IN_RIG,
    base_of,
    before_front,
    building,
    pixels_of,
    seen_from,
    visible,
    world_of,
)
from recognition.geometry import CameraPose
from recognition.hypotheses import MOST_MATCHES, Hypotheses, ViewMatches, forget_contradicted, join, refine
from recognition.modelbase import ObjectModel
from recognition.tracking import World

FloatArray = npt.NDArray[np.float64]
TOWER = building("tower", 0)
BASE = base_of(TOWER)
WORLD = world_of(BASE)
TRUTH = np.array([np.radians(OBJECT_IN_RIG.theta_deg), *OBJECT_IN_RIG.translation_mm])
CORNER = CameraPose(40.0, 900.0, 200.0, -180.0)  # sees both walls


def matched(
    cameras: list[CameraPose], draws: int, noise_px: float, seed: int = 0, *, locked: bool = False
) -> Hypotheses:
    """Hypotheses with right matches in all views, each with noise and internals of its own, started a little off."""
    rng = np.random.default_rng(seed)
    lenses = [[_lens(rng) for _ in range(draws)] for _ in cameras]
    if locked:
        lenses = [lenses[0]] * len(cameras)
    return Hypotheses(
        np.zeros(draws, dtype=np.int64),
        TRUTH + rng.normal(0, 1, (draws, 4)) * [0.02, 8, 8, 8],
        np.zeros((draws, 4, 4)),
        np.zeros((draws, len(cameras), 4)),
        np.zeros(draws),
        np.zeros((draws, len(cameras))),
        tuple(_matches(TOWER, camera, lens, noise_px, rng) for camera, lens in zip(cameras, lenses, strict=True)),
    )


def _lens(rng: np.random.Generator) -> FloatArray:
    """What the soft priors say of a camera, and any focal length."""
    f = rng.uniform(600, 800)
    return np.array([f, f * np.exp(rng.normal(0, 0.005)), *(np.array([319.5, 239.5]) + rng.normal(0, 0.03 * 640, 2))])


def _matches(
    thing: ObjectModel, camera: CameraPose, lenses: list[FloatArray], noise_px: float, rng: np.random.Generator
) -> ViewMatches:
    shown = [part for part, _ in visible(thing, camera)][:MOST_MATCHES]
    part = np.full((len(lenses), MOST_MATCHES), -1)
    px = np.zeros((len(lenses), MOST_MATCHES, 4, 2))
    weight = np.zeros((len(lenses), MOST_MATCHES))
    for row, lens in enumerate(lenses):
        for column, one in enumerate(shown):
            part[row, column] = WORLD.layout.part_ids.index(one.id)
            px[row, column] = pixels_of(one.corners_mm, camera, lens) + rng.normal(0, noise_px, (4, 2))
    weight[part >= 0] = 1.0 / noise_px
    return ViewMatches(part, px, weight)


def refined(
    cameras: list[CameraPose], hypotheses: Hypotheses, *, locked: bool = False, world: World = WORLD
) -> Hypotheses:
    views = [seen_from(BASE, TOWER, c, group=0 if locked else k) for k, c in enumerate(cameras)]
    return refine(world.layout, hypotheses, views, world.priors(views[0].image_size), iterations=12)


def surprise(found: Hypotheses) -> FloatArray:
    """``(H,)`` squared error in units of the claimed covariance: 4 on average if the claim is right."""
    off = found.placement - TRUTH
    return np.asarray(np.einsum("ha,hab,hb->h", off, np.linalg.inv(found.covariance), off))


TWO = [before_front(330.0, turn_deg=15.0), before_front(480.0, 180.0, 350.0, turn_deg=-15.0)]


@pytest.mark.parametrize("cameras", [TWO, [*TWO, CORNER], [CORNER]], ids=["two views", "three views", "a corner"])
def test_the_pose_is_as_sure_as_its_covariance_claims(cameras: list[CameraPose]) -> None:
    found = refined(cameras, matched(cameras, 80, 0.4))
    # Heavy-tailed priors and corners are not Gaussian, so the claim may err on either side, but not by much.
    assert 2.0 < float(np.mean(surprise(found))) < 6.5
    assert np.quantile(surprise(found), 0.95) < 16.0


def test_a_second_view_with_a_known_move_fixes_what_one_view_leaves_open() -> None:
    one = refined(TWO[:1], matched(TWO[:1], 20, 0.4))
    two = refined(TWO, matched(TWO, 20, 0.4))
    sd_one, sd_two = (np.sqrt(np.median(np.trace(f.covariance[:, 1:, 1:], axis1=1, axis2=2))) for f in (one, two))
    assert sd_one > 20.0
    assert sd_two < 0.3 * sd_one


def test_a_locked_zoom_makes_the_pose_surer() -> None:
    free = refined(TWO, matched(TWO, 20, 0.4))
    hypotheses = replace(matched(TWO, 20, 0.4, locked=True), internals=np.zeros((20, 1, 4)))
    locked = refined(TWO, hypotheses, locked=True)
    assert np.median(locked.covariance[:, 3, 3]) < np.median(free.covariance[:, 3, 3])
    assert 1.5 < float(np.mean(surprise(locked))) < 6.5


def test_what_is_not_matched_stays_where_it_is() -> None:
    blank = matched(TWO, 3, 0.4)
    nothing = tuple(replace(m, part=np.full_like(m.part, -1), weight=np.zeros_like(m.weight)) for m in blank.matches)
    found = refined(TWO, replace(blank, matches=nothing))
    assert np.array_equal(found.placement, blank.placement)
    assert np.isfinite(found.log_weight).all()


def test_one_wrong_match_does_not_bend_the_fit() -> None:
    hypotheses = matched(TWO, 20, 0.4)
    px = hypotheses.matches[0].corners_px.copy()
    px[:, 0] += 25.0
    spoilt = replace(hypotheses, matches=(replace(hypotheses.matches[0], corners_px=px), hypotheses.matches[1]))
    good, bad = refined(TWO, hypotheses), refined(TWO, spoilt)
    off_good, off_bad = (np.median(np.linalg.norm((f.placement - TRUTH)[:, 1:], axis=1)) for f in (good, bad))
    assert off_bad < 2.0 * off_good + 1.0


def test_internals_that_no_camera_has_cost_weight() -> None:
    """A hypothesis that needs a principal point far out, or oblong pixels, pays for it."""
    odd = matched(TWO, 10, 0.4)
    stretched = tuple(replace(m, corners_px=m.corners_px * [1.0, 1.06]) for m in odd.matches)
    assert (refined(TWO, replace(odd, matches=stretched)).log_weight < refined(TWO, odd).log_weight - 1.0).all()


def test_taking_joining_and_putting_lose_nothing() -> None:
    all_of_them = replace(matched(TWO, 6, 0.4), odds=np.arange(12.0).reshape(6, 2))
    a, b = all_of_them.take(np.array([0, 1, 2])), all_of_them.take(np.array([3, 4, 5]))
    assert _same(join(a, b), all_of_them)
    swapped = all_of_them.put(np.array([4, 1]), all_of_them.take(np.array([0, 5])))
    assert _same(swapped, all_of_them.take(np.array([0, 5, 2, 3, 0, 5])))
    assert len(Hypotheses.empty()) == 0


def test_weights_add_what_views_say_less_what_internals_cost() -> None:
    some = replace(matched(TWO, 2, 0.4), odds=np.array([[1.0, 2.0], [3.0, -9.0]]), prior_cost=np.array([2.0, 0.0]))
    assert some.log_weight.tolist() == [2.0, -6.0]


def test_matches_of_a_view_that_contradicts_are_taken_back_and_no_others() -> None:
    some = replace(matched(TWO, 2, 0.4), odds=np.array([[5.0, -2.0], [5.0, 5.0]]))
    after = forget_contradicted(some)
    assert (after.matches[1].part[0] == -1).all()
    assert (after.matches[1].weight[0] == 0).all()
    assert np.array_equal(after.matches[0].part, some.matches[0].part)
    assert np.array_equal(after.matches[1].part[1], some.matches[1].part[1])
    assert np.array_equal(after.odds, some.odds), "what the view said is not forgotten"


def _same(a: Hypotheses, b: Hypotheses) -> bool:
    return (
        np.array_equal(a.object_of, b.object_of)
        and np.array_equal(a.placement, b.placement)
        and np.array_equal(a.odds, b.odds)
        and all(np.array_equal(m.corners_px, n.corners_px) for m, n in zip(a.matches, b.matches, strict=True))
    )
