"""A whole emulated bench on simulated time, healthy until a test plants a fault in it, and the doctor's view of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from drivers.camera_identity import FoundCamera
from drivers.camera_settings import CameraSettings
from drivers.draining import InlineDrain
from drivers.dynamixel import DynamixelAxis, DynamixelBus
from drivers.dynamixel.table import note_of
from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblSettings
from drivers.opencv_camera import OpenCvCamera
from drivers.serial_link import READ_SLICE_S, SerialPort
from rig.bench import Device, load_bench
from rig.devices import Clock
from rig.doctor import DiskLook, Finding, Surroundings, Verdict, examine
from rig.hal import Image, RigPose
from sim_backends.camera_emulator import CameraTiming, EmulatedCamera
from sim_backends.camera_faults import CameraFault
from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.bus import EmulatedBus
from sim_backends.dynamixel_emulator.line import BusLine
from sim_backends.dynamixel_emulator.monitor import Monitor as BusMonitor
from sim_backends.dynamixel_emulator.servo import Servo
from sim_backends.emulated_capture import EmulatedCapture
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.simulated_port import SimulatedPort
from sim_backends.wired_device import WiredDevice

GANTRY_PORT, BUS_PORT = "/dev/serial/by-path/gantry", "/dev/serial/by-path/servos"
CAMERA = "/dev/v4l/by-path/camera"
SERVO_BAUD = 1_000_000
HEALTHY_FIRMWARE: Mapping[int, float] = {**BENCH, 1: 255}
CONTROLS = {
    cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
    cv2.CAP_PROP_EXPOSURE: 100.0,
    cv2.CAP_PROP_AUTO_WB: 1.0,
    cv2.CAP_PROP_WB_TEMPERATURE: 4600.0,
}
BENCH_FILE = f"""
schema: 1
kind: live
devices:
  gantry:
    driver: grbl
    port: {GANTRY_PORT}
    x: {{lower_mm: -398.0, upper_mm: -1.0, feed_mm_per_min: 5000.0}}
    y: {{lower_mm: -298.0, upper_mm: -1.0, feed_mm_per_min: 5000.0}}
    z: {{lower_mm: -198.0, upper_mm: -1.0, feed_mm_per_min: 2500.0}}
  pan:
    driver: dynamixel
    port: {BUS_PORT}
    baud: {SERVO_BAUD}
    id: 1
    model: XM430-W350
    mode: extended
    role: {{kind: pan, lower_deg: -100.0, upper_deg: 100.0}}
  zoom:
    driver: dynamixel
    port: {BUS_PORT}
    baud: {SERVO_BAUD}
    id: 2
    model: XL330-M288
    mode: position
    role: {{kind: zoom, table: [[0.0, 0.0], [1.0, 120.0]]}}
  camera:
    driver: opencv
    source: {CAMERA}
    frame_rate_hz: 30.0
    exposure_s: 0.01
    warm_up_s: 0.1
    latency_s: 0.03
axes:
  x_mm: {{lower: 2, upper: 399, speed_mm_per_s: 80, offset_mm: 400}}
  y_mm: {{lower: 2, upper: 299, speed_mm_per_s: 80, offset_mm: 300}}
  z_mm: {{lower: 2, upper: 199, speed_mm_per_s: 40, offset_mm: 200}}
  theta_deg: {{lower: -90, upper: 90, speed_deg_per_s: 30}}
  zoom: {{speed_per_s: 0.25}}
safety:
  keep_out: [{{name: model, x_mm: [100, 200], y_mm: [100, 200], z_mm: [150, 199]}}]
  margin_mm: 20
"""


def view(pose: RigPose) -> Image:
    """A small picture of mid grey stripes."""
    columns = (120.0 + 60.0 * np.sin((np.arange(64) + pose.x_mm) / 5.0)).astype(np.uint8)
    return np.repeat(np.repeat(columns[None, :, None], 48, axis=0), 3, axis=2)


class Mistuned:
    """A port at another baud rate than the device's: what goes through it is noise. Opening it is no error."""

    def __init__(self, port: SimulatedPort) -> None:
        self._port = port

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def read(self, size: int = 1) -> bytes:
        return bytes(byte ^ 0xA5 for byte in self._port.read(size))

    def write(self, data: bytes) -> int:
        return self._port.write(bytes(0x80 | byte for byte in data))


@dataclass
class HeldElsewhere:
    """Ports that another process holds, by path."""

    by: Mapping[str, str]

    def __call__(self, device: str) -> None:
        from rig.errors import HardwareError

        if device in self.by:
            raise HardwareError(f"{device}: in use by process {self.by[device]}. Stop that process, or wait")


