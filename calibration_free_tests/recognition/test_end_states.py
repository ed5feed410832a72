"""Every run ends in the state that its evidence deserves, and says so."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    Faults,
    SyntheticRig,
    around_the_corner,
    base_of,
    before_front,
    building,
    changing,
    fixed,
    off,
    regular,
    run,
    three_buildings,
    with_views,
)
from recognition.modelbase import ObjectModel, Part
from recognition.parts import DetectedPart
from recognition.rates import DetectionRates
from recognition.settings import BenchBounds, RecogniserSettings
from recognition.steps import Answer, Outcome, Step

BASE = three_buildings()


def scaled(thing: ObjectModel, factors: tuple[float, float, float]) -> ObjectModel:
    """The same building with other measures."""
    parts = tuple(Part(p.id, p.part_class, p.corners_mm * np.array(factors), p.face) for p in thing.parts)
    return ObjectModel(thing.id, parts)


def trace(steps: list[Step], answer: Answer) -> tuple[object, ...]:
    """What a run did and said, without its times."""
    return (
        [(s.frame.rig_pose, s.belief.posterior, s.belief.entropy_bits, s.move and s.move.why) for s in steps],
        replace(answer, posterior=dict(answer.posterior)),
    )


# --- recognised -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("policy", ["information", "random"])
def test_each_object_is_recognised_from_imperfect_views(number: int, policy: str) -> None:
    faults = Faults(noise_px=0.5, missed=0.08, false=1)
    bench = SyntheticRig(BASE.objects[number], around_the_corner(), changing(number), faults, seed=number)
    steps, answer = run(bench, BASE, with_views(SETTINGS, policy=policy))
    away_mm, away_deg = off(answer, bench)
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, BASE.objects[number].id)
    assert away_mm < 45.0
    assert away_deg < 4.0
    assert answer.candidates == ()
    assert steps[-1].move is None


def test_no_object_is_taken_for_another() -> None:
    """Twelve runs on dirty views: each is right, or says that it is not sure, and few are not sure."""
    right = 0
    for seed in range(12):
        thing = BASE.objects[seed % 3]
        places = around_the_corner()
        np.random.default_rng(seed).shuffle(places)
        bench = SyntheticRig(thing, places, changing(seed), Faults(0.5, 0.1, 2), seed=seed)
        _, answer = run(bench, BASE)
        if answer.outcome is Outcome.RECOGNISED:
            assert (seed, answer.object_id) == (seed, thing.id)
            assert off(answer, bench)[0] < 60.0
            right += 1
    assert right >= 10


def test_a_run_goes_on_until_the_pose_is_as_sure_as_asked() -> None:
    asked = with_views(SETTINGS, pose_sd_mm=2.0, pose_sd_deg=0.3, max_views=16)
    rough = SyntheticRig(BASE.objects[1], around_the_corner(), fixed(), Faults(noise_px=0.3))
    sharp = SyntheticRig(BASE.objects[1], around_the_corner(), fixed(), Faults(noise_px=0.3))
    _, quick = run(rough, BASE)
    steps, sure = run(sharp, BASE, asked)
    assert max(quick.pose_sd[k] for k in ("x_mm", "y_mm", "z_mm")) > 2.0
    assert max(sure.pose_sd[k] for k in ("x_mm", "y_mm", "z_mm")) <= 2.0
    assert sure.pose_sd["theta_deg"] <= 0.3
    assert len(sharp.taken) > len(rough.taken)
    assert steps[-2].move is not None
    assert "sharpens the pose" in steps[-2].move.why
    assert off(sure, sharp)[0] < 6.0
    assert sure.pose_sure
    assert "unsure" not in sure.why


@pytest.mark.parametrize(("most", "because"), [(3, "3 views were taken"), (12, "no reachable view makes it surer")])
def test_a_pose_that_stays_less_sure_than_asked_is_said_beside_the_place(most: int, because: str) -> None:
    bench = SyntheticRig(BASE.objects[1], around_the_corner()[::5][:5], fixed(), Faults(noise_px=0.3))
    steps, answer = run(bench, BASE, with_views(SETTINGS, pose_sd_mm=0.01, max_views=most))
    assert len(steps) == min(most, 5)
    assert (answer.outcome, answer.object_id, answer.pose_sure) == (Outcome.RECOGNISED, "mill", False)
    assert "position is unsure" in answer.why
    assert because in answer.why


# --- ambiguous ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
def test_two_identical_objects_end_ambiguous_with_both_named(seed: int) -> None:
    twins = base_of(BASE.objects[0], replace(BASE.objects[0], id="twin"), BASE.objects[1])
    bench = SyntheticRig(twins.objects[0], around_the_corner(), changing(seed), seed=seed)
    _, answer = run(bench, twins)
    assert answer.outcome is Outcome.AMBIGUOUS
    assert answer.object_id is None
    assert {c.split(" at ")[0] for c in answer.candidates} == {"tower", "twin"}
    assert answer.posterior["tower"] == pytest.approx(0.5, abs=0.02)
    assert answer.posterior["twin"] == pytest.approx(0.5, abs=0.02)


def test_places_that_no_reachable_view_separates_end_the_run_at_once() -> None:
    wall = regular("wall")
    bench = SyntheticRig(wall, [before_front(x) for x in (400.0, 440.0, 480.0, 520.0, 560.0)])
    steps, answer = run(bench, base_of(wall))
    assert answer.outcome is Outcome.AMBIGUOUS
    assert len(steps) < 5
    assert len(answer.candidates) > 3
    assert all(c.startswith("wall at front") for c in answer.candidates)
    assert "no reachable view" in answer.why


def test_a_run_that_may_take_one_view_only_says_what_is_left() -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner())
    steps, answer = run(bench, BASE, with_views(SETTINGS, max_views=1))
    assert len(steps) == 1
    assert answer.outcome is Outcome.AMBIGUOUS
    assert len(answer.candidates) > 3
    assert steps[0].move is None


# --- unknown and not found ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factors", [(1.4, 1.0, 1.0), (2.0, 1.0, 1.0), (1.0, 0.6, 1.0)])
@pytest.mark.parametrize("kind", [77, 78])
def test_an_object_with_windows_of_other_shapes_ends_unknown(factors: tuple[float, float, float], kind: int) -> None:
    bench = SyntheticRig(scaled(building("stranger", kind), factors), around_the_corner(), changing(7), seed=7)
    _, answer = run(bench, BASE)
    assert answer.outcome is Outcome.UNKNOWN
    assert answer.posterior["unknown"] > 0.99
    assert (answer.object_id, answer.candidates) == (None, ())


def test_false_detections_alone_are_no_object_at_no_place() -> None:
    outcomes = []
    for seed in range(4):
        bench = SyntheticRig(None, around_the_corner(), faults=Faults(false=4), seed=seed)
        _, answer = run(bench, BASE, with_views(SETTINGS, max_views=12))
        assert answer.outcome is not Outcome.RECOGNISED
        assert (answer.object_id, answer.pose) == (None, None)
        outcomes.append(answer.outcome)
    assert outcomes.count(Outcome.UNKNOWN) >= 2


def test_parts_of_no_object_end_unknown() -> None:
    """Every view shows one long sliver, as no object has any."""

    def slivers(number: int, _parts: list[DetectedPart]) -> list[DetectedPart]:
        at = np.array([40.0 + 3 * number, 200.0])
        corners = at + np.array([[0, 0], [500, 40], [500, 52], [0, 12]])
        return [DetectedPart(corners, {"DW4": 0.9}, 0.3)]

    bench = SyntheticRig(None, around_the_corner(), altered=slivers)
    _, answer = run(bench, BASE)
    assert answer.outcome is Outcome.UNKNOWN
    assert answer.posterior["unknown"] > 0.99
    assert (answer.object_id, answer.candidates) == (None, ())


def test_where_nothing_is_ever_seen_nothing_is_found() -> None:
    for places in (around_the_corner(), around_the_corner()[:2]):
        bench = SyntheticRig(None, places)
        steps, answer = run(bench, BASE)
        assert answer.outcome is Outcome.NOT_FOUND
        assert answer.pose is None
        assert len(steps) == min(len(places), SETTINGS.max_views)


@pytest.mark.parametrize("number", [0, 2])
def test_views_that_stay_empty_where_parts_are_expected_speak_against_every_object(number: int) -> None:
    """One view of windows, then nothing more, wherever the run looks for what ought to be beside them."""

    def blank(view: int, parts: list[DetectedPart]) -> list[DetectedPart]:
        return [] if view else parts

    bench = SyntheticRig(BASE.objects[number], around_the_corner()[number:], changing(number), altered=blank)
    steps, answer = run(bench, BASE, with_views(SETTINGS, max_views=8))
    none = [step.belief.posterior["unknown"] for step in steps]
    assert none[0] < 0.01
    assert none[-1] > 0.8
    assert answer.outcome is Outcome.NOT_FOUND


def test_empty_first_views_are_no_end() -> None:
    """The rig begins far beside the building, before nothing; the run looks elsewhere and still ends right."""
    aside = [before_front(x) for x in (-2600.0, -2500.0, -2400.0)]
    bench = SyntheticRig(BASE.objects[2], aside + around_the_corner(), changing(3), seed=3)
    steps, answer = run(bench, BASE)
    assert len(steps[0].parts) == 0
    assert steps[0].move is not None
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, "barn")


def test_three_blank_pictures_do_not_tell_that_the_object_is_unknown() -> None:
    aside = [before_front(x) for x in (-2600.0, -2500.0, -2400.0, -2300.0)]
    bench = SyntheticRig(BASE.objects[2], aside)
    steps, answer = run(bench, BASE)
    assert len(steps) == 4
    assert answer.outcome is Outcome.NOT_FOUND


def test_an_empty_view_in_the_middle_is_no_end() -> None:
    def blank(number: int, parts: list[DetectedPart]) -> list[DetectedPart]:
        return [] if number == 1 else parts

    bench = SyntheticRig(BASE.objects[0], around_the_corner(), changing(1), altered=blank)
    steps, answer = run(bench, BASE)
    assert len(steps[1].parts) == 0
    assert steps[1].move is not None
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, "tower")


@pytest.mark.parametrize("seed", range(3))
def test_a_first_view_of_something_else_is_overcome(seed: int) -> None:
    """The first picture shows another building; nothing is eliminated for good by it."""
    other = SyntheticRig(BASE.objects[1], around_the_corner()[2 + seed :])
    other.capture()

    def swapped(number: int, parts: list[DetectedPart]) -> list[DetectedPart]:
        return other.shown[0] if number == 0 else parts

    bench = SyntheticRig(BASE.objects[0], around_the_corner(), changing(seed), altered=swapped)
    _, answer = run(bench, BASE, with_views(SETTINGS, threshold=1.0, max_views=7))
    assert answer.posterior["tower"] > 0.9
    assert off(answer, bench)[0] < 60.0


# --- every run ------------------------------------------------------------------------------------------------------

ANY_RUN = [
    (0, SETTINGS),
    (1, with_views(SETTINGS, policy="random", max_views=5, seed=4)),
    (2, with_views(SETTINGS, threshold=1.0, max_views=4)),
]


@pytest.mark.parametrize(("number", "settings"), ANY_RUN)
def test_beliefs_of_a_run_are_probabilities(number: int, settings: RecogniserSettings) -> None:
    bench = SyntheticRig(BASE.objects[number], around_the_corner(), changing(number), Faults(0.4, 0.1, 1))
    steps, answer = run(bench, BASE, settings)
    for posterior in [s.belief.posterior for s in steps] + [answer.posterior]:
        assert sum(posterior.values()) == pytest.approx(1.0, abs=1e-9)
        assert set(posterior) == {"tower", "mill", "barn", "unknown"}
        assert min(posterior.values()) >= 0.0
    for step in steps:
        assert 0.0 <= step.belief.entropy_bits <= np.log2(len(BASE.objects) * 100)
        assert step.belief.hypotheses_left >= 1
        chances = [leader.probability for leader in step.belief.leaders]
        assert chances == sorted(chances, reverse=True)


@pytest.mark.parametrize(("number", "settings"), ANY_RUN)
def test_the_same_seed_gives_the_same_run(number: int, settings: RecogniserSettings) -> None:
    once, again = (
        trace(*run(SyntheticRig(BASE.objects[number], around_the_corner(), changing(number)), BASE, settings))
        for _ in range(2)
    )
    assert once == again


def test_other_seeds_walk_other_ways_at_random() -> None:
    paths = {
        tuple(
            s.frame.rig_pose
            for s in run(
                SyntheticRig(BASE.objects[0], around_the_corner()),
                BASE,
                with_views(SETTINGS, policy="random", max_views=4, threshold=1.0, seed=seed),
            )[0]
        )
        for seed in range(3)
    }
    assert len(paths) == 3


@pytest.mark.parametrize("most", [1, 2, 4])
def test_no_run_takes_more_views_than_allowed(most: int) -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner(), faults=Faults(missed=0.5))
    steps, _ = run(bench, BASE, with_views(SETTINGS, max_views=most, threshold=1.0))
    assert len(steps) == len(bench.taken) <= most


@pytest.mark.parametrize("policy", ["information", "random"])
def test_no_pose_is_visited_twice(policy: str) -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner(), faults=Faults(missed=0.4), zooms=(0.0, 1.0))
    steps, _ = run(bench, BASE, with_views(SETTINGS, policy=policy, max_views=5, threshold=1.0))
    assert len(steps) == 5
    assert len(set(bench.taken)) == len(bench.taken)


def test_every_move_is_taken_and_every_choice_is_explained_in_one_sentence() -> None:
    bench = SyntheticRig(BASE.objects[1], around_the_corner(), changing(5), Faults(0.5, 0.2, 2))
    steps, answer = run(bench, BASE)
    for step, after in pairwise(steps):
        assert step.move is not None
        assert after.frame.rig_pose == step.move.target
        assert len(step.move.why.split()) > 4
        assert "\n" not in step.move.why
        assert step.move.cost_s > 0.0
    assert len(answer.why.split()) > 4


def test_the_way_travelled_is_the_sum_of_the_moves() -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner(), faults=Faults(missed=0.4))
    bench.offers = [replace(p, theta_deg=p.theta_deg + 360.0 * (k % 2)) for k, p in enumerate(bench.offers)]
    _, answer = run(bench, BASE, with_views(SETTINGS, max_views=5, threshold=1.0))
    at = np.array([[p.x_mm, p.y_mm, p.z_mm] for p in bench.taken])
    pan = np.array([p.theta_deg for p in bench.taken])
    turns = np.abs((np.diff(pan) + 180.0) % 360.0 - 180.0)
    assert answer.travel_mm == pytest.approx(np.linalg.norm(np.diff(at, axis=0), axis=1).sum())
    assert answer.rotation_deg == pytest.approx(turns.sum())


def test_leaders_point_at_the_detections_that_they_explain() -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner(), faults=Faults(false=2))
    steps, _ = run(bench, BASE)
    last = steps[-1]
    assert last.belief.leaders[0].object_id == "tower"
    matched = [m for m in last.belief.leaders[0].matches if m.detection is not None]
    assert len(matched) >= 2
    for match in matched:
        assert match.detection is not None
        np.testing.assert_allclose(match.predicted_px, last.parts[match.detection].corners_px, atol=6.0)


@pytest.mark.parametrize("number", range(3))
def test_a_run_ends_right_where_the_bench_knows_next_to_nothing(number: int) -> None:
    """Distances from 5 cm to 100 m, any lens from 2 to 120 degrees, a detector of which nothing is known."""
    knows_nothing = with_views(SETTINGS, bounds=BenchBounds(), rates=DetectionRates())
    bench = SyntheticRig(BASE.objects[number], around_the_corner(), changing(number), Faults(0.3, 0.05, 1))
    _, answer = run(bench, BASE, knows_nothing)
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, BASE.objects[number].id)
    assert off(answer, bench)[0] < 45.0
