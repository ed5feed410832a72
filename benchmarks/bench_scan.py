"""Prints how long a scan takes against its bound, the sum of motion, settling and exposure times.

Run from the repository: ``python -m benchmarks.bench_scan``. The rig runs on simulated time; storing takes the times
that real pictures of each size took on this machine's disk, drawn at random, and ``no overlap`` is the ratio if they
were stored before moving on. The last lines are real: a rig that really waits, and the real thread that stores.
Exit code 1 if a scan took more than 1.05 times its bound although storing is quicker than the quickest move; where it
is slower (marked with *), the disk or the encoder sets the pace, and no order of work can help. Measure on an idle
machine.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from calibration_free_tests.scan.sample import LIMITS, FakeClock, FakeRig, SimulatedStore, a_scan
from rig.hal import AxisLimits, Frame, Image, RigLimits, RigPose
from rig.hal import travel_seconds as travel_between
from rig.imagegrid import GridInfo, GridWriter
from rig.scan import BackgroundStore, OneSided, all_legs, serpentine
from rig.scan.preflight import travel_seconds

ALLOWED = 1.05
SIZES = {"1.2 MP": (1280, 960), "12 MP": (4000, 3000)}
SUFFIXES = (".jpg", ".png")
FAST = RigLimits(
    x_mm=AxisLimits(-500.0, 500.0, 250.0),
    y_mm=AxisLimits(-500.0, 500.0, 250.0),
    z_mm=AxisLimits(-500.0, 500.0, 250.0),
    theta_deg=AxisLimits(-90.0, 90.0, 120.0),
    zoom=AxisLimits(0.0, 1.0, 2.0),
    settle_s=0.2,
    exposure_s=0.03,
)
BENCHES = {"usual": LIMITS, "fast": FAST}
LATTICE = [
    ("y_mm", [0.0, 60.0, 120.0]),
    ("z_mm", [0.0]),
    ("x_mm", [0.0, 60.0, 120.0, 180.0]),
    ("theta_deg", [-15.0, 0.0, 15.0]),
    ("zoom", [0.0, 0.5, 1.0]),
]


def photograph(size: tuple[int, int], number: int) -> Image:
    """Walls, edges and some noise: about as hard to compress as a photograph."""
    rng = np.random.default_rng(number)
    width, height = size
    coarse = rng.integers(40, 220, (height // 50 + 1, width // 50 + 1, 3))
    image = np.kron(coarse, np.ones((50, 50, 1)))[:height, :width] + rng.normal(0.0, 2.0, (height, width, 1))
    return np.clip(image, 0, 255).astype(np.uint8)


def storing_times(size: tuple[int, int], suffix: str, count: int, work: Path) -> list[float]:
    """Seconds that real pictures take to be encoded, written and flushed."""
    image = photograph(size, 1)
    times = []
    with GridWriter(work / f"{size[0]}{suffix}", GridInfo()) as writer:
        for number in range(count + 1):
            pose = RigPose(float(number), 0.0, 0.0, 0.0)
            start = time.perf_counter()
            writer.add(Frame(image, pose, pose, "", number), f"images/{number}{suffix}")
            times.append(time.perf_counter() - start)
    return times[1:]  # The first also loads the encoder.


def simulated(limits: RigLimits, times: list[float], sides: list[OneSided]) -> tuple[float, float, float]:
    """The bound, what the scan took, and what it would take without overlap, seconds."""
    poses = serpentine(LATTICE, sides)
    rig, rng = FakeRig(FakeClock(), limits), np.random.default_rng(1)
    costs = rng.choice(times, len(poses))
    approaches = len(list(all_legs(poses, sides))) - len(poses)
    bound = travel_seconds(rig, all_legs(poses, sides)) - approaches * limits.exposure_s
    began = rig.clock.now_s()
    done = list(a_scan(rig, poses, SimulatedStore(rig.clock, lambda n: float(costs[n])), sides=sides))
    assert len(done) == len(poses)
    return bound, rig.clock.now_s() - began, bound + float(costs.sum())


def quickest_move(limits: RigLimits) -> float:
    """Seconds between two pictures at least, without the exposure."""
    poses = serpentine(LATTICE)
    return min(travel_between(limits, a, b) for a, b in pairwise(poses)) - limits.exposure_s


class WaitingClock(FakeClock):
    """Simulated time that really passes."""

    def sleep_s(self, seconds: float) -> None:
        super().sleep_s(seconds)
        time.sleep(seconds)


class Photographing(FakeRig):
    """Takes pictures of a real camera's size."""

    image: Image

    def capture(self) -> Frame:
        frame = super().capture()
        return Frame(self.image, frame.rig_pose, frame.commanded, "", frame.sequence, frame.exposed_at_s)


def real(size: tuple[int, int], count: int, work: Path) -> tuple[float, float]:
    """The bound and what the scan took, seconds of this machine's time."""
    rig = Photographing(WaitingClock(), FAST)
    rig.image = photograph(size, 2)
    poses = [RigPose(24.0 * (k + 1), 0.0, 0.0, 0.0, 0.0) for k in range(count)]
    bound = travel_seconds(rig, poses)
    began = time.perf_counter()
    with GridWriter(work / f"real{size[0]}", GridInfo()) as writer, BackgroundStore(writer) as store:
        for frame in a_scan(rig, poses, store):
            assert frame.size_bytes
    return bound, time.perf_counter() - began


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=8, help="timed of each kind")
    options = parser.parse_args()
    worst = 0.0
    with tempfile.TemporaryDirectory(prefix="rig-scan-", dir=".") as folder:
        work = Path(folder)
        print("108 poses, simulated time          store s (median, worst)   bound s    scan s   ratio   no overlap")
        for name, size in SIZES.items():
            for suffix in SUFFIXES:
                times = storing_times(size, suffix, options.pictures, work)
                for bench, limits in BENCHES.items():
                    for sides in ([], [OneSided("x_mm", "below", 2.0), OneSided("theta_deg", "below", 2.0)]):
                        label = f"{name} {suffix[1:]}, {bench} bench{', one-sided' if sides else ''}"
                        bound, took, serial = simulated(limits, times, sides)
                        slow = np.median(times) > quickest_move(limits)
                        worst = worst if slow else max(worst, took / bound)
                        print(
                            f"{label:36s} {np.median(times):11.3f} {max(times):8.3f} {bound:11.1f} {took:9.1f} "
                            f"{took / bound:7.3f}{'*' if slow else ' '} {serial / bound:11.3f}"
                        )
        for name, size in SIZES.items():
            bound, took = real(size, 20, work)
            print(f"{f'{name} png, really waiting, 20 poses':56s} {bound:12.1f} {took:9.1f} {took / bound:7.3f}")
    print(f"worst simulated ratio: {worst:.3f} (allowed: {ALLOWED})")
    return 0 if worst <= ALLOWED else 1


if __name__ == "__main__":
    sys.exit(main())
