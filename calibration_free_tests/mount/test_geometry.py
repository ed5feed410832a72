"""A mount that is not perfect: the formula of the design, its inverse, and that the perfect one changes nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recognition.geometry import CameraPose, Mount, camera_in_rig, rig_pose_for, rotation_y
from recognition.rigid import Pose6
from rig.bench import load_bench
from rig.errors import InputError
from rig.hal import RigPose


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


POSES = st.builds(RigPose, *[numbers(-1e4, 1e4)] * 3, numbers(-720, 720), numbers(0, 1))
ARMS = st.builds(Mount, *[numbers(-300, 300)] * 3)
MOUNTS = st.builds(
    Mount,
    *[numbers(-300, 300)] * 3,
    numbers(-180, 180),
    *[numbers(-20, 20)] * 2,
    *[numbers(0.5, 2.0)] * 3,
    *[numbers(-5, 5)] * 3,
)


@given(POSES)
def test_a_perfect_mount_is_no_mount_to_the_last_bit(pose: RigPose) -> None:
    camera = camera_in_rig(pose, Mount())
    assert camera == camera_in_rig(pose) == CameraPose(pose.theta_deg, pose.x_mm, pose.y_mm, pose.z_mm)
    np.testing.assert_array_equal(Mount().tilt, np.eye(3))
    np.testing.assert_array_equal(Mount().axes, np.eye(3))


@given(POSES, ARMS)
def test_a_lever_arm_alone_turns_with_the_pan_and_changes_nothing_else(pose: RigPose, arm: Mount) -> None:
    camera = camera_in_rig(pose, arm)
    turned = rotation_y(np.radians(pose.theta_deg)).T @ [arm.x_mm, arm.y_mm, arm.z_mm]
    np.testing.assert_allclose(camera.centre_mm, np.array([pose.x_mm, pose.y_mm, pose.z_mm]) + turned, atol=1e-9)
    assert camera.theta_deg == pose.theta_deg


@given(POSES, MOUNTS)
def test_the_rig_pose_for_a_camera_is_the_inverse(pose: RigPose, mount: Mount) -> None:
    back = rig_pose_for(camera_in_rig(pose, mount), mount, pose.zoom)
    for axis in ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom"):
        assert getattr(back, axis) == pytest.approx(getattr(pose, axis), abs=1e-6)
    assert rig_pose_for(camera_in_rig(pose), None, pose.zoom) == pose


@given(POSES, MOUNTS, st.tuples(*[numbers(-500, 500)] * 3))
def test_moving_the_rig_moves_the_camera_along_the_axes_whatever_the_arm_and_the_pan(
    pose: RigPose, mount: Mount, move: tuple[float, float, float]
) -> None:
    x, y, z = move
    there = replace(pose, x_mm=pose.x_mm + x, y_mm=pose.y_mm + y, z_mm=pose.z_mm + z)
    moved = camera_in_rig(there, mount).centre_mm - camera_in_rig(pose, mount).centre_mm
    np.testing.assert_allclose(moved, mount.axes @ move, atol=1e-6)


@given(POSES, MOUNTS)
def test_a_full_turn_of_the_pan_brings_the_camera_back(pose: RigPose, mount: Mount) -> None:
    once = camera_in_rig(replace(pose, theta_deg=pose.theta_deg + 360.0), mount)
    np.testing.assert_allclose(once.centre_mm, camera_in_rig(pose, mount).centre_mm, atol=1e-6)


@given(MOUNTS)
def test_squareness_is_the_angle_missing_between_axes_and_scale_their_length(mount: Mount) -> None:
    x, y, z = mount.axes.T
    lengths = np.linalg.norm(mount.axes, axis=0)
    np.testing.assert_allclose(lengths, [mount.x_scale, mount.y_scale, mount.z_scale], rtol=1e-12)
    for a, b, missing in ((x, y, mount.xy_deg), (x, z, mount.xz_deg), (y, z, mount.yz_deg)):
        cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
        assert np.degrees(np.arccos(cosine)) == pytest.approx(90.0 - missing, abs=1e-6)
    assert x[1] == x[2] == y[2] == 0.0
    assert np.linalg.det(mount.axes) > 0


@given(MOUNTS)
def test_the_tilt_is_that_of_a_pose_with_six_degrees_of_freedom(mount: Mount) -> None:
    pose = Pose6.from_angles(0.0, np.zeros(3), roll_deg=mount.roll_deg, pitch_deg=mount.pitch_deg)
    np.testing.assert_allclose(mount.tilt, pose.rotation, atol=1e-12)


def bench_of(folder: Path, text: str) -> Mount:
    file = folder / "bench.yaml"
    file.write_text(f"schema: 1\nkind: mock\n{text}")
    return load_bench(file).mount


def test_a_bench_file_tells_the_whole_mount(tmp_path: Path) -> None:
    text = """
mount: {x_mm: 1, y_mm: 2, z_mm: 3, pan_zero_deg: 4, roll_deg: 0.5, pitch_deg: -0.25}
axes:
  x_mm: {scale: 1.01}
  y_mm: {scale: 0.99}
  z_mm: {scale: 1.02}
  squareness_deg: {xy: 0.1, xz: -0.2, yz: 0.3}
"""
    assert bench_of(tmp_path, text) == Mount(1, 2, 3, 4, 0.5, -0.25, 1.01, 0.99, 1.02, 0.1, -0.2, 0.3)
    assert bench_of(tmp_path, "") == Mount()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("mount: {roll_deg: 30}\n", ":3:19: mount.roll_deg: should be less than or equal to 20"),
        ("mount: {pan_zero: 1}\n", ":3:9: mount.pan_zero: unknown key. Did you mean 'pan_zero_deg'?"),
        ("mount: {pan_zero_deg: .nan}\n", ":3:23"),
        ("axes: {x_mm: {scale: 0}}\n", ":3:22: axes.x_mm.scale: should be greater than 0.5"),
        ("axes: {theta_deg: {scale: 1}}\n", ":3:20: axes.theta_deg.scale: unknown key"),
        ("axes: {squareness_deg: {xy: 9}}\n", ":3:29: axes.squareness_deg.xy: should be less than or equal to 5"),
        ("axes: {squareness_deg: {zx: 1}}\n", ":3:25: axes.squareness_deg.zx: unknown key"),
    ],
)
def test_a_bench_file_refuses_mounts_that_cannot_be(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(InputError) as caught:
        bench_of(tmp_path, text)
    assert what in str(caught.value)
