"""Every policy, by its name, on what a rig may look at next before synthetic buildings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import entry_points

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    Faults,
    SyntheticRig,
    base_of,
    before_front,
    believed,
    building,
    regular,
    run,
    seen_from,
    with_views,
)
from calibration_free_tests.recognition.test_policies import AWAY, BASE, pose_of, situation
from recognition.belief import Belief
from recognition.geometry import CameraPose
from recognition.hypotheses import Hypotheses
from recognition.modelbase import ModelBase
from recognition.policies import Situation, load_policy
from recognition.steps import Outcome
from rig.errors import InputError
from rig.hal import RigPose

ALL = sorted(point.name for point in entry_points(group="rig.policies"))
PLANNED = [name for name in ALL if name not in ("paper", "random")]
TELLING = before_front(480.0)
ELSEWHERE = [AWAY, CameraPose(170.0, 500.0, 100.0, -500.0), CameraPose(190.0, 200.0, 300.0, -500.0)]
SOME = [before_front(480.0), before_front(300.0, 260.0), CameraPose(80.0, 1090.0, 200.0, 200.0), AWAY]


def few(now: Situation, count: int) -> Situation:
    """With the leading hypotheses only."""
    p = now.belief.probability[:count]
    rest = 1.0 if count == 0 else 0.2
    belief = Belief(now.belief.hypotheses.take(np.arange(count)), (1.0 - rest) * p / max(p.sum(), 1e-9), rest)
    return replace(now, belief=belief)


@pytest.mark.parametrize("name", ALL)
def test_without_candidates_there_is_no_move(name: str) -> None:
    assert load_policy(name).choose(situation([])) is None


@pytest.mark.parametrize("name", ALL)
def test_the_same_generator_gives_the_same_move(name: str) -> None:
    now = few(situation(SOME), 6)
    moves = [load_policy(name).choose(replace(now, rng=np.random.default_rng(5))) for _ in range(2)]
    assert moves[0] is not None
    assert moves[0] == moves[1]


@pytest.mark.parametrize("name", PLANNED)
@pytest.mark.parametrize("place", range(4))
def test_the_only_view_that_separates_anything_is_chosen(name: str, place: int) -> None:
    cameras = [*ELSEWHERE[:place], TELLING, *ELSEWHERE[place:]]
    chosen = load_policy(name).choose(few(situation(cameras), 8))
    assert chosen is not None
    assert chosen.target == pose_of(TELLING)
    assert chosen.gain_bits > 0.0


@pytest.mark.parametrize("name", PLANNED)
def test_each_says_what_it_expects_what_that_costs_and_what_it_separates(name: str) -> None:
    chosen = load_policy(name).choose(few(situation(SOME, cost_s=[2.0, 3.0, 4.0, 5.0]), 6))
    assert chosen is not None
    said = re.match(
        r"expects (\d+\.\d\d) bits for (\d\.\d) s and tells (.+) from (.+?)(?: and \d+ more.*)?: .+", chosen.why
    )
    assert said is not None, chosen.why
    assert float(said[2]) == chosen.cost_s
    things = "tower|mill|barn"
    assert re.match(rf"(?:{things}) (?:front|side|out of)|none of these", said[3])
    assert re.match(rf"(?:{things}) (?:front|side|out of)|none of these", said[4])
    assert "\n" not in chosen.why


@pytest.mark.parametrize("name", PLANNED)
def test_before_anything_was_recognised_something_new_is_looked_at(name: str) -> None:
    now = situation(SOME)
    now = replace(now, belief=Belief(Hypotheses.empty(now.views), np.empty(0), 1.0))
    chosen = load_policy(name).choose(now)
    assert chosen is not None
    assert "not seen yet" in chosen.why
    assert chosen.gain_bits == 0.0


@pytest.mark.parametrize("name", ALL)
def test_a_single_hypothesis_is_told_from_none_of_these(name: str) -> None:
    chosen = load_policy(name).choose(few(situation([*ELSEWHERE, TELLING]), 1))
    assert chosen is not None
    if name in PLANNED:
        assert chosen.target == pose_of(TELLING)
        assert "none of these" in chosen.why


@pytest.mark.parametrize("name", PLANNED)
def test_once_the_place_is_settled_all_sharpen_the_pose(name: str) -> None:
    now = situation([AWAY, before_front(520.0, turn_deg=-20.0)], sure=True)
    chosen = load_policy(name).choose(now)
    assert chosen is not None
    assert chosen.target == now.candidates[1]
    assert "sharpens the pose" in chosen.why


@pytest.fixture(name="twins", scope="module")
def _twins() -> Situation:
    """Fifteen views of one of two equal buildings."""
    twins = base_of(building("tower", 0), building("copy", 0))
    cameras = [before_front(x, turn_deg=t) for x in (260.0, 400.0, 520.0, 330.0, 460.0) for t in (0.0, 15.0, -15.0)]
    now = situation(cameras, base=twins)
    views = [seen_from(twins, twins.objects[0], camera) for camera in cameras]
    return replace(now, belief=believed(now.world, views)[1], views=views)


@pytest.mark.parametrize("name", PLANNED)
def test_what_no_reachable_view_can_separate_is_given_up_at_once(name: str, twins: Situation) -> None:
    assert load_policy(name).choose(twins) is None


@pytest.mark.parametrize("name", [name for name in PLANNED if name != "optimal"])
def test_a_building_is_recognised_by_each(name: str) -> None:
    cameras = [before_front(x, y) for x in np.arange(160.0, 640.0, 120.0) for y in (140.0, 260.0)]
    rig = SyntheticRig(BASE.objects[1], cameras, faults=Faults(0.3, 0.05, 1), seed=2)
    steps, answer = run(rig, BASE, with_views(SETTINGS, policy=name, max_views=9))
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, "mill")
    assert len(steps) < 9


# --- each by itself -------------------------------------------------------------------------------------------------


def test_information_prefers_the_quicker_way_and_the_prior_systems_do_not_ask() -> None:
    now = few(situation([before_front(480.0), before_front(470.0)], cost_s=[9.0, 1.0]), 8)
    quick = load_policy("information").choose(now)
    assert quick is not None
    assert quick.cost_s == 1.0
    swapped = replace(now, cost_s=now.cost_s[::-1].copy())
    for name in ("transinformation", "entropy", "dempster_shafer", "reveal", "pose_volume"):
        moves = [load_policy(name).choose(one) for one in (now, swapped)]
        assert moves[0] is not None
        assert moves[1] is not None
        assert moves[0].target == moves[1].target, name


def test_reveal_goes_where_parts_come_into_sight_that_no_view_has_shown() -> None:
    been, side = before_front(300.0, turn_deg=15.0), CameraPose(90.0, 1090.0, 200.0, 220.0)
    again = CameraPose(been.theta_deg, been.x_mm + 8.0, been.y_mm, been.z_mm)
    chosen = load_policy("reveal").choose(few(situation([again, side]), 3))
    assert chosen is not None
    assert chosen.target == pose_of(side)


def test_pose_volume_looks_from_another_direction() -> None:
    been, aslant = before_front(300.0, turn_deg=15.0), before_front(420.0, turn_deg=-25.0)
    chosen = load_policy("pose_volume").choose(few(situation([been, aslant]), 3))
    assert chosen is not None
    assert chosen.target == pose_of(aslant)
    assert "sharpened under all hypotheses" in chosen.why


def a_view_later(now: Situation, base: ModelBase, cameras: Sequence[CameraPose], target: RigPose) -> Situation:
    """The move was made, and the first object of the base was seen from there."""
    camera = next(camera for camera in cameras if pose_of(camera) == target)
    views = [*now.views, replace(seen_from(base, base.objects[0], camera), group=len(now.views))]
    left = [pose for pose in now.candidates if pose != target]
    return replace(
        now,
        views=views,
        belief=believed(now.world, views)[1],
        pose=target,
        visited=(*now.visited, target),
        candidates=left,
        groups=[None] * len(left),
        cost_s=np.ones(len(left)),
    )


def test_a_tree_is_followed_while_the_belief_holds_it_and_planned_anew_where_not() -> None:
    base = base_of(regular("wall"), building("tower", 0))
    cameras = [before_front(x, y) for x in (160.0, 260.0, 400.0, 520.0, 700.0, 860.0) for y in (140.0, 260.0, 380.0)]
    said = []
    for moved_mm in (0.0, 400.0):
        policy = load_policy("offline_tree")
        now = situation(cameras, base=base, first=before_front(420.0, 220.0))
        first = policy.choose(now)
        assert first is not None
        assert "planned now" in first.why
        later = a_view_later(now, base, cameras, first.target)
        later.belief.hypotheses.placement[:, 2] += moved_mm
        second = policy.choose(later)
        assert second is not None
        assert second.target in later.candidates
        said.append(second.why)
    assert said[0].endswith("the next view of the tree planned before")
    assert re.search(r"tells wall front \d\.\d+ from wall front \d\.\d+", said[0])
    assert "planned before" not in said[1]


def test_the_optimum_is_planned_where_few_are_left_and_refused_where_many_are() -> None:
    now = situation(SOME)
    chosen = load_policy("optimal").choose(few(now, 6))
    assert chosen is not None
    assert "fewest views to come" in chosen.why
    many = replace(now, candidates=list(now.candidates) * 20, groups=[None] * 80, cost_s=np.ones(80), most=60)
    with pytest.raises(InputError, match="80 reachable views are left to plan over, 60 at most"):
        load_policy("optimal").choose(many)
