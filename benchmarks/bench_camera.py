"""Prints how many stale frames a camera's driver lets pass in 10,000 moves, and how surely faulty pictures are found.

Run from the repository: ``python -m benchmarks.bench_camera``. All time is simulated; waits are what a real bench of
that frame rate would see.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from calibration_free_tests.camera.emulated_bench import Bench
from calibration_free_tests.renderer.bench_building import building
from drivers.camera_settings import PictureLimits
from drivers.frame_checks import PictureFault, RepeatWatch, faults_of, look_at
from recognition.geometry import Pose4
from rig.hal import RigPose
from sim_backends.appearance import draw_appearance
from sim_backends.camera_emulator import CameraTiming, EmulatedCamera
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.camera_pictures import scene_pictures
from sim_backends.emulated_capture import EmulatedCapture
from sim_backends.renderer import Scene
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.viewpoints import viewing_poses

MOVES, DEPTHS = 10_000, range(1, 9)
PLACE = Pose4(7.0, 20.0, 5.0, -10.0)
SIZE = (320, 240)
VIEW_S, SCENES = 1.0, 8
FAULTS = {
    CameraFaultKind.FREEZE: PictureFault.FROZEN,
    CameraFaultKind.BLACK: PictureFault.BLACK,
    CameraFaultKind.OVER_EXPOSED: PictureFault.OVER_EXPOSED,
    CameraFaultKind.WRONG_SIZE: PictureFault.WRONG_SIZE,
}


def freshness() -> None:
    print("30 frames a second, exposure 12 ms, readout 20 to 30 ms, latency_s 0.03; waits in ms after settling")
    print("                                          moves   stale   wait median   90 %   worst")
    everything = stale_in_all = 0
    for name, polls, slow_host, share in (
        ("buffer can be asked", True, False, 0.4),
        ("buffer can be asked, computer often late", True, True, 0.4),
        ("buffer cannot be asked", False, False, 0.1),
        ("buffer cannot be asked, often late", False, True, 0.1),
    ):
        waits: list[float] = []
        stale = 0
        for depth in DEPTHS:
            timing = CameraTiming(buffer_frames=depth, exposure_s=0.012, jitter_s=0.01)
            bench = Bench(timing, polls=polls, slow_host=slow_host, seed=depth)
            bench.camera.connect()
            rng = np.random.default_rng(1000 + depth)
            for _ in range(round(MOVES * share / len(DEPTHS))):
                shot = bench.move_and_capture(rng)
                stale += shot.stale
                waits.append(1e3 * (shot.got_s - shot.after_s))
        median, high, worst = np.percentile(waits, [50, 90, 100])
        print(f"{name:42s}{len(waits):5d}{stale:8d}{median:14.0f}{high:7.0f}{worst:8.0f}")
        everything, stale_in_all = everything + len(waits), stale_in_all + stale
    print(f"{'all':42s}{everything:5d}{stale_in_all:8d}")


def checks() -> None:
    """Every second another rendered view; every other second a fault, each in turn."""
    limits, model = PictureLimits(), building()
    truths: Counter[CameraFaultKind | None] = Counter()
    found: Counter[CameraFaultKind | None] = Counter()
    for number in range(SCENES):
        rng = np.random.default_rng(number)
        poses = viewing_poses(model, PLACE, (100.0, 250.0, 600.0))
        poses = [poses[i] for i in rng.permutation(len(poses))[:40]]
        faults = [CameraFault(list(FAULTS)[n // 2 % len(FAULTS)], n * VIEW_S, VIEW_S) for n in range(1, len(poses), 2)]

        def pose_at(t_s: float, poses: list[RigPose] = poses) -> RigPose:
            return poses[min(int(t_s / VIEW_S), len(poses) - 1)]

        scene = Scene(model, PLACE, draw_appearance(rng))
        noise_sd = float(rng.uniform(0.7, 4.0))
        camera = EmulatedCamera(pose_at, scene_pictures(scene, size=SIZE), faults=faults, noise_sd=noise_sd)
        clock, watch = SimulatedClock(), RepeatWatch()
        capture = EmulatedCapture(camera, clock)
        while clock.now_s() < VIEW_S * len(poses) - 0.1:
            image = capture.read()[1]
            assert image is not None
            assert capture.grabbed is not None
            kind = next(iter(capture.grabbed.faults), None)
            told = faults_of(look_at(image, limits), limits, size=SIZE, repeats=watch.repeats(image))
            truths[kind] += 1
            found[kind] += bool(told) if kind is None else FAULTS[kind] in told
    print(f"{SCENES} scenes, 40 views each, noise 0.7 to 4 grey levels")
    for kind in FAULTS:
        print(f"{kind.value:14s} {truths[kind]:6d} frames, {100 * found[kind] / truths[kind]:7.2f} % found")
    print(f"{'sound':14s} {truths[None]:6d} frames, {100 * found[None] / truths[None]:7.2f} % refused")


def cost() -> None:
    image = np.random.default_rng(0).integers(0, 256, (960, 1280, 3), dtype=np.uint8)
    limits, watch = PictureLimits(), RepeatWatch()
    for name, check in (("each frame", lambda: watch.repeats(image)), ("each capture", lambda: look_at(image, limits))):
        times = []
        for _ in range(20):
            start = time.perf_counter()
            check()
            times.append(1e3 * (time.perf_counter() - start))
        print(f"checks of {name}, 1280 x 960: {np.median(times):.1f} ms")


def main() -> None:
    start = time.perf_counter()
    freshness()
    checks()
    cost()
    print(f"took {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
