"""What is refused before anything moves: limits, keep-out boxes, and the way an axis takes its play up."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration_free_tests.guard.sample import MODEL, RULES, START, TRAVEL
from rig.errors import UnreachableError
from rig.guard import Box, Offers, Rules
from rig.guard.ways import Play, arrived, legs, offers, plan, preflight, refuse_inside, refuse_outside, refuse_way
from rig.guard.ways import seconds as travel_s
from rig.hal import AXES, RigPose

ONE_SIDED = {"x_mm": 2.0, "theta_deg": -1.0}
TAUT = replace(RULES, overshoot=ONE_SIDED)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1000.0, -1000.0])
def test_what_is_beyond_a_limit_or_no_number_is_refused_with_axis_value_limit_and_remedy(
    axis: str, value: float
) -> None:
    limit = getattr(TRAVEL, axis)
    with pytest.raises(UnreachableError) as caught:
        refuse_outside(replace(START, **{axis: value}), TRAVEL, "pose 3: ")
    for told in ("pose 3: ", axis, f"{value:g}", f"{limit.lower:g} .. {limit.upper:g}", "Choose"):
        assert told in str(caught.value)


@pytest.mark.parametrize("axis", AXES)
def test_both_ends_can_be_reached_and_nothing_beyond(axis: str) -> None:
    limit = getattr(TRAVEL, axis)
    for end, beyond in ((limit.lower, limit.lower - 1e-6), (limit.upper, limit.upper + 1e-6)):
        refuse_outside(replace(START, **{axis: end}), TRAVEL)
        with pytest.raises(UnreachableError):
            refuse_outside(replace(START, **{axis: beyond}), TRAVEL)


def test_a_way_through_the_model_is_refused_though_both_ends_are_free() -> None:
    start, end = RigPose(-180.0, 0.0, 150.0, 0.0), RigPose(180.0, 0.0, 150.0, 0.0)
    for pose in (start, end):
        refuse_inside(pose, (MODEL,))
    with pytest.raises(UnreachableError, match=r"through the keep-out box 'model' .*20 mm included.*Go round"):
        refuse_way(start, end, (MODEL,))
    over = [start, replace(start, z_mm=90.0), replace(end, z_mm=90.0), end]
    for a, b in pairwise(over):
        refuse_way(a, b, (MODEL,))


def test_the_surface_of_a_box_belongs_to_it() -> None:
    for place in ((50.0, 0.0, 150.0), (0.0, -50.0, 150.0), (0.0, 0.0, 100.0)):
        with pytest.raises(UnreachableError, match="lies within the keep-out box 'model'"):
            refuse_inside(RigPose(*place, 0.0), (MODEL,))
    refuse_inside(RigPose(50.001, 0.0, 150.0, 0.0), (MODEL,))


def test_a_rig_that_stands_inside_may_lead_out_and_not_go_deeper_or_across() -> None:
    inside = RigPose(40.0, 0.0, 150.0, 0.0)
    refuse_way(inside, inside, (MODEL,))
    refuse_way(inside, RigPose(80.0, 0.0, 150.0, 0.0), (MODEL,))
    for deeper_mm in (30.0, -80.0):
        with pytest.raises(UnreachableError, match="leads through"):
            refuse_way(inside, RigPose(deeper_mm, 0.0, 150.0, 0.0), (MODEL,))


coordinates = st.tuples(st.floats(-100, 100), st.floats(-100, 100), st.floats(50, 250))


@given(start=coordinates, end=coordinates)
def test_no_point_of_a_way_that_is_let_through_is_in_the_box(
    start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    def inside(share: float) -> bool:
        at = [a + (b - a) * share for a, b in zip(start, end, strict=True)]
        return all(low + 1e-6 < x < high - 1e-6 for low, x, high in zip(MODEL.lower, at, MODEL.upper, strict=True))

    if not inside(0.0) and any(inside(k / 200) for k in range(201)):
        with pytest.raises(UnreachableError):
            refuse_way(RigPose(*start, 0.0), RigPose(*end, 0.0), (MODEL,))


def test_every_axis_with_play_arrives_from_its_own_side() -> None:
    here, there = RigPose(50, -25, 40, 0, 0.5), RigPose(30, -25, 40, 10, 0.5)
    assert legs(Play(here), there, ONE_SIDED) == [RigPose(28, -25, 40, 11, 0.5), there]


def test_nothing_overshoots_that_goes_on_its_way_with_the_play_taken_up() -> None:
    here, there = RigPose(50, -25, 40, 0, 0.5), RigPose(60, -30, 40, -10, 0.5)
    assert legs(arrived(here, ONE_SIDED), there, ONE_SIDED) == [there]
    assert legs(Play(here), there, ONE_SIDED) == [RigPose(58, -30, 40, -9, 0.5), there]
    assert legs(arrived(here, ONE_SIDED), here, ONE_SIDED) == [here]


@given(
    visits=st.lists(st.tuples(st.floats(-190, 190), st.floats(-80, 80)), min_size=1, max_size=8),
)
def test_whatever_came_before_the_last_leg_of_an_axis_goes_its_own_way_or_does_not_move_it(
    visits: list[tuple[float, float]],
) -> None:
    play, here = Play(START), START
    for x, theta in visits:
        target = replace(START, x_mm=x, theta_deg=theta)
        way = legs(play, target, ONE_SIDED)
        before = way[-2] if len(way) > 1 else here
        # Nothing of the play is lost meanwhile: it arrives moving its own way, or has not moved since it did.
        assert target.x_mm - before.x_mm >= -1e-9
        assert target.theta_deg - before.theta_deg <= 1e-9
        play, here = arrived(target, ONE_SIDED), target


def test_targets_leave_room_for_the_approach() -> None:
    usable = TAUT.usable
    assert (usable.x_mm.lower, usable.x_mm.upper) == (-198.0, 200.0)
    assert (usable.theta_deg.lower, usable.theta_deg.upper) == (-90.0, 89.0)
    assert usable.y_mm == TRAVEL.y_mm
    with pytest.raises(UnreachableError, match=r"x_mm = -199 is outside -198 \.\. 200"):
        plan(TAUT, Play(START), replace(START, x_mm=-199.0))


def test_an_approach_through_a_box_is_refused_though_the_place_and_the_straight_way_are_free() -> None:
    beside = Box("post", (100.0, -10.0, 0.0), (108.9, 10.0, 20.0))
    rules = replace(RULES, keep_out=(beside,), overshoot={"x_mm": 2.0})
    target = RigPose(110.0, 0.0, 10.0, 0.0)
    plan(rules, arrived(replace(target, x_mm=109.0), rules.overshoot), target)
    with pytest.raises(UnreachableError, match="leads through the keep-out box 'post'"):
        plan(rules, Play(replace(target, x_mm=150.0)), target)


@pytest.mark.parametrize(
    ("second", "why"),
    [
        (RigPose(201.0, 0.0, 0.0, 0.0), r"x_mm = 201 is outside"),
        (RigPose(0.0, 0.0, 150.0, 0.0), r"lies within the keep-out box"),
        (RigPose(180.0, 0.0, 150.0, 0.0), r"leads through the keep-out box"),
        (RigPose(0.0, 0.0, 0.0, math.nan), r"theta_deg = nan"),
    ],
)
def test_a_plan_is_refused_by_the_number_of_its_first_bad_pose(second: RigPose, why: str) -> None:
    first = RigPose(-180.0, 0.0, 150.0, 0.0)
    preflight(RULES, Play(START), [first, first])
    for play in (Play(START), None):
        with pytest.raises(UnreachableError, match=f"pose 2 of 3: .*{why}"):
            preflight(RULES, play, [first, second, first])


def test_a_plan_whose_first_way_is_blocked_is_refused_where_it_is_known_from_where_it_begins() -> None:
    beyond = RigPose(180.0, 0.0, 150.0, 0.0)
    with pytest.raises(UnreachableError, match="pose 1 of 1"):
        preflight(RULES, Play(RigPose(-180.0, 0.0, 150.0, 0.0)), [beyond])
    preflight(RULES, None, [beyond])


def test_what_is_offered_can_be_gone_to_and_lies_on_the_lattice() -> None:
    rules = replace(TAUT, offers=Offers(step_mm=30.0, step_deg=20.0, zooms=(0.0, 0.5), reach=2))
    near = RigPose(-80.0, 0.0, 130.0, 85.0, 0.0)
    found = offers(rules, near)
    assert len(found) == len(set(found)) > 10
    for pose in found:
        plan(rules, Play(near), pose)
        assert (pose.x_mm - rules.usable.x_mm.lower) % 30.0 == pytest.approx(0.0, abs=1e-9)
        assert pose.zoom in (0.0, 0.5)
    everywhere = offers(replace(rules, keep_out=()), near)
    assert {pose for pose in everywhere if -50 <= pose.x_mm <= 50 and pose.z_mm >= 100} - set(found)


def test_devices_move_one_after_the_other_in_the_time_that_is_told() -> None:
    end = replace(START, x_mm=20.0, y_mm=-40.0, theta_deg=60.0, zoom=1.0)
    assert travel_s(TRAVEL, START, end) == pytest.approx(2.0 + 2.0 + 2.0 + 0.3 + 0.05)


def test_a_tolerance_is_that_of_the_axis() -> None:
    tolerance = Rules(TRAVEL).tolerance
    assert [tolerance.of(axis) for axis in AXES] == [0.05, 0.05, 0.05, 0.1, 0.01]
