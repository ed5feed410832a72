"""One view of a wall suggests places; the true one is among them, whatever the internals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    BOUNDS,
    SIZE,
    Faults,
    before_front,
    changing,
    in_rig,
    rig_pose,
    seen_from,
    three_buildings,
    visible,
    world_of,
)
from recognition.geometry import CameraPose, Pose4, camera_in_object
from recognition.modelbase import ModelBase
from recognition.proposals import Proposals, focal_range, propose
from recognition.seen import Seen
from recognition.settings import BenchBounds
from recognition.tracking import World
from recognition.visibility import camera_in_objects

CAMERAS = [
    before_front(200.0, turn_deg=25.0),
    before_front(420.0, 240.0, turn_deg=-30.0),
    before_front(560.0, 180.0, 300.0, turn_deg=35.0),
    CameraPose(70.0, 1090.0, 180.0, 200.0),
    before_front(300.0, 230.0, 360.0),
]
CLUTTERED = Faults(noise_px=0.3, missed=0.05, false=2)


def proposed(
    world: World, seen: Seen, *, bounds: BenchBounds = BOUNDS, most: int = 500, per_part: int = 4
) -> Proposals:
    return propose(world.layout, world.around, seen, bounds, anchors=40, most=most, per_part=per_part, focals=3)


def shown_as(base: ModelBase, camera: CameraPose, number: int, faults: Faults = CLUTTERED) -> Seen:
    lens = changing(7)(number, rig_pose(camera))
    return seen_from(base, base.objects[1], camera, internals=lens, faults=faults, seed=number)


@pytest.mark.parametrize("number", range(len(CAMERAS)))
def test_the_true_place_is_proposed_from_one_view(number: int) -> None:
    base = three_buildings()
    world = world_of(base)
    seen = shown_as(base, CAMERAS[number], number)
    found = proposed(world, seen)
    lens = changing(7)(number, rig_pose(CAMERAS[number]))
    truth = {
        world.layout.part_ids.index(p.id, int(world.layout.first[1])): px
        for p, px in visible(base.objects[1], CAMERAS[number], lens)
    }
    right = [
        k
        for k, (part, det) in enumerate(zip(found.part, found.detection, strict=True))
        if int(part) in truth and np.abs(seen.corners_px[det] - truth[int(part)]).max() < 2.0
    ]
    assert right, "the true pair of part and detection is proposed"
    # One place has many pairs and focal lengths; it is the rank among parts tried that counts.
    ahead = {int(p) for p in found.part[: right[0]]}
    assert len(ahead) <= 10


@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_oblique_wall_tells_the_place_of_the_camera_roughly(number: int) -> None:
    base = three_buildings()
    world = world_of(base)
    camera = CAMERAS[number]
    found = proposed(world, shown_as(base, camera, number, Faults()))
    poses = [
        camera_in_object(in_rig(camera), Pose4.of(np.degrees(p[0]), p[1:]))
        for p, part in zip(found.placement, found.part, strict=True)
        if world.layout.object_of[part] == 1
    ]
    off = [float(np.linalg.norm(p.centre_mm - camera.centre_mm)) for p in poses]
    assert min(off) < 80.0


def test_proposals_put_their_part_where_its_detection_is() -> None:
    base = three_buildings()
    world = world_of(base)
    camera = CAMERAS[0]
    seen = shown_as(base, camera, 0, Faults())
    found = proposed(world, seen, most=60)
    pan, centre = camera_in_objects(found.placement, seen.camera_row)
    for k in range(len(found.part)):
        pose = CameraPose(float(np.degrees(pan[k])), *(float(v) for v in centre[k]))
        to_camera = pose.to_camera()
        middle = to_camera.rotation @ world.layout.centre_mm[found.part[k]] + to_camera.translation_mm
        fx, fy, u0, v0 = found.internals[k]
        px = np.array([fx * middle[0] / middle[2] + u0, fy * middle[1] / middle[2] + v0])
        # The image of the middle of a window lies within its outline.
        low, high = seen.corners_px[found.detection[k]].min(axis=0), seen.corners_px[found.detection[k]].max(axis=0)
        assert middle[2] > 0
        assert ((px > low) & (px < high)).all()


def test_proposals_respect_the_bounds_of_the_bench() -> None:
    base = three_buildings()
    world = world_of(base)
    seen = shown_as(base, CAMERAS[2], 2, Faults())
    tight = replace(
        BOUNDS, distance_min_mm=250.0, distance_max_mm=400.0, view_angle_min_deg=40.0, view_angle_max_deg=55.0
    )
    found = proposed(world, seen, bounds=tight)
    low, high = focal_range(tight, SIZE[0])
    assert len(found.part)
    assert ((found.internals[:, 0] >= low * 0.999) & (found.internals[:, 0] <= high * 1.001)).all()


def test_the_focal_range_is_that_of_the_angles_of_view() -> None:
    low, high = focal_range(BenchBounds(view_angle_min_deg=20.0, view_angle_max_deg=90.0), 640)
    assert low == pytest.approx(320.0)
    assert np.degrees(2 * np.arctan(320.0 / high)) == pytest.approx(20.0)


def test_best_supported_come_first_and_no_part_crowds_out_the_others() -> None:
    base = three_buildings()
    world = world_of(base)
    found = proposed(world, shown_as(base, CAMERAS[4], 4), per_part=1, most=10_000)
    pairs = {(int(p), int(d)) for p, d in zip(found.part, found.detection, strict=True)}
    assert len({p for p, _ in pairs}) == len(pairs)
    assert (np.diff(found.score) <= 1e-9).all()


def test_an_empty_view_suggests_nothing() -> None:
    base = three_buildings()
    assert len(proposed(world_of(base), seen_from(base, None, CAMERAS[0])).part) == 0


def test_a_shape_that_is_no_window_suggests_nothing() -> None:
    """A quadrilateral whose sides lean is no upright wall's image."""
    base = three_buildings()
    seen = seen_from(base, base.objects[0], CAMERAS[0])
    angle = np.radians(30.0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    middle = seen.corners_px.mean(axis=1, keepdims=True)
    leaning = replace(seen, corners_px=(seen.corners_px - middle) @ turn + middle)
    assert len(proposed(world_of(base), leaning).part) == 0


def test_the_placement_of_the_object_does_not_matter() -> None:
    """What is proposed is the object relative to the camera, wherever the rig's zero is."""
    base = three_buildings()
    world = world_of(base)
    seen = shown_as(base, CAMERAS[0], 0)
    elsewhere = replace(seen, camera=in_rig(CAMERAS[0], Pose4(-110.0, 40.0, 3.0, -900.0)))
    a, b = proposed(world, seen), proposed(world, elsewhere)
    assert np.array_equal(a.part, b.part)
    for p, q in zip(a.placement[:20], b.placement[:20], strict=True):
        one = camera_in_object(seen.camera, Pose4.of(np.degrees(p[0]), p[1:]))
        two = camera_in_object(elsewhere.camera, Pose4.of(np.degrees(q[0]), q[1:]))
        assert np.allclose(one.centre_mm, two.centre_mm, atol=1e-6)
