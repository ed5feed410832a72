"""Weights are a distribution, "none of these" always competes, and nothing is gone for good."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    Faults,
    base_of,
    before_front,
    believed,
    building,
    camera_of,
    changing,
    in_rig,
    regular,
    rig_pose,
    seen_from,
    three_buildings,
    true_rows,
    world_of,
)
from recognition import belief as belief_module
from recognition.belief import Belief, challengers, rivals, thin, update, weigh
from recognition.geometry import CameraPose, Pose4
from recognition.hypotheses import Hypotheses, join
from recognition.seen import Seen
from recognition.settings import Effort
from recognition.tracking import World, look_in

BASE = three_buildings()
CAMERAS = [
    before_front(300.0, turn_deg=15.0),
    before_front(480.0, 200.0, 360.0, turn_deg=-10.0),
    before_front(600.0, 180.0, turn_deg=20.0),
    before_front(220.0, 230.0, 340.0, turn_deg=-15.0),
]


def views_of(thing: int, cameras: list[CameraPose], faults: Faults | None = None) -> list[Seen]:
    lens = changing(thing)
    return [
        seen_from(
            BASE, BASE.objects[thing], c, group=k, internals=lens(k, rig_pose(c)), faults=faults, seed=10 * thing + k
        )
        for k, c in enumerate(cameras)
    ]


@pytest.fixture(name="world", scope="module")
def _world() -> World:
    return world_of(BASE)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_probabilities_sum_to_one_best_first(world: World, count: int) -> None:
    _, belief = believed(world, views_of(1, CAMERAS[:count], Faults(0.3, 0.1, 2)))
    assert belief.probability.sum() + belief.none == pytest.approx(1.0)
    assert (np.diff(belief.probability) <= 0).all()
    assert belief.by_object(3).sum() == pytest.approx(1.0 - belief.none)


def test_an_objects_probability_is_the_sum_over_its_configurations(world: World) -> None:
    _, belief = believed(world, views_of(2, CAMERAS[:1]))
    by_object = belief.by_object(3)
    for k in range(3):
        assert by_object[k] == pytest.approx(belief.probability[belief.hypotheses.object_of == k].sum())


def test_before_any_view_nothing_is_known() -> None:
    belief = Belief.empty()
    assert (belief.none, belief.entropy_bits, belief.left) == (1.0, 0.0, 0)


def test_entropy_is_that_of_even_and_of_sure_beliefs() -> None:
    even = Belief(Hypotheses.empty(), np.full(15, 1 / 16), 1 / 16)
    assert even.entropy_bits == pytest.approx(4.0)
    assert even.left == 15
    assert Belief(Hypotheses.empty(), np.array([1.0, 0.0]), 0.0).entropy_bits == 0.0
    assert Belief(Hypotheses.empty(), np.array([0.9985, 0.001, 0.0005]), 0.0).left == 2


def test_views_narrow_the_belief_down(world: World) -> None:
    views = views_of(0, CAMERAS)
    entropy = [believed(world, views[:n])[1].entropy_bits for n in (1, 2, 4)]
    assert entropy[0] > 1.0
    assert entropy[2] < 0.1 < entropy[0]
    assert entropy[1] < entropy[0]


def test_an_empty_first_view_leaves_everything_open(world: World) -> None:
    empty = seen_from(BASE, None, CameraPose(180.0, 300.0, 200.0, -500.0), group=0)
    hypotheses, belief = believed(world, [empty])
    assert len(hypotheses) == 0
    assert belief.none == 1.0
    later = [empty, *(replace(v, group=v.group + 1) for v in views_of(1, CAMERAS[:3]))]
    _, after = believed(world, later)
    assert after.probability[true_rows(after.hypotheses, later[-1], 1, CAMERAS[2], 30.0)].sum() > 0.95


def test_an_empty_view_where_parts_are_expected_is_evidence_and_no_end(world: World) -> None:
    views = views_of(0, CAMERAS[:2])
    before = believed(world, views)[1]
    blind = seen_from(BASE, None, CAMERAS[2], group=2)
    after = weigh(world, update(world, before.hypotheses, [*views, blind], Effort()))
    assert after.none > before.none
    assert len(after.hypotheses) > 0
    assert np.isfinite(after.probability).all()
    third = replace(views_of(0, CAMERAS)[3], group=3)
    hypotheses = update(world, after.hypotheses, [*views, blind, third], Effort())
    healed = weigh(world, hypotheses)
    assert healed.probability[true_rows(healed.hypotheses, third, 0, CAMERAS[3], 30.0)].sum() > 0.95


def test_a_wrong_first_view_is_overcome_later(world: World) -> None:
    """The first view shows another building by mistake; four views of the right one win where each proposes anew."""
    wrong = seen_from(BASE, BASE.objects[2], CAMERAS[0], group=0)
    right = [replace(v, group=v.group + 1) for v in views_of(1, CAMERAS)]
    views = [wrong, *right]
    effort = Effort()
    _, early = believed(world, views[:1], effort)
    assert early.by_object(3).argmax() == 2
    _, late = believed(world, views, effort)
    assert late.probability[true_rows(late.hypotheses, views[-1], 1, CAMERAS[-1], 30.0)].sum() > 0.95


def test_the_fewer_places_are_left_the_more_ways_each_is_looked_for_in_a_new_view(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def look(*args: object, modes: int = 1, **rest: object) -> Hypotheses:
        asked.append(modes)
        return look_in(*args, modes=modes, **rest)  # type: ignore[arg-type]  # passed on as they come

    monkeypatch.setattr(belief_module, "look_in", look)
    views, most = views_of(1, CAMERAS[:2]), []
    before = update(world, None, views[:1], Effort())
    for kept in (10, 40, 60):
        asked.clear()
        update(world, before.take(np.arange(kept)), views, Effort(refined=100))
        most.append(asked[0])
    assert most == [4, 2, 1]


def test_a_dropped_place_comes_back_when_it_explains_what_is_seen(world: World) -> None:
    views = views_of(1, CAMERAS[:3])
    hypotheses, _ = believed(world, views[:2])
    others = hypotheses.take(np.flatnonzero(hypotheses.object_of != 1))
    assert len(others)
    belief = weigh(world, update(world, others, views, Effort()))
    assert belief.probability[true_rows(belief.hypotheses, views[-1], 1, CAMERAS[2], 30.0)].sum() > 0.9


def test_a_place_that_was_dropped_challenges_who_would_win_without_it(world: World) -> None:
    views = views_of(1, CAMERAS[:3])
    found = challengers(world, views, Effort())
    best_of_all = found.take(np.array([int(found.log_weight.argmax())]))
    assert true_rows(best_of_all, views[-1], 1, CAMERAS[2], 30.0) == [0]


def test_nothing_challenges_where_nothing_was_seen(world: World) -> None:
    assert len(challengers(world, [seen_from(BASE, None, CAMERAS[0])], Effort())) == 0


def test_with_no_evidence_none_of_these_keeps_its_share(world: World) -> None:
    nothing = weigh(world, Hypotheses.empty())
    assert nothing.none == pytest.approx(1.0)
    hypotheses, _ = believed(world, views_of(0, CAMERAS[:1]))
    silent = replace(hypotheses, odds=np.full_like(hypotheses.odds, -60.0))
    assert weigh(world, silent).none > 0.999


def test_of_two_that_place_the_camera_alike_the_better_stays(world: World) -> None:
    views = views_of(0, CAMERAS[:2])
    hypotheses, _ = believed(world, views)
    best = hypotheses.take(np.array([0]))
    shifted = replace(best, placement=best.placement + np.array([0.0, 0.5, 0.0, 0.0]), odds=best.odds - 1.0)
    left = thin(join(shifted, best), views[-1], 10)
    assert len(left) == 1
    assert np.array_equal(left.placement, best.placement)
    far = replace(best, placement=best.placement + np.array([0.0, 300.0, 0.0, 0.0]), odds=best.odds - 1.0)
    assert len(thin(join(far, best), views[-1], 10)) == 2
    other = replace(best, object_of=np.array([1]))
    assert len(thin(join(other, best), views[-1], 10)) == 2


def test_thinning_keeps_the_best_in_order(world: World) -> None:
    views = views_of(0, CAMERAS[:1])
    hypotheses, _ = believed(world, views)
    few = thin(hypotheses, views[-1], 7)
    assert len(few) == 7
    assert (np.diff(few.log_weight) <= 0).all()
    assert few.log_weight[0] == hypotheses.log_weight.max()


def test_rivals_of_a_place_in_a_repeated_wing_include_its_twin() -> None:
    """Views taken to follow one wing never propose the other; before the end it competes all the same."""
    twin = base_of(building("tower", 0), building("copy", 0))
    world = world_of(twin)
    views = [seen_from(twin, twin.objects[0], c, group=k) for k, c in enumerate(CAMERAS[:2])]
    hypotheses, _ = believed(world, views)
    mine = true_rows(hypotheses, views[-1], 0, CAMERAS[1], 30.0)[0]
    challengers = rivals(world, hypotheses, views, mine)
    same = true_rows(challengers, views[-1], 1, CAMERAS[1], 30.0)
    assert same
    assert challengers.log_weight[same].max() == pytest.approx(hypotheses.log_weight[mine], abs=1.0)


def test_all_places_of_a_regular_wall_stay_in_the_race() -> None:
    block = regular("block", columns=10, rows=3)
    base = base_of(block)
    world = world_of(base)
    camera = before_front(400.0, 155.0, 250.0)
    views = [seen_from(base, block, camera)]
    _, belief = believed(world, views)
    leaders = belief.hypotheses.take(np.flatnonzero(belief.probability > 0.2 * belief.probability[0]))
    places = {round(camera_of(leaders, k, views[0]).x_mm / 80.0) for k in range(len(leaders))}
    assert len(places) >= 4
    assert belief.entropy_bits > 2.0


def test_the_frame_of_the_rig_does_not_matter(world: World) -> None:
    views = views_of(1, CAMERAS[:2], Faults(0.3, 0.05, 1))
    _, here = believed(world, views)
    there = [
        replace(v, camera=in_rig(c, Pose4(-140.0, 12.0, 345.0, -678.0))) for v, c in zip(views, CAMERAS, strict=False)
    ]
    _, elsewhere = believed(world, there)
    assert np.allclose(here.probability[:3], elsewhere.probability[:3], atol=1e-3)
    assert np.allclose(
        camera_of(here.hypotheses, 0, views[1]).centre_mm,
        camera_of(elsewhere.hypotheses, 0, there[1]).centre_mm,
        atol=0.2,
    )
