"""The emulated camera shows what its pose shows: a rendered scene, or the nearest cell of a grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.camera.emulated_bench import Axis, Bench, striped
from calibration_free_tests.imagegrid.sample import lattice, picture, write_grid
from calibration_free_tests.renderer.bench_building import building
from recognition.geometry import Pose4
from rig.hal import RigPose
from rig.imagegrid import read_grid
from sim_backends.camera_emulator import CameraTiming, EmulatedCamera
from sim_backends.camera_pictures import grid_pictures, scene_pictures
from sim_backends.emulated_capture import EmulatedCapture
from sim_backends.frame_counter import LARGEST, draw_counter, read_counter
from sim_backends.rendered_rig import RenderedRig
from sim_backends.renderer import Scene
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.viewpoints import limits_around, viewing_poses

PLACE = Pose4(7.0, 30.0, 5.0, -60.0)


def test_a_rendered_view_is_that_of_the_rendered_rig() -> None:
    model = building()
    poses = viewing_poses(model, PLACE, (250.0,), step_mm=120.0)[:3]
    scene = Scene(model, PLACE)
    rig = RenderedRig(scene, limits_around(poses), poses, size=(160, 120))
    view = scene_pictures(scene, size=(160, 120))
    for pose in poses:
        rig.move_to(pose)
        # The rig's picture has noise of 2 grey levels on top.
        off = view(pose).astype(float) - rig.capture().image
        assert abs(off.mean()) < 0.3
        assert off.std() == pytest.approx(2.0, abs=0.3)
    aside = RigPose(poses[0].x_mm + 2.0, poses[0].y_mm, poses[0].z_mm, poses[0].theta_deg)
    assert np.abs(view(aside).astype(int) - view(poses[0])).mean() > 1.0


def test_a_grid_shows_the_nearest_cell(tmp_path: Path) -> None:
    poses = lattice()
    view = grid_pictures(read_grid(write_grid(tmp_path, poses)), distance_mm=100.0)
    for number, pose in enumerate(poses):
        near = RigPose(pose.x_mm + 3.0, pose.y_mm - 3.0, pose.z_mm + 50.0, pose.theta_deg + 362.0, pose.zoom + 0.05)
        assert np.array_equal(view(pose), picture(number))
        assert np.array_equal(view(near), picture(number))


def test_frames_of_a_rig_at_rest_differ_by_noise_alone_and_repeat_with_the_seed() -> None:
    def frames(seed: int) -> list[np.ndarray]:
        clock = SimulatedClock()
        camera = EmulatedCamera(Axis().pose_at, striped, CameraTiming(), seed=seed)
        capture = EmulatedCapture(camera, clock)
        return [image for _, image in (capture.read() for _ in range(4)) if image is not None]

    first, again, other = frames(1), frames(1), frames(2)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
    off = first[1].astype(float) - first[0]
    assert off.std() == pytest.approx(2.0 * 2**0.5, abs=0.3)


@pytest.mark.parametrize("keeps", ["oldest", "newest"])
def test_a_full_buffer_keeps_what_it_is_told_to_keep(keeps: str) -> None:
    bench = Bench(CameraTiming(frame_rate_hz=10.0, buffer_frames=3, keeps=keeps))  # type: ignore[arg-type]  # parametrised
    capture = EmulatedCapture(bench.emulated, bench.clock)
    opened = bench.emulated.exposure_of(1)
    assert opened.began_s == 99.0
    bench.clock.sleep_s(2.0)
    counters = []
    for _ in range(3):
        assert capture.grab()
        assert capture.grabbed is not None
        counters.append(capture.grabbed.exposure.counter)
    assert counters == ([11, 12, 13] if keeps == "oldest" else [28, 29, 30])


@pytest.mark.parametrize(
    "changes", [{"buffer_frames": 9}, {"buffer_frames": 0}, {"exposure_s": 0.05}, {"exposure_s": 0}]
)
def test_a_timing_that_no_camera_has_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        CameraTiming(**changes)  # type: ignore[arg-type]  # a mixture of types


def test_counters_are_read_back_or_not_at_all() -> None:
    rng = np.random.default_rng(0)
    for number in (0, 1, 255, 256, 123_456, LARGEST):
        image = rng.integers(0, 256, (40, 80, 3), dtype=np.uint8)
        draw_counter(image, number)
        assert read_counter(np.clip(image + rng.normal(0.0, 20.0, image.shape), 0, 255).astype(np.uint8)) == number
    for blank in (0, 255):
        assert read_counter(np.full((40, 80, 3), blank, np.uint8)) is None
    with pytest.raises(ValueError, match="outside"):
        draw_counter(np.zeros((40, 80), np.uint8), LARGEST + 1)
    with pytest.raises(ValueError, match="no room"):
        draw_counter(np.zeros((20, 80), np.uint8), 1)
