"""Policies choose among reachable views not yet taken, and say so when no view can tell more."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    Faults,
    SyntheticRig,
    around_the_corner,
    base_of,
    before_front,
    believed,
    building,
    changing,
    in_rig,
    rig_pose,
    run,
    seen_from,
    three_buildings,
    with_views,
    world_of,
)
from recognition.geometry import CameraPose, Mount
from recognition.modelbase import ModelBase, ObjectModel
from recognition.policies import Situation, load_policy
from recognition.policies.information import InformationPolicy
from recognition.policies.random_walk import RandomPolicy
from rig.errors import InputError
from rig.hal import RigPose

BASE = three_buildings()
FIRST = before_front(300.0, turn_deg=15.0)
AWAY = CameraPose(180.0, 400.0, 200.0, -500.0)


def situation(
    cameras: list[CameraPose],
    *,
    base: ModelBase = BASE,
    first: CameraPose = FIRST,
    thing: ObjectModel | None = None,
    cost_s: list[float] | None = None,
    sure: bool = False,
    most: int = 60,
    seed: int = 0,
) -> Situation:
    """After one view of an object, with these candidates."""
    world = world_of(base)
    views = [seen_from(base, thing or base.objects[0], first)]
    return Situation(
        world=world,
        belief=believed(world, views)[1],
        views=views,
        pose=rig_pose(in_rig(first)),
        visited=(rig_pose(in_rig(first)),),
        candidates=[rig_pose(in_rig(camera)) for camera in cameras],
        groups=[None] * len(cameras),
        cost_s=np.array(cost_s or [1.0] * len(cameras)),
        sure=sure,
        mount=Mount(),
        most=most,
        rng=np.random.default_rng(seed),
    )


def pose_of(camera: CameraPose) -> RigPose:
    return rig_pose(in_rig(camera))


def test_a_view_that_tells_something_is_preferred_to_one_that_shows_nothing() -> None:
    chosen = InformationPolicy().choose(situation([AWAY, before_front(480.0)]))
    assert chosen is not None
    assert chosen.target == pose_of(before_front(480.0))
    assert chosen.gain_bits > 0


def test_of_two_equal_views_the_quicker_is_taken() -> None:
    far, near = (
        InformationPolicy().choose(situation([before_front(480.0)] * 2, cost_s=cost))
        for cost in ([1.0, 9.0], [9.0, 1.0])
    )
    assert far is not None
    assert near is not None
    assert (far.cost_s, near.cost_s) == (1.0, 1.0)


def test_expected_bits_are_no_more_than_there_are() -> None:
    now = situation([before_front(x) for x in (200.0, 400.0, 480.0, 560.0)])
    chosen = InformationPolicy().choose(now)
    assert chosen is not None
    # Sharpening the pose adds a share; the place alone cannot bring more than the entropy.
    assert 0 < chosen.gain_bits <= now.belief.entropy_bits + 1.0
    assert "bits" in chosen.why


def test_once_the_place_is_settled_the_pose_is_sharpened() -> None:
    now = situation([AWAY, FIRST, before_front(520.0, turn_deg=-20.0)], sure=True)
    chosen = InformationPolicy().choose(now)
    assert chosen is not None
    assert chosen.target == now.candidates[2], "a new direction tells more of the pose than the same place again"
    assert "pose" in chosen.why


def test_where_no_reachable_view_can_separate_twins_the_run_says_so_before_its_views_are_used_up() -> None:
    twins = base_of(building("tower", 0), building("copy", 0))
    for seed in range(3):
        rig = SyntheticRig(twins.objects[0], around_the_corner(), changing(seed), Faults(0.3, 0.05, 1), seed=seed)
        steps, answer = run(rig, twins, with_views(SETTINGS, seed=seed, max_views=20))
        assert len(steps) < 15
        assert "no reachable view separates" in answer.why
        assert {c.split(" at ")[0] for c in answer.candidates} == {"tower", "copy"}


def test_equal_objects_known_to_a_millimetre_are_given_up_at_once() -> None:
    twins = base_of(building("tower", 0), building("copy", 0))
    cameras = [before_front(x, turn_deg=t) for x in (260.0, 400.0, 520.0, 330.0, 460.0) for t in (0.0, 15.0, -15.0)]
    now = situation(cameras, base=twins)
    views = [seen_from(twins, twins.objects[0], camera) for camera in cameras]
    _, belief = believed(now.world, views)
    assert belief.probability[:2] == pytest.approx([0.5, 0.5], abs=0.01)
    assert InformationPolicy().choose(replace(now, belief=belief, views=views)) is None


@pytest.mark.parametrize("policy", [InformationPolicy(), RandomPolicy()])
def test_without_candidates_there_is_no_move(policy: InformationPolicy | RandomPolicy) -> None:
    assert policy.choose(situation([])) is None


def test_when_nothing_is_expected_anywhere_something_new_is_looked_at() -> None:
    now = situation([AWAY, CameraPose(170.0, 500.0, 100.0, -500.0)])
    chosen = InformationPolicy().choose(now)
    assert chosen is not None
    assert chosen.gain_bits == 0.0
    assert "not seen yet" in chosen.why


def test_random_draws_all_candidates_evenly() -> None:
    now = situation([before_front(x) for x in (200.0, 300.0, 400.0, 500.0)])
    drawn = Counter(move.target.x_mm for _ in range(800) if (move := RandomPolicy().choose(now)) is not None)
    assert len(drawn) == 4
    assert min(drawn.values()) > 140


def test_information_needs_fewer_views_than_drawing_at_random() -> None:
    taken = dict.fromkeys(("information", "random"), 0)
    for seed in range(6):
        places = around_the_corner()
        cameras = [places[i] for i in np.random.default_rng(seed).permutation(len(places))]
        for name in taken:
            rig = SyntheticRig(BASE.objects[seed % 3], cameras, seed=seed)
            steps, answer = run(rig, BASE, with_views(SETTINGS, policy=name, seed=seed, threshold=0.9999, max_views=20))
            assert answer.object_id == BASE.objects[seed % 3].id
            taken[name] += len(steps)
    assert taken["information"] < taken["random"]


def test_an_unknown_policy_is_refused_with_the_names_of_those_that_exist() -> None:
    with pytest.raises(InputError, match=r"information.*random"):
        load_policy("clairvoyant")
