"""A rig on simulated time, disks that fail or remember, and short scans, for the tests and benchmarks of scanning."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calibration_free_tests.imagegrid.sample import encoded, picture
from rig.bench import BenchConfig, BenchFile
from rig.errors import UnreachableError
from rig.hal import AxisLimits, Frame, Image, RigLimits, RigPose, travel_seconds
from rig.imagegrid import GridFrame, GridInfo, GridWriter
from rig.imagegrid.disk import Disk
from rig.scan import BackgroundStore, FrameStore, Scan, ScanPlan, ScanRecord, numbered, open_scan_folder

AXES = ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom")
LIMITS = RigLimits(
    x_mm=AxisLimits(-500.0, 500.0, 100.0),
    y_mm=AxisLimits(-500.0, 500.0, 100.0),
    z_mm=AxisLimits(-500.0, 500.0, 100.0),
    theta_deg=AxisLimits(-90.0, 90.0, 30.0),
    zoom=AxisLimits(0.0, 1.0, 0.5),
    settle_s=0.3,
    exposure_s=0.05,
)
BENCH = BenchConfig("bench.yaml", BenchFile.model_validate({"schema": 1, "kind": "mock"}))


class FakeClock:
    """A `rig.devices.Clock` that nobody waits for."""

    def __init__(self) -> None:
        self.time_s = 1000.0

    def now_s(self) -> float:
        return self.time_s

    def sleep_s(self, seconds: float) -> None:
        self.time_s += seconds


class FakeRig:
    """A `rig.hal.Rig` whose moves take simulated time; each pose has its own picture. ``log`` tells what it did."""

    internals_fixed_by_zoom = True

    def __init__(self, clock: FakeClock | None = None, limits: RigLimits = LIMITS) -> None:
        self.clock, self.limits = clock or FakeClock(), limits
        self.pose = RigPose(0.0, 0.0, 0.0, 0.0, 0.0)
        self.log: list[tuple[Any, ...]] = []
        self.before: Callable[[str, RigPose], None] = lambda what, pose: None
        self.sequence = 0

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        return [self.pose]

    def nearest(self, wish: RigPose) -> RigPose:
        for axis in AXES:
            value, limit = getattr(wish, axis), getattr(self.limits, axis)
            if not limit.lower <= value <= limit.upper:
                raise UnreachableError(f"{axis} = {value:g} is outside {limit.lower:g} .. {limit.upper:g}")
        return wish

    def move_to(self, pose: RigPose) -> RigPose:
        self.before("move", pose)
        self.clock.sleep_s(travel_seconds(self.limits, self.pose, pose) - self.limits.exposure_s)
        self.pose = self.nearest(pose)
        self.log.append(("move", pose))
        return pose

    def capture(self) -> Frame:
        self.before("capture", self.pose)
        self.clock.sleep_s(self.limits.exposure_s)
        self.sequence += 1
        self.log.append(("capture", self.pose))
        return Frame(image_at(self.pose), self.pose, self.pose, "", self.sequence, self.clock.now_s())

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        return travel_seconds(self.limits, start, end)

    def close(self) -> None:
        pass

    def __enter__(self) -> FakeRig:
        return self

    def __exit__(self, *exc: Any) -> None:
        pass

    @property
    def captured(self) -> list[RigPose]:
        return [entry[1] for entry in self.log if entry[0] == "capture"]


def image_at(pose: RigPose) -> Image:
    return picture(abs(hash((round(pose.x_mm * 1000), round(pose.y_mm * 1000), round(pose.zoom * 1000)))) % 2**32)


def digest_at(pose: RigPose) -> str:
    return hashlib.sha256(encoded(image_at(pose), ".png")).hexdigest()


def row(count: int) -> tuple[RigPose, ...]:
    return tuple(RigPose(float(k), 10.0, 0.0, 0.0, 0.5) for k in range(count))


@dataclass
class SimulatedStore:
    """A store whose work takes simulated time beside the rig's: the n-th picture takes ``cost_s(n)``."""

    clock: FakeClock
    cost_s: Callable[[int], float]
    busy_until_s: float = 0.0
    files: list[str] = field(default_factory=list)
    in_hand: GridFrame | None = None

    def put(self, frame: Frame, file: str) -> None:
        assert self.in_hand is None, "two pictures in hand"
        self.busy_until_s = max(self.busy_until_s, self.clock.now_s()) + self.cost_s(len(self.files))
        self.files.append(file)
        self.in_hand = GridFrame(file, "", frame.rig_pose)

    def collect(self) -> GridFrame | None:
        stored, self.in_hand = self.in_hand, None
        if stored is not None:
            self.clock.sleep_s(max(0.0, self.busy_until_s - self.clock.now_s()))
        return stored


def a_scan(rig: FakeRig, poses: Iterable[RigPose], store: FrameStore, **how: Any) -> Scan:
    return Scan(rig, numbered(poses), store, clock=rig.clock, **how)


def scan_into(
    folder: Path,
    poses: Sequence[RigPose],
    rig: FakeRig | None = None,
    *,
    disk: Disk = os,
    acknowledged: Callable[[GridFrame], None] = lambda frame: None,
    opened: Callable[[GridWriter], None] = lambda writer: None,
    now: Callable[[], datetime] = lambda: datetime(2026, 1, 31, tzinfo=UTC),
    **how: Any,
) -> Scan:
    """Begin a scan in a folder, or go on with it, as the command does."""
    rig = rig or FakeRig()
    plan = ScanPlan("plan.yaml", tuple(poses))
    record = ScanRecord.of(BENCH, None, plan, now())
    with open_scan_folder(folder, record, GridInfo(internals="fixed_by_zoom"), resume=True, disk=disk) as writer:
        opened(writer)
        good = {frame.file for frame in writer.frames}
        targets = [target for target in numbered(poses) if target.file not in good]
        with BackgroundStore(writer, now=now) as store:
            scan = Scan(rig, targets, store, clock=rig.clock, **how)
            for frame in scan:
                acknowledged(frame)
    return scan


class QuickDisk:
    """The disk, without the wait for flushing: what is tested here is which calls are made, and in which order."""

    def open(self, path: Path, flags: int, mode: int = 0o666) -> int:
        return os.open(path, flags, mode)

    def write(self, handle: int, data: bytes) -> int:
        return os.write(handle, data)

    def fsync(self, handle: int) -> None:
        pass

    def ftruncate(self, handle: int, length: int) -> None:
        os.ftruncate(handle, length)

    def replace(self, source: Path, target: Path) -> None:
        os.replace(source, target)

    def mkdir(self, path: Path) -> None:
        os.mkdir(path)

    def unlink(self, path: Path) -> None:
        os.unlink(path)


def rng(*seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)
