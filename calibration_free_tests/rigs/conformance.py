"""What every rig must do, real or mock: derive a class from `RigConformance` and give it a `rig` fixture."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rig.errors import UnreachableError
from rig.hal import Rig, RigPose

AXES = ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom")


def goes_round(rig: Rig) -> bool:
    return rig.limits.theta_deg.upper - rig.limits.theta_deg.lower >= 360.0


class RigConformance:
    """The contract of ``rig.hal.Rig``; ``tolerance`` is how far a pose read back may be from the one commanded."""

    tolerance_mm = 1e-6
    tolerance_deg = 1e-6

    def same_place(self, a: RigPose, b: RigPose) -> bool:
        turn = (a.theta_deg - b.theta_deg + 180.0) % 360.0 - 180.0
        return (
            max(abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm), abs(a.z_mm - b.z_mm)) <= self.tolerance_mm
            and abs(turn) <= self.tolerance_deg
            and abs(a.zoom - b.zoom) <= 1e-6
        )

    def some(self, rig: Rig, count: int = 5) -> list[RigPose]:
        offers = rig.reachable()
        return [offers[k] for k in np.linspace(0, len(offers) - 1, min(count, len(offers))).astype(int)]

    def test_it_is_a_rig(self, rig: Rig) -> None:
        assert isinstance(rig, Rig)

    def test_it_is_a_context_manager_and_closes_twice(self, rig: Rig) -> None:
        with rig as entered:
            assert entered is rig
        rig.close()
        rig.close()

    def test_it_offers_different_poses_within_its_limits(self, rig: Rig) -> None:
        offers = rig.reachable()
        assert len(offers) > 1
        assert len(set(offers)) == len(offers)
        for axis in AXES:
            limit = getattr(rig.limits, axis)
            assert limit.lower <= limit.upper
            assert limit.speed_per_s > 0
            if not (axis == "theta_deg" and goes_round(rig)):
                assert all(limit.lower - 1e-6 <= getattr(pose, axis) <= limit.upper + 1e-6 for pose in offers)

    def test_offers_near_a_pose_can_be_reached(self, rig: Rig) -> None:
        for pose in self.some(rig, 3):
            near = rig.reachable(pose)
            assert near
            assert self.same_place(rig.move_to(near[len(near) // 2]), near[len(near) // 2])

    def test_a_wish_for_an_offer_snaps_to_itself(self, rig: Rig) -> None:
        for pose in self.some(rig):
            assert self.same_place(rig.nearest(pose), pose)

    def test_a_snapped_wish_can_be_reached(self, rig: Rig) -> None:
        limits, offer = rig.limits, rig.reachable()[0]
        middle = {a: (getattr(limits, a).lower + getattr(limits, a).upper) / 2 for a in AXES}
        off = RigPose(*(0.98 * getattr(offer, axis) + 0.02 * middle[axis] for axis in AXES))
        snapped = rig.nearest(off)
        assert self.same_place(rig.move_to(snapped), snapped)

    def test_moving_ends_where_it_was_told_to(self, rig: Rig) -> None:
        for pose in self.some(rig):
            back = rig.move_to(pose)
            assert back == rig.pose
            assert self.same_place(back, pose)

    def test_a_wish_for_where_it_stands_is_no_error(self, rig: Rig) -> None:
        for pose in self.some(rig):
            rig.move_to(pose)
            rig.nearest(rig.pose)

    @pytest.mark.parametrize("axis", AXES)
    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_what_is_not_finite_is_refused_by_axis(self, rig: Rig, axis: str, value: float) -> None:
        wish = replace(rig.reachable()[0], **{axis: value})
        before = rig.pose
        for ask in (rig.nearest, rig.move_to):
            with pytest.raises(UnreachableError, match=axis):
                ask(wish)
        assert rig.pose == before

    @pytest.mark.parametrize("axis", AXES)
    @pytest.mark.parametrize("end", ["lower", "upper"])
    def test_beyond_a_limit_is_refused_by_axis_value_and_limit(self, rig: Rig, axis: str, end: str) -> None:
        if axis == "theta_deg" and goes_round(rig):
            # Nothing lies beyond limits that meet: such a rig has no poses that this could refuse.
            pytest.skip("the pan goes round")
        limit = getattr(getattr(rig.limits, axis), end)
        value = round(limit) + (-7.0 if end == "lower" else 7.0)
        before = rig.pose
        for ask in (rig.nearest, rig.move_to):
            with pytest.raises(UnreachableError) as caught:
                ask(replace(rig.reachable()[0], **{axis: value}))
            for told in (axis, f"{value:g}", f"{limit:g}"):
                assert told in str(caught.value)
        assert rig.pose == before

    def test_a_frame_tells_where_it_was_taken(self, rig: Rig) -> None:
        pose = self.some(rig)[1]
        rig.move_to(pose)
        frame = rig.capture()
        assert frame.rig_pose == rig.pose
        assert self.same_place(frame.commanded, pose)
        assert frame.name
        assert frame.image.dtype == np.uint8
        assert frame.image.ndim == 2 or frame.image.shape[2] == 3

    def test_frames_are_counted_and_later_ones_are_later(self, rig: Rig) -> None:
        frames = []
        for pose in self.some(rig, 3):
            rig.move_to(pose)
            frames += [rig.capture()]
        assert [f.sequence for f in frames] == [frames[0].sequence + k for k in range(len(frames))]
        assert all(a.exposed_at_s < b.exposed_at_s for a, b in pairwise(frames))

    def test_travel_takes_time_and_as_long_there_as_back(self, rig: Rig) -> None:
        here, *others = self.some(rig)
        for there in others:
            assert rig.travel_s(here, there) == pytest.approx(rig.travel_s(there, here))
            assert rig.travel_s(here, there) > rig.travel_s(here, here) >= 0.0
