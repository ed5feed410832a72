"""A guarded GRBL gantry on a real pseudo-terminal and in real threads, and what may be in the way of a STOP."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from drivers.combined import CombinedRig
from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblAxis, GrblSettings
from rig.bench.placement import AxisPlacement
from rig.clock import SystemClock
from rig.devices import Picture, StopReport
from rig.errors import RigError
from rig.guard import Guard, Rules
from rig.hal import AxisLimits, Frame, RigLimits, RigPose
from rig.imagegrid import GridInfo, GridWriter
from rig.runtime import Attendance
from rig.scan import BackgroundStore
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.pty_server import PtyServer
from sim_backends.simple_devices import SimpleAxis, SimpleAxisSettings, SimpleCamera, SimpleCameraSettings
from sim_backends.wired_device import WiredDevice

FIRMWARE = {**BENCH, 20: 0, 21: 0, 22: 0}
FREE = AxisLimits(-390.0, 390.0, 40.0)
RULES = Rules(
    RigLimits(FREE, FREE, FREE, AxisLimits(-90.0, 90.0, 30.0), AxisLimits(0.0, 0.0, 1.0), 0.05, 0.01), homing="as_found"
)
AT_ONCE_S = 5.0


def grbl_settings(port: str) -> GrblSettings:
    axis = GrblAxis(lower_mm=-390.0, upper_mm=390.0, feed_mm_per_min=2400.0)
    return GrblSettings(port=port, x=axis, y=axis, z=axis, homing="none")


class BlockedCamera(SimpleCamera):
    """Waits for a picture that does not come, once it is told to block."""

    def __init__(self) -> None:
        super().__init__(SimpleCameraSettings(), SystemClock())
        self.blocks, self.freed, self.asked = False, threading.Event(), threading.Event()

    def capture(self, after_s: float) -> Picture:
        self.asked.set()
        if self.blocks:
            self.freed.wait(60.0)
        return super().capture(after_s)


class BlockedDisk:
    """Calls of the module `os`, of which fsync hangs until it is freed."""

    def __init__(self) -> None:
        self.freed, self.asked = threading.Event(), threading.Event()
        self.freed.set()

    def fsync(self, handle: int) -> None:
        self.asked.set()
        self.freed.wait(60.0)

    def __getattr__(self, name: str) -> Any:
        import os

        return getattr(os, name)


class StopBench:
    """Everything that a STOP has to get past. A context manager; inside it the guard is connected."""

    def __init__(self, folder: Path, dialect: Dialect = GRBL_1_1) -> None:
        self.folder = folder
        self.machine = GrblMachine(dialect, settings=FIRMWARE)
        self.device = WiredDevice(self.machine)
        self.server = PtyServer(self.device)
        clock = SystemClock()
        self.camera, self.disk = BlockedCamera(), BlockedDisk()
        pan = SimpleAxis(SimpleAxisSettings(), clock)
        gantry = GrblGantry(grbl_settings(self.server.path), clock)
        rig = CombinedRig(gantry, {"theta_deg": pan}, self.camera, AxisPlacement(), clock)
        # A folder that is not there is as good as a disk that is full: the latch cannot be written.
        self.attendance = Attendance(folder / "missing", "bench", "bench")
        self.guard = Guard(rig, RULES, clock, latch=self.attendance.latch)

    def __enter__(self) -> StopBench:
        self.server.__enter__()
        self.guard.connect()
        return self

    def __exit__(self, *exc: object) -> None:
        self.camera.freed.set()
        self.disk.freed.set()
        self.guard.close()
        self.server.__exit__(None, None, None)

    def in_a_thread(self, command: Any) -> threading.Thread:
        def run() -> None:
            with suppress(RigError):
                command()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        return thread

    def moving(self, x_mm: float, more: int = 0) -> threading.Thread:
        """A move under way; ``more`` further ones wait in the controller's planner."""
        thread = self.in_a_thread(lambda: self.guard.move_to(RigPose(x_mm, 0.0, 0.0, 0.0)))
        deadline_s = time.monotonic() + AT_ONCE_S
        while not self.machine.planner.running and time.monotonic() < deadline_s:
            time.sleep(0.002)
        with self.server.lock:
            for number in range(more):
                self.machine.planner.add((x_mm, 1.0 + number, 0.0), 40.0, self.machine.limits())
        return thread

    @contextmanager
    def storing(self) -> Iterator[None]:
        """A picture is being stored, on a disk that does not come back; leaving frees it."""
        target = self.folder / f"grid{time.monotonic_ns()}"
        with GridWriter(target, GridInfo(), disk=self.disk) as writer, BackgroundStore(writer) as store:
            pose = RigPose(0.0, 0.0, 0.0, 0.0)
            self.disk.freed.clear()
            self.disk.asked.clear()
            store.put(Frame(np.zeros((48, 64), np.uint8), pose, pose, "1", 1), "images/1.png")
            try:
                assert self.disk.asked.wait(AT_ONCE_S)
                yield
            finally:
                self.disk.freed.set()

    @contextmanager
    def photographing(self) -> Iterator[None]:
        """A picture is being waited for in vain; leaving frees it."""
        self.camera.blocks = True
        self.camera.freed.clear()
        self.camera.asked.clear()
        thread = self.in_a_thread(self.guard.capture)
        try:
            assert self.camera.asked.wait(AT_ONCE_S)
            yield
        finally:
            self.camera.freed.set()
            self.camera.blocks = False
            thread.join(AT_ONCE_S)

    def stop(self) -> tuple[float, StopReport]:
        """STOP; seconds from the call until its first byte was on the wire (inf: never), and what it told."""
        with self.server.lock:
            seen = len(self.device.written)
            called_s = self.server.now_s()
        report = self.guard.stop("a test")
        with self.server.lock:
            sent = [at_s for at_s, data in self.device.written[seen:] if b"!" in data]
        return (sent[0] - called_s if sent else float("inf")), report


JOGGING = """
import sys
from calibration_free_tests.guard.real_time import grbl_settings
from drivers.grbl import GrblGantry
from rig.clock import SystemClock
gantry = GrblGantry(grbl_settings(sys.argv[1]), SystemClock())
gantry.connect()
gantry.move_to(float(sys.argv[2]), 0.0, 0.0)
print("jogging", flush=True)
gantry.jog(-300.0, 0.0, 0.0)
"""


def motion_after_kill(after_s: float, dialect: Dialect = GRBL_1_1) -> tuple[float, float]:
    """Kill a process that jogs; seconds until nothing moves any more, and millimetres that it still went."""
    machine = GrblMachine(dialect, settings=FIRMWARE)
    with PtyServer(WiredDevice(machine)) as server:
        command = [sys.executable, "-c", JOGGING, server.path, "1"]
        root = Path(__file__).parents[2]
        with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE) as jogger:
            assert jogger.stdout is not None
            assert jogger.stdout.readline() == b"jogging\n"
            time.sleep(after_s)
            jogger.kill()
            killed_s, was = time.monotonic(), machine.mechanics.position[0]
            jogger.wait()
        # A jog goes in segments, at rest for an instant between two: at rest is what stays so.
        last_s = killed_s
        while time.monotonic() < max(last_s, killed_s) + 0.5:
            with server.lock:
                if machine.planner.running:
                    last_s = time.monotonic()
            time.sleep(0.001)
        return last_s - killed_s, abs(machine.mechanics.position[0] - was)