class Workbench:
    """Emulators, the bench file as a dictionary (`file`), and what this computer looks like (`world`).

    Change what is to be wrong before `findings`.
    """

    def __init__(
        self,
        folder: Path,
        dialect: Dialect = GRBL_1_1,
        *,
        firmware: Mapping[int, float] | None = None,
        timing: CameraTiming | None = None,
        camera_faults: tuple[CameraFault, ...] = (),
    ) -> None:
        self.folder, self.clock = folder, SimulatedClock()
        self.file: dict[str, Any] = yaml.safe_load(BENCH_FILE)
        self.machine = GrblMachine(dialect, settings={**HEALTHY_FIRMWARE, **(firmware or {})})
        self.gantry_baud = 115200
        self.gantry_wire = WiredDevice(self.machine)
        pan = Servo(table.MODELS["XM430-W350"], 1, baud=SERVO_BAUD)
        pan.memory[table.OPERATING_MODE] = table.EXTENDED
        zoom = Servo(table.MODELS["XL330-M288"], 2, baud=SERVO_BAUD, shaft_ticks=2500.0)
        self.pan, self.zoom = pan, zoom
        self.bus_monitor = BusMonitor({1: (-1e6, 1e6), 2: (-1e6, 1e6)})
        self.bus = EmulatedBus([pan, zoom], self.bus_monitor)
        self.bus_line = BusLine(self.bus, (), baud=SERVO_BAUD)
        self.camera = EmulatedCamera(
            lambda _t: RigPose(0.0, 0.0, 0.0, 0.0), view, timing or CameraTiming(), faults=camera_faults
        )
        self.controls, self.stubborn = dict(CONTROLS), frozenset[int]()
        self.clock.attach(self.gantry_wire)
        self.clock.attach(self.bus_line)
        self.clock.attach(self.camera)
        self.clock.sleep_s(0.05)
        self.found_camera = FoundCamera("/dev/null", "Bench camera", "046d:0825", "1234", 0, (CAMERA,))
        self.latency_ms = 1
        runtime = folder / "runtime"
        runtime.mkdir(mode=0o700)
        self.world = Surroundings(
            self.clock,
            make=self.make,
            find_port=lambda name: name,
            may_use=lambda _device: True,
            refuse_held=HeldElsewhere({}),
            latency_ms=lambda _device: self.latency_ms,
            find_camera=lambda _settings: self.found_camera,
            disk=lambda _folder: DiskLook(int(100e9), 150e6),
            runtime=lambda: runtime,
        )

    @property
    def bench_file(self) -> Path:
        """Written anew with what `file` says."""
        path = self.folder / "bench.yaml"
        path.write_text(yaml.safe_dump(self.file))
        return path

    def findings(self, **changes: Any) -> list[Finding]:
        """What the doctor finds."""
        world = replace(self.world, **changes)
        return list(examine(load_bench(self.bench_file), world, self.folder))

    def make(self, device: Device, clock: Clock) -> Any:
        """One device on its emulator: a `rig.bench.Maker`."""
        settings = device.settings
        if isinstance(settings, GrblSettings):
            return GrblGantry(settings, clock, open_port=self.open_gantry)
        if isinstance(settings, CameraSettings):
            return OpenCvCamera(settings, clock, open_source=self.open_source, drain=InlineDrain())
        bus = DynamixelBus(settings.port, settings.baud, clock, latency_timer_ms=16, open_port=self.open_bus)
        return DynamixelAxis(settings, clock, bus=bus)

    def open_gantry(self, settings: GrblSettings) -> SerialPort:
        if settings.port == BUS_PORT:
            return self.open_bus(settings.port, settings.baud)
        port = SimulatedPort(self.gantry_wire, self.clock, port=settings.port, timeout=READ_SLICE_S)
        return port if settings.baud == self.gantry_baud else Mistuned(port)

    def open_bus(self, name: str, baud: int) -> SerialPort:
        if name == GANTRY_PORT:
            port = SimulatedPort(self.gantry_wire, self.clock, port=name, timeout=READ_SLICE_S)
            return port if baud == self.gantry_baud else Mistuned(port)
        self.bus.host_baud = baud
        return SimulatedPort(self.bus_line, self.clock, baudrate=baud, timeout=READ_SLICE_S)

    def open_source(self, _settings: CameraSettings, clock: Clock) -> Any:
        return EmulatedCapture(self.camera, clock, controls=self.controls, stubborn=self.stubborn)

    def reference(self, servo: Servo) -> None:
        """Note its turns in it, as a session leaves it."""
        servo.write(168, note_of(0).to_bytes(6, "little"))

    @contextmanager
    def untouched(self) -> Iterator[None]:
        """Nothing inside moves, homes, unlocks or resets anything, or says more on the wires than questions."""
        before = [bytes(servo.memory.read(0, 64)) for servo in self.bus.servos]
        state = (self.machine.state, self.machine.homed, self.machine.alarm, self.machine.mechanics.position)
        torque = [(servo.torque, servo.shaft_ticks) for servo in self.bus.servos]
        yield
        assert [bytes(servo.memory.read(0, 64)) for servo in self.bus.servos] == before
        assert [(servo.torque, servo.shaft_ticks) for servo in self.bus.servos] == torque
        after = (self.machine.state, self.machine.homed, self.machine.alarm, self.machine.mechanics.position)
        assert after == state
        assert self.lines_to_gantry() <= {b"$I", b"$$"}
        assert self.instructions() <= {1, 2, 0x82}  # ping, read, sync read

    def lines_to_gantry(self) -> set[bytes]:
        """Lines that went to the gantry at its own baud rate; at another nothing but ``?`` may go out."""
        heard = b"".join(data for _, data in self.gantry_wire.written)
        assert b"\x18" not in heard
        return set(heard.translate(None, b"?\x90\xbf").split(b"\n")) - {b""}

    def instructions(self) -> set[int]:
        """Instructions of the packets that went to the servos."""
        packets = b"".join(data for _, data in self.bus_line.written).split(b"\xff\xff\xfd\x00")[1:]
        return {packet[3] for packet in packets}


def text_of(findings: list[Finding]) -> str:
    """The findings that are no pass as one text, for messages."""
    lines = [
        f"{f.subject}: {f.what}: {f.ok.value}: {f.told} > {f.remedy}" for f in findings if f.ok is not Verdict.PASS
    ]
    return os.linesep.join(lines)
