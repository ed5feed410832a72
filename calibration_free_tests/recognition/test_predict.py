"""What hypotheses would see from elsewhere, and how much seeing it would tell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.recognition.synthetic import (
    INTERNALS,
    SIZE,
    before_front,
    believed,
    in_rig,
    rig_pose,
    seen_from,
    three_buildings,
    visible,
    world_of,
)
from recognition.belief import Belief
from recognition.geometry import CameraPose, Mount, rotation_y
from recognition.hypotheses import Hypotheses
from recognition.predict import Prediction, distances, information_bits, predict, sample
from recognition.seen import Seen
from recognition.tracking import World
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]
BASE = three_buildings()
FIRST = before_front(300.0, turn_deg=15.0)
ELSEWHERE = [before_front(480.0), before_front(200.0, 260.0, turn_deg=10.0), CameraPose(180.0, 400.0, 200.0, -500.0)]
weights = st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=8).map(np.array)


@pytest.fixture(name="situation", scope="module")
def _situation() -> tuple[World, Belief, list[Seen]]:
    world = world_of(BASE)
    views = [seen_from(BASE, BASE.objects[0], FIRST)]
    return world, believed(world, views)[1], views


def predicted(
    situation: tuple[World, Belief, list[Seen]], cameras: list[CameraPose], mount: Mount | None = None, most: int = 40
) -> Prediction:
    world, belief, views = situation
    poses = [rig_pose(in_rig(camera)) for camera in cameras]
    rng = np.random.default_rng(0)
    return predict(world, belief, views, poses, [0] * len(poses), mount or Mount(), most=most, rng=rng)


@given(weights)
@settings(max_examples=40, deadline=None)
def test_pictures_that_are_all_alike_tell_nothing(weight: FloatArray) -> None:
    assert information_bits(weight, np.zeros((len(weight), len(weight)))) == pytest.approx(0.0, abs=1e-9)


@given(weights)
@settings(max_examples=40, deadline=None)
def test_pictures_that_all_differ_tell_the_whole_entropy(weight: FloatArray) -> None:
    p = weight / weight.sum()
    apart = np.where(np.eye(len(p), dtype=bool), 0.0, 1e3)
    assert information_bits(weight, apart) == pytest.approx(float(-(p * np.log2(p)).sum()), abs=1e-9)


@given(weights, st.floats(0.0, 5.0), st.floats(0.0, 5.0))
@settings(max_examples=40, deadline=None)
def test_pictures_farther_apart_tell_no_less(weight: FloatArray, near: float, more: float) -> None:
    apart = 1.0 - np.eye(len(weight))
    assert information_bits(weight, (near + more) * apart) >= information_bits(weight, near * apart) - 1e-9


def test_telling_two_groups_apart_tells_the_entropy_of_the_groups() -> None:
    group = np.array([0, 0, 1, 1])
    apart = 1e3 * (group[:, None] != group[None])
    assert information_bits(np.full(4, 0.25), apart) == pytest.approx(1.0)


def test_each_hypothesis_expects_the_parts_that_it_would_see(situation: tuple[World, Belief, list[Seen]]) -> None:
    _, belief, _ = situation
    prediction = predicted(situation, ELSEWHERE)
    assert belief.hypotheses.object_of[prediction.rows[0]] == 0
    for k, camera in enumerate(ELSEWHERE):
        # The leading hypothesis is the truth, a few millimetres off.
        assert prediction.expected[k, 0] == pytest.approx(len(visible(BASE.objects[0], camera, INTERNALS)), abs=2)
        assert prediction.pictures[k].cells.sum(axis=1) == pytest.approx(prediction.expected[k])
    assert prediction.expected[2].sum() == 0.0, "with its back to everything nothing is expected"


def test_none_of_these_expects_nothing_and_weighs_what_it_weighs(situation: tuple[World, Belief, list[Seen]]) -> None:
    prediction = predicted(situation, ELSEWHERE)
    assert prediction.weight[-1] == situation[1].none
    assert (prediction.expected[:, -1] == 0).all()
    assert all((p.cells[-1] == 0).all() for p in prediction.pictures)


def test_a_view_of_nothing_tells_nothing(situation: tuple[World, Belief, list[Seen]]) -> None:
    prediction = predicted(situation, ELSEWHERE)
    tell = [information_bits(prediction.weight, distances(p, situation[0], SIZE[0])) for p in prediction.pictures]
    assert tell[2] == pytest.approx(0.0, abs=1e-9)
    assert max(tell[:2]) > 0.1
    assert max(tell) <= situation[1].entropy_bits + 1e-6


def test_the_same_view_again_would_tell_the_places_little(situation: tuple[World, Belief, list[Seen]]) -> None:
    again, new = predicted(situation, [FIRST, ELSEWHERE[0]]).pictures
    weight = predicted(situation, [FIRST]).weight
    assert information_bits(weight, distances(again, situation[0], SIZE[0])) < information_bits(
        weight, distances(new, situation[0], SIZE[0])
    )


def test_distances_are_those_of_a_symmetric_comparison(situation: tuple[World, Belief, list[Seen]]) -> None:
    apart = distances(predicted(situation, ELSEWHERE).pictures[0], situation[0], SIZE[0])
    assert np.allclose(apart, apart.T)
    assert (np.diag(apart) == 0).all()
    assert apart.max() <= situation[0].rates.view_cap


def test_a_new_place_sharpens_the_pose_and_a_view_of_nothing_does_not(
    situation: tuple[World, Belief, list[Seen]],
) -> None:
    world, belief, views = situation
    sure = Belief(belief.hypotheses, np.eye(1, len(belief.probability))[0], 0.0)
    bits = predicted((world, sure, views), ELSEWHERE).pose_bits
    assert bits[0] > 1.0
    assert bits[2] == 0.0


def test_the_lever_arm_of_the_mount_is_taken_into_account(situation: tuple[World, Belief, list[Seen]]) -> None:
    world, belief, views = situation
    arm = Mount(x_mm=30.0, y_mm=-10.0, z_mm=45.0)
    camera = in_rig(ELSEWHERE[0])
    back = rotation_y(np.radians(camera.theta_deg)).T @ [arm.x_mm, arm.y_mm, arm.z_mm]
    x, y, z = camera.centre_mm - back
    there = RigPose(float(x), float(y), float(z), camera.theta_deg)
    rng = np.random.default_rng(0)
    moved = predict(world, belief, views, [there], [0], arm, most=40, rng=rng)
    assert np.array_equal(moved.expected, predicted(situation, ELSEWHERE[:1]).expected)


def test_a_sample_keeps_the_most_probable_and_all_of_the_probability() -> None:
    p = np.sort(np.random.default_rng(3).dirichlet(np.full(300, 0.3)))[::-1] * 0.9
    belief = Belief(Hypotheses.empty(), p, 0.1)
    rows, weight = sample(belief, 40, np.random.default_rng(0))
    assert weight.sum() == pytest.approx(0.9)
    assert rows[:20].tolist() == list(range(20))
    assert len(rows) <= 40
    assert len(set(rows.tolist())) == len(rows)
    few, all_of_it = sample(belief, 1000, np.random.default_rng(0))
    assert np.array_equal(few, np.arange(300))
    assert np.array_equal(all_of_it, p)


def test_hypotheses_two_millimetres_apart_are_told_apart_by_no_view(
    situation: tuple[World, Belief, list[Seen]],
) -> None:
    """Not even by one in which a nudge takes a part out of the frame or turns a wall out of sight."""
    world, belief, views = situation
    near = belief.hypotheses.take(np.array([0, 0]))
    near.placement[1] += [0.0, 2.0, 0.0, 1.5]
    pair = Belief(near, np.array([0.5, 0.5]), 0.0)
    oblique = [CameraPose(80.0, 1000.0 + x, 200.0, -105.0 - 2 * x) for x in range(0, 60, 3)]
    border = [before_front(x) for x in np.arange(250.0, 330.0, 2.0)]
    prediction = predicted((world, pair, views), [*oblique, *border])
    assert prediction.expected.max() > 3.0
    tell = [information_bits(prediction.weight, distances(p, world, SIZE[0])) for p in prediction.pictures]
    assert max(tell) < 0.15


@pytest.mark.parametrize(("group", "told"), [(0, True), (None, False)])
def test_a_shifted_picture_tells_places_apart_only_where_the_internals_are_known(
    situation: tuple[World, Belief, list[Seen]], group: int | None, told: bool
) -> None:
    """An unknown principal point moves the whole picture as much as a neighbouring place would."""
    world, belief, views = situation
    two = belief.hypotheses.take(np.array([0, 0]))
    two.placement[1] += [0.0, 25.0, 0.0, 0.0]
    pair = Belief(two, np.array([0.5, 0.5]), 0.0)
    camera = in_rig(ELSEWHERE[0])
    there = RigPose(*(float(v) for v in camera.centre_mm), camera.theta_deg)
    rng = np.random.default_rng(0)
    pictures = predict(world, pair, views, [there], [group], Mount(), most=40, rng=rng).pictures[0]
    apart = distances(pictures, world, SIZE[0])[0, 1]
    assert (apart > 5.0) == told
