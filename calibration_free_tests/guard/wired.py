"""The whole bench on emulated wires and simulated time, with a judge of every byte, packet and picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from drivers.dynamixel import DynamixelAxis
from drivers.grbl import GrblGantry
from drivers.opencv_camera import OpenCvCamera
from rig.bench import BenchConfig, Device, LiveBenchFile
from rig.emulation import EmulatedBench
from rig.hal import Frame, Image, RigPose
from sim_backends.camera_emulator import CameraTiming
from sim_backends.faults import Fault
from sim_backends.frame_counter import read_counter
from sim_backends.grbl_emulator.dialects import Dialect
from sim_backends.simulated_clock import SimulatedClock

BLOCK_PX = 4
GANTRY, BUS = "the gantry's port", "the servos' port"
QUICK = {24: 3000.0, 25: 9000.0, 110: 9000.0, 111: 9000.0, 112: 9000.0, 120: 1000.0, 121: 1000.0, 122: 1000.0}
MM, DEG, ZOOM = 0.05, 0.1, 0.01
"""What a frame's pose may be wrong by."""


@lru_cache
def config(approach: bool = False) -> BenchConfig:
    """A bench with everything, 2 mm within its controller's soft limits."""
    axes: dict[str, Any] = {
        "x_mm": {"lower": 0, "upper": 120, "speed_mm_per_s": 80, "sign": -1, "offset_mm": -1, "backlash_mm": 1},
        "y_mm": {"lower": 0, "upper": 90, "speed_mm_per_s": 80, "offset_mm": 92},
        "z_mm": {"lower": 0, "upper": 60, "speed_mm_per_s": 80, "offset_mm": 62, "scale": 1.001},
        "theta_deg": {"lower": -60, "upper": 60, "speed_deg_per_s": 60, "sign": -1, "offset_deg": 5},
        "zoom": {"speed_per_s": 0.5},
    }
    axes["x_mm"]["backlash_mm"] = 1 if approach else 0
    file = LiveBenchFile.model_validate(
        {
            "schema": 1,
            "kind": "live",
            "devices": {role: {"driver": "emulated"} for role in ("gantry", "pan", "zoom", "camera")},
            "axes": axes,
            "safety": {
                "keep_out": [{"name": "model", "x_mm": [50, 70], "y_mm": [40, 60], "z_mm": [40, 60]}],
                "margin_mm": 5,
                "unhomed_jog_mm": 2,
            },
            "timing": {"settle_s": 0.2, "exposure_s": 0.01},
        }
    )
    ends = {"lower_mm": -122.0, "upper_mm": -1.0, "feed_mm_per_min": 5000.0}
    gantry = {"port": GANTRY, "unhomed_jog_mm": 2.0}
    gantry |= {"x": ends, "y": ends | {"lower_mm": -93.0}, "z": ends | {"lower_mm": -62.5}}
    pan = {"kind": "pan", "lower_deg": -70.0, "upper_deg": 70.0}
    zoom = {"kind": "zoom", "table": ((0.0, 0.0), (0.25, 30.0), (0.7, 60.0), (1.0, 120.0)), "zero_ticks": 500}
    bus = {"port": BUS, "baud": 1_000_000, "latency_timer_ms": 1, "tolerance_deg": 0.05, "speed_deg_per_s": 60.0}
    devices = {
        "gantry": (GrblGantry, gantry),
        "pan": (DynamixelAxis, bus | {"id": 1, "model": "XM430-W350", "mode": "extended", "role": pan}),
        "zoom": (DynamixelAxis, bus | {"id": 2, "model": "XL330-M288", "mode": "position", "role": zoom}),
        "camera": (OpenCvCamera, {"source": "http://127.0.0.1:1/emulated", "latency_s": 0.03, "warm_up_s": 0.1}),
    }
    made = {
        role: Device(role, "emulated", driver, driver.Settings(**settings))
        for role, (driver, settings) in devices.items()
    }
    return BenchConfig("the emulated bench", file, devices=made)


def striped(pose: RigPose) -> Image:
    """Mid grey, and different from each place."""
    columns = (120.0 + 60.0 * np.sin((np.arange(64) + pose.x_mm + pose.theta_deg) / 5.0)).astype(np.uint8)
    return np.repeat(np.repeat(columns[None, :, None], 48, axis=0), 3, axis=2)


class Judged:
    """An emulated bench, a guard on it, hands for whoever plays the faults, and what must never happen."""

    def __init__(self, dialect: Dialect, *, approach: bool = False, start_delay_s: float = 0.02) -> None:
        self.clock = SimulatedClock()
        self.bench = EmulatedBench(
            config(approach),
            striped,
            clock=self.clock,
            camera_timing=CameraTiming(frame_rate_hz=10.0, readout_s=0.02),
            counter_px=BLOCK_PX,
            dialect=dialect,
            start_delay_s=start_delay_s,
        )
        for number, value in QUICK.items():
            self.bench.gantry.eeprom.write(f"{number}={value}")
        self.guard = self.bench.open()
        self.frames = 0
        self.wrong: list[str] = []

    def strike(self, port: str, fault: Fault) -> None:
        """Let a fault be due on a line, the plug's among them."""
        self.bench.lines[port].wire.add(fault)

    def replug(self) -> None:
        for line in self.bench.lines.values():
            line.plug_in()
        self.bench.camera.faults.clear()

    def ready(self) -> None:
        """What a person does until it can be used: connect, home, and reference where an axis is seen to stand."""
        self.replug()
        for servo in self.bench.servos.values():
            servo.temperature_c = 30.0
        self.guard.connect()
        self.guard.home()
        for axis in ("theta_deg", "zoom"):
            status = self.guard.status().rig
            if status is not None and not status.axes[axis].referenced:
                limit = getattr(self.guard.rules.travel, axis)
                self.guard.reference(axis, min(max(getattr(self.bench.pose, axis), limit.lower), limit.upper))

    def capture(self) -> Frame:
        """A picture, and whether it is of the place that it says."""
        frame = self.guard.capture()
        self.frames += 1
        counter = read_counter(frame.image, BLOCK_PX)
        assert counter is not None
        exposure = self.bench.camera.exposure_of(counter)
        for true in (exposure.began_at, exposure.ended_at):
            assert true is not None
            self._compare("frame", frame.rig_pose, true)
        return frame

    def move_to(self, pose: RigPose) -> RigPose:
        """A move, and whether the rig really stands where it says."""
        back = self.guard.move_to(pose)
        self._compare("move", back, self.bench.pose)
        self._compare("move", pose, self.bench.pose)
        return back

    def _compare(self, what: str, told: RigPose, true: RigPose) -> None:
        mm = max(abs(told.x_mm - true.x_mm), abs(told.y_mm - true.y_mm), abs(told.z_mm - true.z_mm))
        deg, zoom = abs(told.theta_deg - true.theta_deg), abs(told.zoom - true.zoom)
        if not (mm <= MM and deg <= DEG and zoom <= ZOOM):
            self.wrong.append(f"{what} says {told} and is at {true}")

    @property
    def violations(self) -> list[Any]:
        """What was commanded and must never be, byte by byte, and what was told wrongly."""
        monitor = self.bench.gantry.monitor
        assert monitor is not None
        packets = [violation for bus in self.bench.buses.values() for violation in bus.monitor.violations]
        return [*monitor.blamed_on_host, *packets, *self.wrong]

    def later(self, delay_s: float, action: Callable[[], Any]) -> None:
        self.clock.call_at(self.clock.now_s() + delay_s, action)
