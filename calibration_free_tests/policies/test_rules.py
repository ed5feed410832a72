"""What each policy is after, on hypotheses and views written out as tables."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from benchmarks.bench_policies import SCORES, Score
from calibration_free_tests.policies.tables import FloatArray, IntArray, graded, tables, told
from recognition.policies.dempster_shafer import ambiguity_bits
from recognition.policies.ec2 import cut_weight
from recognition.policies.entropy import entropy_loss_bits, mask
from recognition.policies.information import bits_per_second
from recognition.policies.outlook import Outlook, classes, entropy_bits
from recognition.policies.pose_volume import mean_pose_bits
from recognition.policies.reveal import newly_shown
from recognition.policies.transinformation import transinformation_bits
from rig.hal import RigPose

Table = tuple[IntArray, FloatArray]


@pytest.mark.parametrize("score", SCORES.values(), ids=SCORES)
def test_the_only_view_that_separates_anything_is_the_best(score: Score) -> None:
    outlook = told([[0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 1, 1], [2, 2, 2, 2]], [0.4, 0.3, 0.2, 0.1])
    assert int(score(outlook).argmax()) == 2


@pytest.mark.parametrize("score", SCORES.values(), ids=SCORES)
def test_a_view_that_tells_all_apart_is_better_than_one_that_tells_two_groups(score: Score) -> None:
    assert int(score(told([[0, 0, 1, 1], [0, 1, 2, 3], [0, 1, 1, 1]])).argmax()) == 1


@given(graded())
@settings(max_examples=60, deadline=None)
def test_information_is_never_negative_and_never_more_than_is_open(outlook: Outlook) -> None:
    assert (outlook.bits >= 0.0).all()
    assert (outlook.bits <= entropy_bits(outlook.probability) + 1e-9).all()


@given(graded())
@settings(max_examples=60, deadline=None)
def test_a_view_tells_no_more_of_the_object_than_of_the_place_on_it(outlook: Outlook) -> None:
    of_object = transinformation_bits(outlook)
    assert (of_object >= 0.0).all()
    assert (of_object <= outlook.bits + 1e-9).all()


def test_transinformation_prefers_telling_objects_to_telling_places() -> None:
    by_place = told([[0, 1, 0, 1], [0, 0, 1, 1]])
    outlook = Outlook(by_place.weight, by_place.apart, by_place.cost_s, by_place.place, np.array([5, 5, 9, 9]))
    assert transinformation_bits(outlook) == pytest.approx([0.0, 1.0])
    assert outlook.bits == pytest.approx([1.0, 1.0])


@given(tables())
@settings(max_examples=60, deadline=None)
def test_without_errors_information_entropy_and_ambiguity_agree(table: Table) -> None:
    outlook = Outlook.of_table(*table)
    assert entropy_loss_bits(outlook) == pytest.approx(outlook.bits, abs=1e-6)
    left = entropy_bits(outlook.probability) - outlook.bits
    assert ambiguity_bits(outlook, support=1.0) == pytest.approx(left, abs=1e-6)


def test_what_agrees_within_the_gate_leaves_the_ambiguity_as_it_is() -> None:
    near = told([[0, 1]])
    within = Outlook(near.weight, np.where(near.apart > 0, 1.0, 0.0), near.cost_s, near.place, near.object_of)
    assert ambiguity_bits(within) == pytest.approx(1.0)
    assert ambiguity_bits(near)[0] < 0.2


@given(tables(views=6))
@settings(max_examples=80, deadline=None)
def test_edges_that_a_view_cuts_are_no_more_after_another_observation(table: Table) -> None:
    """Adaptive submodularity of EC2 (Golovin, Krause & Ray): the bound on its cost rests on it."""
    observation, weight = table
    outlook = Outlook.of_table(observation, weight)
    before = cut_weight(outlook)
    for seen in observation:
        for shown in np.unique(seen):
            after = cut_weight(outlook.among(np.flatnonzero(seen == shown).tolist()))
            assert (after <= before + 1e-9).all()


def test_edges_join_different_places_only() -> None:
    two = told([[0, 1, 0, 1], [0, 0, 1, 1]])
    outlook = Outlook(two.weight, two.apart, two.cost_s, np.array([7, 7, 8, 8]), two.object_of)
    # Four edges of weight 1; telling the places apart cuts all, telling across them leaves one of each pair's two.
    assert cut_weight(outlook) == pytest.approx([3.0, 4.0])


def test_of_two_equal_views_the_quicker_brings_more_bits_a_second() -> None:
    same = told([[0, 1], [0, 1]])
    outlook = Outlook(same.weight, same.apart, np.array([4.0, 2.0]), same.place, same.object_of)
    assert bits_per_second(outlook) == pytest.approx([0.25, 0.5])


def test_the_mask_shuns_views_near_those_taken() -> None:
    here = RigPose(0.0, 0.0, 0.0, 0.0)
    offers = [here, RigPose(5.0, 0.0, 0.0, 0.0), RigPose(100.0, 0.0, 0.0, 0.0), RigPose(0.0, 0.0, 0.0, 359.0)]
    low = mask(offers, [here])
    assert low[0] == 0.0
    assert 0.0 < low[1] < 0.5 < low[2] <= 1.0
    assert low[3] < 0.2, "a degree short of a full turn is near"


def test_a_pose_is_sharpened_on_the_average_of_the_hypotheses() -> None:
    bits = np.array([[4.0, 0.0], [1.0, 2.0]])
    assert mean_pose_bits(np.array([0.2, 0.2]), bits) == pytest.approx([2.0, 1.5])
    assert mean_pose_bits(np.array([0.1, 0.4]), bits).argmax() == 1


def test_parts_not_seen_yet_count_by_the_weight_and_the_chance_of_seeing_them() -> None:
    parts = newly_shown(np.array([0.75, 0.25]), np.array([0, 1, 1]), np.array([0, 0, 2]), np.array([1.0, 0.5, 1.0]), 3)
    assert parts == pytest.approx([0.875, 0.0, 0.25])


@given(tables())
@settings(max_examples=60, deadline=None)
def test_classes_are_those_that_show_the_same(table: Table) -> None:
    observation, weight = table
    found = classes(Outlook.of_table(observation, weight))
    assert ((found[:, :, None] == found[:, None]) == (observation[:, :, None] == observation[:, None])).all()


def test_the_heaviest_hypothesis_heads_its_class() -> None:
    outlook = told([[0, 0, 0, 1]], [0.1, 0.5, 0.2, 0.2])
    assert classes(outlook).tolist() == [[1, 1, 1, 3]]
