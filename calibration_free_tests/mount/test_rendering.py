"""Pictures from a mount that is not perfect: where points fall, the truth that goes along, and a roll undone."""

from __future__ import annotations

import numpy as np
import pytest

from calibration_free_tests.renderer.bench_building import building, camera_at
from recognition.geometry import Mount, Pose4, camera_in_object, camera_in_rig, rig_pose_for
from recognition.levelling import levelled
from rig.hal import Frame
from sim_backends.appearance import Sensor
from sim_backends.projection import Internals, View
from sim_backends.rendered_rig import RenderedRig
from sim_backends.renderer import Scene
from sim_backends.viewpoints import limits_around, viewing_poses

PLACE = Pose4(7.0, 30.0, 5.0, -60.0)
SIZE = (320, 240)
MODEL = building()
CAMERA = camera_at(10.0, -60.0, -150.0, -260.0, PLACE)
BENT = Mount(30.0, -12.0, 25.0, 15.0, 1.5, -1.0, 1.02, 0.98, 1.01, 0.5, -0.4, 0.3)


def rig_of(mount: Mount | None) -> RenderedRig:
    poses = [rig_pose_for(CAMERA, mount)]
    return RenderedRig(
        Scene(MODEL, PLACE), limits_around(poses), poses, size=SIZE, mount=mount, sensor=Sensor(noise_sd=0.0)
    )


def test_a_point_is_seen_where_the_design_says() -> None:
    points, pose = np.array([[0.0, -100.0, 0.0], [120.0, -40.0, 0.0]]), rig_pose_for(CAMERA, BENT)
    internals = Internals(440.0, 440.0, 159.5, 119.5)
    seen = View.of(camera_in_rig(pose, BENT), PLACE, internals, SIZE, BENT.tilt).pixels(points)
    in_rig = points @ PLACE.rotation.T + PLACE.translation_mm
    roll, pitch, pan, theta = np.radians([BENT.roll_deg, BENT.pitch_deg, BENT.pan_zero_deg, pose.theta_deg])
    about_z = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])

    def about_y(a: float) -> np.ndarray:
        return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])

    centre = BENT.axes @ [pose.x_mm, pose.y_mm, pose.z_mm] + about_y(theta).T @ [30.0, -12.0, 25.0]
    x, y, z = about_x @ about_z @ about_y(theta + pan) @ (in_rig - centre).T
    np.testing.assert_allclose(seen, np.stack([440 * x / z + 159.5, 440 * y / z + 119.5], axis=1), atol=1e-9)


def test_the_same_camera_takes_the_same_picture_however_it_hangs_if_it_is_upright() -> None:
    upright = Mount(30.0, -12.0, 25.0, 15.0, 0.0, 0.0, 1.02, 0.98, 1.01, 0.5, -0.4, 0.3)
    plain = rig_of(None).capture().image.astype(int)
    assert np.abs(rig_of(upright).capture().image.astype(int) - plain).max() <= 1
    assert np.abs(rig_of(BENT).capture().image.astype(int) - plain).mean() > 2


def test_the_truth_and_the_parts_are_those_of_the_bent_mount() -> None:
    rig = rig_of(BENT)
    assert rig.truth().camera_in_object == camera_in_object(camera_in_rig(rig.pose, BENT), PLACE)
    internals = rig.truth().internals
    view = View.of(CAMERA, PLACE, internals, SIZE, BENT.tilt)
    by_id = {part.id: part for part in MODEL.parts}
    parts = rig.parts()
    assert len(parts) > 3
    for part in parts:
        np.testing.assert_allclose(part.corners_px, view.pixels(by_id[part.id].corners_mm), atol=1e-6)


def test_stations_bring_the_camera_to_the_same_places_whatever_the_mount() -> None:
    plain = viewing_poses(MODEL, PLACE, (250.0,), step_mm=120.0)
    bent = viewing_poses(MODEL, PLACE, (250.0,), step_mm=120.0, mount=BENT)
    assert len(plain) == len(bent) > 10
    for a, b in zip(plain, bent, strict=True):
        np.testing.assert_allclose(camera_in_rig(b, BENT).centre_mm, camera_in_rig(a).centre_mm, atol=1e-9)


@pytest.mark.parametrize("roll_deg", [2.0, -3.0])
def test_a_levelled_picture_is_that_of_a_camera_without_roll(roll_deg: float) -> None:
    mount = Mount(roll_deg=roll_deg)
    plain, rolled = rig_of(None).capture(), rig_of(mount).capture()
    inside = np.s_[30:-30, 30:-30]

    def gap(frame: Frame) -> float:
        return float(np.abs(frame.image[inside].astype(int) - plain.image[inside].astype(int)).mean())

    assert gap(levelled(rolled, mount)) < 0.2 * gap(rolled)
    assert gap(levelled(rolled, Mount(roll_deg=-roll_deg))) > gap(rolled)
    assert levelled(rolled, Mount(pitch_deg=1.0)) is rolled
