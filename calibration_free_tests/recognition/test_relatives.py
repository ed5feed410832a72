"""An object that is like a known one, but for some of its parts, is none of these; the known one itself is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    Faults,
    around_the_corner,
    before_front,
    believed,
    changing,
    in_rig,
    rig_pose,
    seen_from,
    three_buildings,
    world_of,
)
from recognition.belief import with_relatives
from recognition.geometry import CameraPose
from recognition.modelbase import ObjectModel
from recognition.rates import DetectionRates
from recognition.relatives import MOST_NATS, log_odds_of_relatives
from recognition.seen import Seen

BASE = three_buildings()
RATES = DetectionRates(found=0.9, clutter=0.2, corner_sd_px=0.7, measured=True)
WORLD = world_of(BASE, RATES)
CAMERAS = around_the_corner(90.0)[::5]


def rebuilt(thing: ObjectModel, share: float, seed: int) -> ObjectModel:
    """The object with a share of its windows half a bay aside, or a third of a storey down."""
    rng = np.random.default_rng(seed)
    moved = rng.random(len(thing.parts)) < share
    shift = np.array([0.0, 26.0, 0.0])
    parts = [replace(p, corners_mm=p.corners_mm + shift) if go else p for p, go in zip(thing.parts, moved, strict=True)]
    return replace(thing, parts=tuple(parts))


def views_of(thing: ObjectModel, cameras: list[CameraPose], faults: Faults | None = None) -> list[Seen]:
    lens = changing(1)
    return [
        seen_from(BASE, thing, c, group=k, internals=lens(k, rig_pose(in_rig(c))), faults=faults, seed=k)
        for k, c in enumerate(cameras)
    ]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_relative_of_a_known_object_is_none_of_these(seed: int) -> None:
    views = views_of(rebuilt(BASE.objects[0], 0.3, seed), CAMERAS)
    _, before = believed(WORLD, views)
    after = with_relatives(WORLD, before, views)
    assert after.none > 0.9
    assert after.none + after.probability.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("thing", [0, 1, 2])
def test_the_known_object_itself_is_not_though_the_detector_misses_as_many_as_it_is_said_to(thing: int) -> None:
    views = views_of(BASE.objects[thing], CAMERAS, Faults(0.3, missed=0.1))
    _, before = believed(WORLD, views)
    after = with_relatives(WORLD, before, views)
    assert after.none < 0.05


def test_one_view_says_no_more_than_the_cap() -> None:
    """A view in which nothing at all is found, where a dozen parts are expected."""
    cameras = [before_front(300.0, turn_deg=15.0), before_front(480.0, 200.0, 360.0, turn_deg=-10.0)]
    views = views_of(BASE.objects[0], cameras)
    hypotheses, _ = believed(WORLD, views)
    known = log_odds_of_relatives(WORLD, hypotheses.take(np.array([0])), views)
    blind = replace(views[1], corners_px=views[1].corners_px[:0], corner_count=views[1].corner_count[:0])
    blind = replace(
        blind,
        sigma_px=blind.sigma_px[:0],
        class_score=blind.class_score[:0],
        likeness=blind.likeness[:0],
        source=blind.source[:0],
        foremost=blind.foremost[:0],
    )
    after = log_odds_of_relatives(WORLD, hypotheses.take(np.array([0])), [views[0], blind])
    assert 1.0 < after[0] - known[0] <= 2 * MOST_NATS


def test_where_rates_are_guessed_no_relatives_compete() -> None:
    views = views_of(rebuilt(BASE.objects[0], 0.3, 1), CAMERAS)
    guessed = replace(WORLD, rates=replace(RATES, measured=False))
    _, before = believed(guessed, views)
    assert with_relatives(guessed, before, views) == before


def test_detections_that_a_place_does_not_explain_speak_for_a_relative_of_it() -> None:
    plain, strange = (views_of(BASE.objects[0], CAMERAS[:3], Faults(0.0, 0.0, false=k)) for k in (0, 3))
    hypotheses, _ = believed(WORLD, plain)
    lead = hypotheses.take(np.array([int(hypotheses.log_weight.argmax())]))
    assert log_odds_of_relatives(WORLD, lead, strange)[0] > log_odds_of_relatives(WORLD, lead, plain)[0] + 2.0
