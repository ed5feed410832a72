"""The rendered rig keeps the contract of a rig, repeats itself, and never shows the truth."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from calibration_free_tests.renderer.bench_building import building, part_on, wall_face
from recognition.geometry import Mount, Pose4, camera_in_object, camera_in_rig
from recognition.modelbase import ObjectModel
from rig.errors import InputError, UnreachableError
from rig.hal import Frame, Rig, RigPose
from sim_backends.internals_policy import ChangingInternals, FixedByZoom
from sim_backends.rendered_rig import Lattice, RenderedRig
from sim_backends.renderer import Scene
from sim_backends.viewpoints import Plan, draw_placement, limits_around, viewing_poses
from sim_backends.walls import walls_of

PLACE = Pose4(7.0, 30.0, 5.0, -60.0)
SIZE = (320, 240)
MODEL = building()
POSES = viewing_poses(MODEL, PLACE, (250.0,), step_mm=120.0, zooms=(0.0, 1.0))
COURT = ((-240.0, 0.0), (0.0, 0.0), (0.0, 200.0), (240.0, 200.0), (240.0, 400.0), (-240.0, 400.0))


def make_rig(offers: Lattice | list[RigPose] = POSES, **changes: Any) -> RenderedRig:
    return RenderedRig(Scene(MODEL, PLACE), limits_around(POSES), offers, size=SIZE, **changes)


def test_it_is_a_rig() -> None:
    with make_rig() as rig:
        assert isinstance(rig, Rig)
        frame = rig.capture()
        assert frame.image.shape == (240, 320, 3)
        assert frame.rig_pose == rig.pose == POSES[0]


def test_a_revisit_gives_the_same_picture_and_another_seed_another_one() -> None:
    rig = make_rig()
    first = rig.capture().image
    rig.move_to(POSES[5])
    assert not np.array_equal(rig.capture().image, first)
    rig.move_to(POSES[0])
    assert np.array_equal(rig.capture().image, first)
    assert np.array_equal(make_rig().capture().image, first)
    assert not np.array_equal(make_rig(seed=1).capture().image, first)


def test_internals_fixed_by_zoom_change_with_the_zoom_only() -> None:
    rig = make_rig()
    assert rig.internals_fixed_by_zoom
    by_zoom = {zoom: {rig.truth(p).internals for p in POSES if p.zoom == zoom} for zoom in (0.0, 1.0)}
    assert [len(by_zoom[z]) for z in (0.0, 1.0)] == [1, 1]
    (wide,), (tele,) = by_zoom[0.0], by_zoom[1.0]
    assert 2 * np.degrees(np.arctan(160 / wide.fx)) == pytest.approx(40, abs=0.2)
    assert 2 * np.degrees(np.arctan(160 / tele.fx)) == pytest.approx(20, abs=0.2)


def test_internals_that_change_every_view_differ_but_repeat() -> None:
    rig = make_rig(internals=ChangingInternals(FixedByZoom()))
    assert not rig.internals_fixed_by_zoom
    drawn = [rig.truth(p).internals for p in POSES if p.zoom == 0.0]
    assert len(set(drawn)) == len(drawn)
    assert drawn == [rig.truth(p).internals for p in POSES if p.zoom == 0.0]
    aspect = np.array([i.fy / i.fx for i in drawn])
    assert 0.01 < aspect.std() < 0.03
    assert 25 < np.std([i.u0 for i in drawn]) < 55


def test_frames_carry_no_truth() -> None:
    assert {f.name for f in dataclasses.fields(Frame)} == {
        *("image", "rig_pose", "commanded", "name", "sequence", "exposed_at_s")
    }


def test_truth_is_the_camera_in_the_object_frame() -> None:
    mount = Mount(10.0, 0.0, 25.0)
    rig = make_rig(mount=mount)
    pose = POSES[7]
    assert rig.truth(pose).camera_in_object == camera_in_object(camera_in_rig(pose, mount), PLACE)


@pytest.mark.parametrize(
    "wish",
    [RigPose(1e6, 0, 0, 0), RigPose(float("nan"), 0, 0, 0), RigPose(0, 0, 0, 500.0), RigPose(0, 0, 0, 0, 1.5)],
)
def test_wishes_beyond_the_limits_are_refused(wish: RigPose) -> None:
    for rig in (make_rig(), make_rig(Lattice())):
        with pytest.raises(UnreachableError, match=r"x_mm|theta_deg|zoom"):
            rig.nearest(wish)
        with pytest.raises(UnreachableError):
            rig.move_to(wish)


def test_poses_that_are_not_offered_are_refused() -> None:
    rig = make_rig()
    near = dataclasses.replace(POSES[0], x_mm=POSES[0].x_mm + 1.0)
    with pytest.raises(UnreachableError, match="nearest"):
        rig.move_to(near)
    assert rig.nearest(near) == POSES[0]
    with pytest.raises(InputError):
        make_rig([])


def test_a_lattice_offers_poses_around_a_place_clear_of_walls() -> None:
    rig = make_rig(Lattice(reach=2), start=POSES[0])
    offers = rig.reachable(POSES[0])
    assert len(set(offers)) == len(offers) > 100
    plan, back = Plan.of(walls_of(MODEL)), PLACE.inverse()
    centres = np.array([[p.x_mm, p.y_mm, p.z_mm] for p in offers]) @ back.rotation.T + back.translation_mm
    assert plan.distance_mm(centres[:, [0, 2]]).min() >= 60.0 - 1e-5
    assert not plan.inside(centres[:, [0, 2]]).any()
    snapped = rig.nearest(POSES[3])
    assert snapped in rig.reachable(POSES[3])
    assert rig.move_to(snapped) == snapped
    inside = camera_in_object_to_rig(0.0, -150.0, 160.0)
    with pytest.raises(UnreachableError, match="wall"):
        rig.move_to(inside)


def camera_in_object_to_rig(x: float, y: float, z: float) -> RigPose:
    at = PLACE.rotation @ [x, y, z] + PLACE.translation_mm
    return RigPose(float(at[0]), float(at[1]), float(at[2]), 0.0)


@pytest.mark.parametrize("footprint", [None, COURT])
def test_viewing_poses_look_at_every_wall_and_stand_clear(footprint: tuple[tuple[float, float], ...] | None) -> None:
    model = building(footprint) if footprint else MODEL
    place = draw_placement(np.random.default_rng(4))
    poses = viewing_poses(model, place, (100.0, 220.0))
    plan, back = Plan.of(walls_of(model)), place.inverse()
    centres = np.array([[p.x_mm, p.y_mm, p.z_mm] for p in poses]) @ back.rotation.T + back.translation_mm
    assert plan.distance_mm(centres[:, [0, 2]]).min() >= 60.0 - 1e-5
    assert not plan.inside(centres[:, [0, 2]]).any()
    rig = RenderedRig(Scene(model, place), limits_around(poses), poses, size=SIZE)
    shown = {part.id[:2] for pose in poses[:: max(1, len(poses) // 60)] for part in rig.parts(pose)}
    assert shown == {wall.id for wall in walls_of(model)}


def test_the_plan_knows_inside_outside_and_what_stands_between() -> None:
    plan = Plan.of(walls_of(building(COURT)))
    spots = np.array([[-120.0, 100.0], [120.0, 100.0], [120.0, 300.0], [0.0, -100.0]])
    np.testing.assert_array_equal(plan.inside(spots), [True, False, True, False])
    np.testing.assert_allclose(plan.distance_mm(spots), [100.0, 100.0, 100.0, 100.0])
    clear = plan.clear_between(np.array([120.0, 100.0]), np.array([[120.0, -500.0], [-300.0, 100.0], [500.0, 100.0]]))
    np.testing.assert_array_equal(clear, [True, False, True])


def test_no_station_looks_through_another_wall() -> None:
    # Two parallel walls, both facing -Z: stations of the rear one 300 mm in front of it would lie before the front one.
    front, rear = (
        wall_face(n, np.array([-200.0, 0, z]), np.array([200.0, 0, z]), 200.0) for n, z in (("A", 0), ("B", 200))
    )
    parts = tuple(part_on(face, f"p{face.id}", "DW4", 180.0, 80.0, 30.0, 40.0, 0.0) for face in (front, rear))
    model = ObjectModel("two walls", parts, (front, rear))
    both = viewing_poses(model, Pose4(0, 0, 0, 0), (300.0,), pans_deg=(0.0,), step_mm=80.0)
    assert {round(p.z_mm) for p in both if abs(p.x_mm) < 200} == {-300}


def test_most_viewing_poses_show_a_whole_part() -> None:
    rig = RenderedRig(Scene(MODEL, PLACE), limits_around(POSES), POSES, size=SIZE)
    wide = [p for p in POSES if p.zoom == 0.0]
    whole = [any(q.fully_in_frame and q.visible_fraction == 1 for q in rig.parts(p)) for p in wide]
    assert np.mean(whole) > 0.85


def test_the_placement_is_never_trivial() -> None:
    for seed in range(50):
        place = draw_placement(np.random.default_rng(seed))
        assert 2.0 <= abs(place.theta_deg) <= 12.0
        assert np.linalg.norm(place.translation_mm) > 1.0
