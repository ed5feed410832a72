"""A scan's order wastes no way back, and comes to one-sided axes always from the same side."""

from __future__ import annotations

from itertools import pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hal import AXES, RigPose
from rig.scan import OneSided, all_legs, serpentine
from rig.scan.order import at_every_zoom

values = st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=4, unique=True)
side_lists = st.lists(
    st.builds(OneSided, st.sampled_from(AXES), st.sampled_from(["below", "above"]), st.just(0.5)),
    unique_by=lambda side: side.axis,
)


def axes_with(given_values: tuple[list[float], ...]) -> list[tuple[str, list[float]]]:
    return list(zip(AXES, given_values, strict=True))


@given(st.tuples(values, values, values, values, values), side_lists)
def test_every_combination_comes_once(lists: tuple[list[float], ...], sides: list[OneSided]) -> None:
    poses = serpentine(axes_with(lists), sides)
    assert len(poses) == len(set(poses))
    assert set(poses) == {RigPose(*row) for row in product(*lists)}


@given(st.tuples(values, values, values, values, values))
def test_a_serpentine_changes_one_axis_by_one_step_at_a_time(lists: tuple[list[float], ...]) -> None:
    for a, b in pairwise(serpentine(axes_with(lists))):
        changed = [axis for axis in AXES if getattr(a, axis) != getattr(b, axis)]
        assert len(changed) == 1
        rising = sorted(dict(axes_with(lists))[changed[0]])
        assert abs(rising.index(getattr(a, changed[0])) - rising.index(getattr(b, changed[0]))) == 1


@given(st.tuples(values, values, values, values, values), side_lists)
def test_one_sided_axes_arrive_from_their_side(lists: tuple[list[float], ...], sides: list[OneSided]) -> None:
    poses = serpentine(axes_with(lists), sides)
    ways, last = all_legs(poses, sides), None
    came: dict[str, float] = {}  # the direction of each axis's last motion
    for pose in poses:
        while last != pose:
            leg = next(ways)
            for side in sides:
                moved = 0.0 if last is None else getattr(leg, side.axis) - getattr(last, side.axis)
                came[side.axis] = moved or came.get(side.axis, 0.0)
            last = leg
        for side in sides:
            assert came[side.axis] * (1.0 if side.side == "below" else -1.0) > 0.0
    assert list(ways) == []


def test_the_first_pose_is_approached_whatever_came_before() -> None:
    sides = [OneSided("x_mm", "below", 2.0)]
    pose, before, beyond = (RigPose(x_mm, 1.0, 1.0, 1.0, 0.0) for x_mm in (10.0, 9.0, 8.0))
    assert list(all_legs([pose], sides)) == [beyond, pose]
    assert list(all_legs([before, pose], sides))[-2:] == [before, pose]
    assert list(all_legs([pose, pose], sides)) == [beyond, pose, pose]


def test_legs_without_one_sided_axes_are_the_poses() -> None:
    poses = serpentine([(axis, [0.0, 1.0]) for axis in AXES])
    assert list(all_legs(poses)) == poses


@pytest.mark.parametrize(
    ("sides", "zooms"),
    [
        ([], [0.0, 0.5, 1.0, 1.0, 0.5, 0.0]),
        ([OneSided("zoom", "above", 0.1)], [1.0, 0.5, 0.0, 1.0, 0.5, 0.0]),
    ],
)
def test_zoom_goes_to_and_fro_unless_it_is_one_sided(sides: list[OneSided], zooms: list[float]) -> None:
    poses = [RigPose(0.0, 0.0, 0.0, 0.0), RigPose(5.0, 0.0, 0.0, 0.0)]
    found = at_every_zoom(poses, [0.5, 0.0, 1.0], sides)
    assert [pose.zoom for pose in found] == zooms
    assert [pose.x_mm for pose in found] == [0.0] * 3 + [5.0] * 3
