"""What a view says of a hypothesis: parts found and missed, graded, and capped so that no view decides for good."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.recognition.synthetic import (
    SIZE,
    Faults,
    base_of,
    before_front,
    building,
    visible,
    world_of,
)
from calibration_free_tests.recognition.synthetic import detections as detected
from recognition.association import match
from recognition.likelihood import edge_log_odds, part_log_odds, view_log_odds
from recognition.parts import DetectedPart
from recognition.rates import DetectionRates
from recognition.seen import see
from recognition.visibility import Pairs
from rig.errors import InputError

FloatArray = npt.NDArray[np.float64]
CAMERA = before_front(400.0)
TOWER = building("tower", 0)
BASE = base_of(TOWER)
WORLD = world_of(BASE)
RATES = DetectionRates(found=0.9, clutter=1.0, corner_sd_px=0.5)
DENSE = DetectionRates(found=0.9, clutter=5000.0, corner_sd_px=2.0)
"""So much clutter that a part in its place is no sensation: what it brings stays below the cap on parts."""


def odds(
    parts: list[DetectedPart] | None = None,
    *,
    offset_px: float = 0.0,
    rates: DetectionRates = RATES,
    cosine: float = 1.0,
    blur_px: float = 0.0,
) -> FloatArray:
    """Log odds of all parts in the picture, expected ``offset_px`` aside of where they are."""
    shown = visible(TOWER, CAMERA)
    if parts is None:
        parts = detected(shown, Faults(), np.random.default_rng(0))
    ids = np.array([WORLD.layout.part_ids.index(part.id) for part, _ in shown])
    corners = np.array([px for _, px in shown]) + offset_px
    pairs = Pairs(np.zeros(len(ids), dtype=np.int64), ids, corners, np.full(len(ids), cosine))
    seen = see(parts, CAMERA, SIZE, 0, 0.0, WORLD.layout.class_names, 4)
    matching = match(WORLD.layout, pairs, seen, np.full(len(ids), 12.0))
    return part_log_odds(
        WORLD.layout, matching, seen, rates, np.full(len(ids), blur_px), np.full(len(ids), rates.corner_sd_px)
    )


def test_a_part_found_where_expected_speaks_for_and_a_missed_one_against() -> None:
    assert (odds() > 3.0).all()
    missed = odds(parts=[])
    assert missed == pytest.approx(np.full(len(missed), math.log(1 - RATES.found)))


def test_farther_corners_speak_less() -> None:
    near, aside, far = (odds(offset_px=d, rates=DENSE).mean() for d in (0.2, 3.0, 4.0))
    assert near > aside > far


def test_a_bad_corner_is_doubt_and_no_veto() -> None:
    """Heavy tails: a part whose corners are off by many sd costs little more than a missed one."""
    assert odds(offset_px=7.0).min() > math.log(1 - RATES.found) - 6.0


def test_a_worse_fit_counts_less_even_where_the_cap_binds() -> None:
    exact, aside, far = (odds(offset_px=d).mean() for d in (0.0, 1.0, 2.0))
    assert exact == pytest.approx(RATES.part_cap)
    assert exact > aside > far


def test_a_fit_within_one_sd_is_as_good_as_any() -> None:
    assert odds(offset_px=0.3).mean() == pytest.approx(RATES.part_cap)


def test_what_stands_in_the_place_is_never_worse_than_nothing() -> None:
    """However bad the fit, the part may have been missed and the detection be clutter."""
    assert odds(offset_px=7.0).min() >= math.log(1 - RATES.found)


def test_the_likelier_class_speaks_louder() -> None:
    shown = visible(TOWER, CAMERA)
    sure = [DetectedPart(px, {p.part_class: 0.98}, 1.0) for p, px in shown]
    other = {"DW4": "OPEN", "OPEN": "DW4"}
    unsure = [DetectedPart(px, {p.part_class: 0.2, other[p.part_class]: 0.6}, 1.0) for p, px in shown]
    assert (odds(sure, rates=DENSE, offset_px=6.0) > odds(unsure, rates=DENSE, offset_px=6.0)).all()


def test_a_part_brings_no_more_than_its_cap() -> None:
    for clutter in (0.1, 1.0, 80.0):
        rates = DetectionRates(0.9, clutter, 0.5)
        assert odds(rates=rates).max() <= rates.part_cap


def test_a_missed_part_weighs_less_where_it_is_seen_obliquely() -> None:
    assert (odds(parts=[], cosine=0.25) > odds(parts=[], cosine=0.9)).all()


def test_a_missed_part_weighs_less_where_it_may_lie_beyond_the_frame() -> None:
    """Guessed internals move the prediction: what is expected near the border may not be in the picture at all."""
    sure, unsure = odds(parts=[]), odds(parts=[], blur_px=80.0)
    assert (unsure >= sure).all()
    assert unsure.max() > 0.6 * sure.min()


def test_a_missed_part_weighs_more_the_better_the_detector_is() -> None:
    poor, good = (odds(parts=[], rates=DetectionRates(found)).mean() for found in (0.5, 0.98))
    assert good < poor < 0


def one_view(parts: list[float], rates: DetectionRates = RATES) -> float:
    values = np.array(parts)
    found = values > 0
    return float(view_log_odds(1, np.zeros(len(values), dtype=np.int64), values, found, rates)[0])


def test_more_parts_found_say_more_and_more_missed_say_less() -> None:
    assert one_view([4.0, 4.0]) > one_view([4.0]) > one_view([4.0, -2.3]) > one_view([4.0, -2.3, -2.3])


def test_no_view_brings_or_takes_without_bounds() -> None:
    best = one_view([9.0] * 100)
    explained = 100 * math.log1p(1 / RATES.clutter)
    assert best <= RATES.view_cap + explained + 1e-9
    assert one_view([-2.3] * 1000) >= -RATES.view_cap


def test_one_bad_view_can_be_made_good_by_good_ones() -> None:
    """Nothing is eliminated for good: two views that fit outweigh one in which all was missed."""
    assert one_view([-5.0] * 1000) + 2 * one_view([8.0] * 8) > 0


def test_a_view_in_which_nothing_is_expected_says_nothing() -> None:
    assert (
        view_log_odds(3, np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=bool), RATES).tolist() == [0] * 3
    )


def test_each_hypothesis_gets_its_own_parts() -> None:
    mixed = view_log_odds(3, np.array([0, 2, 2]), np.array([4.0, -2.0, 4.0]), np.array([True, False, True]), RATES)
    assert mixed[0] == pytest.approx(one_view([4.0]))
    assert mixed[1] == 0.0
    assert mixed[2] == pytest.approx(one_view([-2.0, 4.0]))


def test_edges_along_an_outline_speak_for_a_part_and_their_absence_against() -> None:
    score = np.linspace(0, 1, 21)
    value = edge_log_odds(score)
    assert (np.diff(value) >= 0).all()
    assert value[0] < 0 < value[-1]
    # A part may be hidden by a tree: bare outlines are evidence, never proof.
    assert value[0] > -4.0


def test_caps_are_lower_among_clutter() -> None:
    clean, cluttered = DetectionRates(0.9, 1.0, 0.5), DetectionRates(0.9, 80.0, 0.5)
    assert cluttered.part_cap < clean.part_cap
    assert cluttered.view_cap < clean.view_cap


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ((0.0, 1.0, 0.5), "found"),
        ((1.0, 1.0, 0.5), "found"),
        ((0.9, 0.0, 0.5), "clutter"),
        ((0.9, 1.0, 0.0), "corner_sd_px"),
        ((math.nan, 1.0, 0.5), "found"),
        ((0.9, math.nan, 0.5), "clutter"),
    ],
)
def test_rates_that_cannot_be_are_refused_by_name(values: tuple[float, float, float], name: str) -> None:
    with pytest.raises(InputError, match=name):
        DetectionRates(*values)
