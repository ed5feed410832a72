"""A run knows which views it has taken, wherever the rig says that it stood."""

from __future__ import annotations

from dataclasses import replace

import pytest

from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    SyntheticRig,
    around_the_corner,
    three_buildings,
    with_views,
    world_of,
)
from recognition.belief import Belief
from recognition.journey import Journey
from rig.hal import Frame, RigPose

BASE = three_buildings()


class Imprecise(SyntheticRig):
    """Stands 3 mm from where it was sent, and reads that back."""

    def capture(self) -> Frame:
        frame = super().capture()
        return replace(frame, rig_pose=replace(frame.rig_pose, x_mm=frame.rig_pose.x_mm + 3.0))


def travel(bench: SyntheticRig, views: int) -> Journey:
    journey = Journey(bench, world_of(BASE), with_views(SETTINGS, max_views=3))
    for pose in bench.offers[:views]:
        bench.move_to(pose)
        frame = bench.capture()
        journey.add(frame, list(bench.detect(frame.image)))
    return journey


@pytest.mark.parametrize("kind", [SyntheticRig, Imprecise])
def test_views_taken_are_not_offered_again_however_poses_are_read_back(kind: type[SyntheticRig]) -> None:
    bench = kind(BASE.objects[0], around_the_corner())
    journey = travel(bench, 2)
    assert journey.fresh(bench.pose) == bench.offers[2:]
    assert journey.path[0].x_mm - bench.offers[0].x_mm == (3.0 if kind is Imprecise else 0.0)


def test_a_journey_ends_with_the_views_allowed_and_counts_no_return() -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner())
    journey = travel(bench, 2)
    journey.came_back(bench.offers[0])
    assert not journey.at_its_end
    assert journey.path == [bench.offers[0], bench.offers[1], bench.offers[0]]
    assert travel(bench, 3).at_its_end


@pytest.mark.parametrize("vouched", [False, True])
def test_views_share_internals_only_where_the_rig_vouches_for_their_zoom(vouched: bool) -> None:
    bench = SyntheticRig(BASE.objects[0], around_the_corner(), internals_fixed_by_zoom=vouched, zooms=(0.0, 1.0))
    journey = travel(bench, 3)
    assert [view.group for view in journey.views] == ([0, 1, 0] if vouched else [0, 1, 2])
    offers: list[RigPose] = bench.offers[3:5]
    asked = journey.situation(Belief.empty(), bench.pose, offers, sure=False)
    assert asked.groups == ([1, 0] if vouched else [None, None])
