"""Prints how long scans take on the whole emulated bench against the bound: emulated motion, settling and exposures.

Run from the repository: ``python -m benchmarks.bench_scan_emulated``. All is simulated time: the drivers talk to the
emulated controller and servos byte by byte, the camera exposes frame by frame. The motion is what the emulators'
carriages and shafts really moved, the settling what the bench file asks for. A camera runs freely, so
a picture takes the time to the end of a frame that is proved to have begun after settling (decision 0052): two frame
periods, exposure and readout, in the column ``picture s``. ``strict`` counts the 10 ms of light alone, as if the
camera could be triggered. Exit code 1 if a scan took more than 1.05 times its bound.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from calibration_free_tests.emulation.sample import config, make_ready, small, striped
from rig.bench import BenchConfig
from rig.emulation import EmulatedBench
from rig.hal import Frame, RigPose
from rig.imagegrid import GridFrame
from rig.scan import Scan, numbered, serpentine
from sim_backends.camera_emulator import CameraTiming
from sim_backends.simulated_clock import SimulatedClock

ALLOWED = 1.05
SCANS = {
    "3 x 3 x 1 x 3": [
        ("y_mm", [121.0, 161.0, 201.0]),
        ("z_mm", [121.0]),
        ("x_mm", [161.0, 201.0, 241.0]),
        ("theta_deg", [-15.0, 0.0, 15.0]),
        ("zoom", [0.0]),
    ],
    "5 x 4 x 2 x 3 x 2": [
        ("z_mm", [60.0, 120.0]),
        ("y_mm", [60.0, 120.0, 180.0, 240.0]),
        ("x_mm", [50.0, 120.0, 190.0, 260.0, 330.0]),
        ("theta_deg", [-15.0, 0.0, 15.0]),
        ("zoom", [0.0, 0.5]),
    ],
}
RATES_HZ = (10.0, 30.0)


class Meter:
    """Follows the clock behind the emulators: for how long anything moved."""

    def __init__(self, bench: EmulatedBench) -> None:
        self.bench, self.moved_s = bench, 0.0
        self._at_s, self._pose = 0.0, bench.pose

    def next_event_s(self) -> float | None:
        return None

    def advance_to(self, now_s: float) -> None:
        pose = self.bench.pose
        if pose != self._pose:
            self.moved_s += now_s - self._at_s
        self._at_s, self._pose = now_s, pose


class Instant:
    """A store that takes no time: `benchmarks.bench_scan` has the times of real disks."""

    def __init__(self) -> None:
        self.in_hand: GridFrame | None = None

    def put(self, frame: Frame, file: str) -> None:
        self.in_hand = GridFrame(frame.rig_pose, file, "")

    def collect(self) -> GridFrame | None:
        stored, self.in_hand = self.in_hand, None
        return stored


def known_latency(of: BenchConfig, readout_s: float) -> BenchConfig:
    """The bench of somebody who has measured the camera's latency: whatever is told beyond it is waited for."""
    camera = of.devices["camera"]
    settings = camera.settings.model_copy(update={"latency_s": readout_s})
    return replace(of, devices={**of.devices, "camera": replace(camera, settings=settings)})


def picture_s(timing: CameraTiming) -> float:
    """The frame that is proved fresh, with the one before it that proves it, until it has arrived."""
    return 2.0 / timing.frame_rate_hz + timing.exposure_s + timing.readout_s


def run(poses: list[RigPose], rate_hz: float) -> tuple[float, float, float, float]:
    """What a scan took, the motion in it, the settling before each picture, and what a picture takes, seconds."""
    timing = CameraTiming(frame_rate_hz=rate_hz)
    clock, told = SimulatedClock(), known_latency(small(config()), timing.readout_s)
    bench = EmulatedBench(told, striped, clock=clock, camera_timing=timing)
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(poses[0])
        meter = Meter(bench)
        clock.attach(meter)
        began_s = clock.now_s()
        assert len(list(Scan(guard, numbered(poses), Instant(), clock=clock))) == len(poses)
        return clock.now_s() - began_s, meter.moved_s, guard.limits.settle_s, picture_s(timing)


def main() -> int:
    print("scan, camera                    poses   scan s  motion s  settling s  picture s   bound s   ratio   strict")
    worst = 0.0
    for name, axes in SCANS.items():
        poses = serpentine(axes)
        for rate_hz in RATES_HZ:
            took_s, moved_s, settle_s, each_s = run(poses, rate_hz)
            count = len(poses)
            bound_s = moved_s + count * (settle_s + each_s)
            strict_s = moved_s + count * (settle_s + CameraTiming().exposure_s)
            worst = max(worst, took_s / bound_s)
            print(
                f"{f'{name}, {rate_hz:g} Hz':30s} {count:6d} {took_s:8.1f} {moved_s:9.1f} {count * settle_s:11.1f} "
                f"{count * each_s:10.1f} {bound_s:9.1f} {took_s / bound_s:7.3f} {took_s / strict_s:8.3f}"
            )
    print(f"worst ratio: {worst:.3f} (allowed: {ALLOWED})")
    return 0 if worst <= ALLOWED else 1


if __name__ == "__main__":
    sys.exit(main())
