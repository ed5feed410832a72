"""Zoom is a move: wide to see more parts, tight to resolve small ones or to measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    SyntheticRig,
    base_of,
    before_front,
    believed,
    in_rig,
    regular,
    rig_pose,
    seen_from,
    three_buildings,
    world_of,
)
from recognition.geometry import CameraPose, Mount
from recognition.journey import Journey
from recognition.modelbase import ModelBase
from recognition.policies import Situation
from recognition.policies.information import InformationPolicy
from recognition.predict import Prediction

BASE = three_buildings()
HUT = base_of(regular("hut", columns=2, rows=2), regular("shed", columns=3, rows=1))
WIDE, TIGHT = 0.0, 1.0


def zooming(camera: CameraPose, *, base: ModelBase = BASE, first: CameraPose, sure: bool = False) -> Situation:
    """One place to go to, wide or tight, after one view from another."""
    world = world_of(base)
    views = [seen_from(base, base.objects[0], first)]
    offers = [rig_pose(in_rig(camera), zoom) for zoom in (WIDE, TIGHT)]
    return Situation(
        world=world,
        belief=believed(world, views)[1],
        views=views,
        pose=rig_pose(in_rig(first)),
        visited=(rig_pose(in_rig(first)),),
        candidates=offers,
        groups=[None] * 2,
        cost_s=np.ones(2),
        sure=sure,
        mount=Mount(),
        most=60,
        rng=np.random.default_rng(0),
    )


def leading(prediction: Prediction, candidate: int) -> tuple[np.ndarray, np.ndarray]:
    """Lesser sides, px, of the parts that the leading hypothesis expects, and how surely it expects them."""
    shown = prediction.shown
    mine = (shown.candidate == candidate) & (shown.hypothesis == 0)
    return np.ptp(shown.pairs.corners_px[mine], axis=1).min(axis=1), shown.chance[mine]


def chosen_zoom(now: Situation) -> float:
    move = InformationPolicy().choose(now)
    assert move is not None
    return move.target.zoom


def test_the_same_place_at_another_zoom_is_a_candidate_that_costs_the_zoom_s_time() -> None:
    rig = SyntheticRig(BASE.objects[0], [before_front(300.0), before_front(480.0)], zooms=(WIDE, 0.5, TIGHT))
    journey = Journey(rig, world_of(BASE), SETTINGS)
    journey.add(rig.capture(), rig.detect(rig.capture().image))
    now = zooming(before_front(480.0), first=before_front(300.0))
    ahead = journey.situation(now.belief, rig.pose, journey.fresh(rig.pose), sure=False)
    here = [k for k, pose in enumerate(ahead.candidates) if replace(pose, zoom=rig.pose.zoom) == rig.pose]
    assert [ahead.candidates[k].zoom for k in here] == [0.5, TIGHT]
    assert ahead.cost_s[here] == pytest.approx([0.5 + 0.25, 1.0 + 0.25])


def test_near_by_the_view_is_wide_to_show_more_parts() -> None:
    now = zooming(before_front(480.0), first=before_front(300.0, turn_deg=15.0))
    prediction = now.predict()
    sides, _ = leading(prediction, 0)
    assert sides.min() > 40.0, "all are well resolved"
    assert prediction.expected[0, 0] > 2.0 * prediction.expected[1, 0]
    assert chosen_zoom(now) == WIDE


def test_far_away_the_view_is_tight_to_resolve_the_parts() -> None:
    now = zooming(before_front(380.0, 190.0, 2250.0), first=before_front(300.0, turn_deg=15.0))
    prediction = now.predict()
    wide, tight = (leading(prediction, k)[0] for k in (0, 1))
    assert 8.0 < np.median(wide) < 14.0 < tight.min()
    assert prediction.expected[1, 0] > prediction.expected[0, 0]
    assert chosen_zoom(now) == TIGHT


def test_the_smaller_a_part_the_less_it_counts_and_what_is_not_resolved_does_not_count() -> None:
    distances = (1000.0, 1500.0, 2200.0, 2600.0, 4500.0)
    expected, sides = [], []
    for distance in distances:
        now = zooming(before_front(380.0, 190.0, distance), first=before_front(300.0, turn_deg=15.0))
        prediction = now.predict()
        px, chance = leading(prediction, 0)
        sides.append(float(np.median(px)) if len(px) else 0.0)
        expected.append(float(np.median(chance)) if len(px) else 0.0)
    assert sides[0] > 20.0
    assert expected[0] == 1.0
    assert sides[1] < 20.0
    assert sides[2] < 14.0, "smaller than the detector resolves without doubt"
    assert expected[0] > expected[1] > expected[2] > expected[3] > expected[4] == 0.0
    assert expected[2] < 0.55


def test_larger_images_of_the_same_parts_bring_more_bits_about_the_pose() -> None:
    first, there = before_front(90.0, 110.0, turn_deg=10.0), before_front(90.0, 110.0, 900.0)
    now = zooming(there, base=HUT, first=first, sure=True)
    prediction = now.predict()
    wide, tight = (leading(prediction, k)[0] for k in (0, 1))
    assert len(wide) == len(tight) > 0
    assert (tight > 1.5 * wide).all()
    assert prediction.pose_bits[1] > prediction.pose_bits[0] + 0.2
    assert chosen_zoom(now) == TIGHT
