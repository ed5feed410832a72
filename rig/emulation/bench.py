"""The emulated bench: a controller, servos and a camera as a live bench file describes them, and the truth of them.

The camera sees what it would see from where the emulated axes really are. With a simulated clock everything runs in
one thread and in no time; without one, on pseudo-terminals and a stream on this computer, for any program to use.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from drivers.camera_settings import CameraSettings
from drivers.draining import InlineDrain
from drivers.dynamixel import DynamixelAxis, DynamixelBus, DynamixelSettings
from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblSettings
from drivers.opencv_camera import OpenCvCamera
from drivers.serial_link import READ_SLICE_S
from drivers.stopping_all import one_after_another
from rig.bench import BenchConfig, Device, open_live
from rig.clock import SystemClock
from rig.devices import Clock
from rig.emulation.emulable import emulable
from rig.emulation.files import bench_text
from rig.emulation.gantry import emulated_gantry
from rig.emulation.serving import READOUT_S, Served
from rig.emulation.servos import emulated_buses, position_of
from rig.errors import InputError
from rig.guard import Guard
from rig.hal import RigPose
from sim_backends.camera_emulator import CameraTiming, EmulatedCamera
from sim_backends.camera_faults import CameraFault
from sim_backends.camera_pictures import Pictures
from sim_backends.dynamixel_emulator.line import BusLine
from sim_backends.emulated_capture import EmulatedCapture
from sim_backends.faults import Fault
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.simulated_port import SimulatedPort
from sim_backends.wired_device import WiredDevice

_FRAME_RATE_HZ, _EXPOSURE_S = 10.0, 0.01
_MOST_BUFFERED = 4


class EmulatedBench:
    """All devices of one live bench, emulated.

    On simulated time `open` gives a guarded rig on them. Without a clock it is a context manager: inside it the ports
    exist, and `file_for` writes the bench file by which `rig` commands, or other programs, use them.

    Attributes:
        config: the bench.
        gantry: the emulated controller; ``gantry.monitor`` judges its bytes, ``gantry.mechanics`` is the truth.
        servos: by role, ``pan`` and ``zoom``.
        buses: by the port that the bench file names; ``monitor`` of each judges its packets.
        lines: the serial lines with their plugs and fault scripts, by port.
        camera: the emulated camera.
    """

    def __init__(
        self,
        config: BenchConfig,
        view: Pictures,
        *,
        clock: SimulatedClock | None = None,
        scripts: Mapping[str, Sequence[Fault]] | None = None,
        camera_faults: Sequence[CameraFault] = (),
        camera_timing: CameraTiming | None = None,
        counter_px: int | None = None,
        dialect: Dialect = GRBL_1_1,
        start_delay_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        """Switch all devices on.

        Args:
            config: of a live bench with GRBL gantry, Dynamixel axes and OpenCV camera.
            view: what the camera sees from a pose (`rig.emulation.object_view`, `grid_view`).
            clock: simulated time; ``None``: real time.
            scripts: faults by role; ``pan`` and ``zoom`` on one bus have one wire, and all faults of both.
            camera_faults: what goes wrong with the camera, on its own clock.
            camera_timing: how the camera runs; ``None``: as the bench file asks.
            counter_px: draws a frame counter of this block size into the pictures, for judges.
            dialect: the controller's firmware.
            start_delay_s: see `GrblMachine`.
            seed: of the camera's noise.

        Raises:
            InputError: a mock bench, or a device that there is no emulator for.
        """
        self.config, self.clock = config, clock
        self._file = emulable(config)
        self._gantry: GrblSettings = config.devices["gantry"].settings  # type: ignore[assignment]  # `emulable` looked
        self._axes: dict[str, DynamixelSettings] = {
            role: config.devices[role].settings  # type: ignore[misc]  # as above
            for role in ("pan", "zoom")
            if role in config.devices
        }
        self._camera: CameraSettings = config.devices["camera"].settings  # type: ignore[assignment]  # as above
        self.gantry = emulated_gantry(self._gantry, dialect=dialect, start_delay_s=start_delay_s)
        self.servos, self.buses = emulated_buses(self._axes)
        self.lines = self._wired(scripts or {})
        self.camera = EmulatedCamera(
            self._pose_at,
            view,
            camera_timing or _timing(self._camera),
            faults=camera_faults,
            counter_px=counter_px,
            seed=seed,
            start_s=(clock or SystemClock()).now_s(),
        )
        self._shared: dict[str, DynamixelBus] = {}
        self._served: Served | None = None
        if clock is not None:
            for line in self.lines.values():
                clock.attach(line)
            clock.attach(self.camera)

    @property
    def pose(self) -> RigPose:
        """For judges: where the axes really are now, in the rig frame, whatever anybody has read."""
        if self._served is None:
            return self._truth()
        with self._served.bring_up_to_date():
            return self._truth()

    # On simulated time.

    def make(self, device: Device, clock: Clock) -> Any:
        """A `rig.bench.Maker`: a driver on the emulated device; axes on one port share their bus."""
        settings = device.settings
        if isinstance(settings, GrblSettings):
            return GrblGantry(settings, clock, open_port=lambda wanted: self._port(wanted.port, wanted.baud))
        if isinstance(settings, DynamixelSettings):
            bus = self._shared.get(settings.port)
            if bus is None:
                latency_ms = settings.latency_timer_ms
                bus = DynamixelBus(
                    settings.port, settings.baud, clock, latency_timer_ms=latency_ms, open_port=self._bus_port
                )
                self._shared[settings.port] = bus
            return DynamixelAxis(settings, clock, bus=bus)
        return OpenCvCamera(
            self._camera, clock, open_source=lambda _, now: EmulatedCapture(self.camera, now), drain=InlineDrain()
        )

    def open(self, *, runtime: Path | None = None, **others: Any) -> Guard:
        """The guarded rig on simulated time, not connected yet, as a process of its own would make it.

        Args:
            runtime: where processes meet; ``None``: a folder of this bench's own.
            others: as of `rig.bench.open_live`.
        """
        if self.clock is None:
            raise ValueError("a bench on real time is opened by the bench file that `file_for` writes")
        self._shared = {}
        options: dict[str, Any] = {
            "stops": one_after_another,
            "make": self.make,
            "runtime": runtime or self._runtime,
        } | others
        return open_live(self.config, clock=self.clock, **options)

    # On real time.

    def __enter__(self) -> EmulatedBench:
        if self.clock is not None:
            raise ValueError("a bench on simulated time has no ports to start")
        self._served = Served(self.lines)
        self._served.start(self.camera)
        return self

    def __exit__(self, *exc: object) -> None:
        if self._served is not None:
            self._served.close()

    def file_for(self, path: Path) -> Path:
        """Write the bench file by which the running emulators are used; returns its path.

        Raises:
            InputError: it cannot be written.
        """
        if self._served is None:
            raise ValueError("enter the bench first: its ports do not exist yet")
        try:
            path.write_text(bench_text(self.config, self._served.ports, self._served.url), encoding="utf-8")
        except OSError as failure:
            reason = f"the bench file cannot be written ({failure.strerror or failure})"
            raise InputError(reason, where=str(path), remedy="Name another place") from failure
        return path

    # Within.

    def _wired(self, scripts: Mapping[str, Sequence[Fault]]) -> dict[str, WiredDevice]:
        baud = self._gantry.baud
        lines = {self._gantry.port: WiredDevice(self.gantry, scripts.get("gantry", ()), seconds_per_byte=10.0 / baud)}
        for port, bus in self.buses.items():
            roles = [role for role, settings in self._axes.items() if settings.port == port]
            script = [fault for role in roles for fault in scripts.get(role, ())]
            lines[port] = BusLine(bus, script, baud=self._axes[roles[0]].baud)
        return lines

    def _port(self, name: str, baud: int) -> SimulatedPort:
        assert self.clock is not None
        return SimulatedPort(self.lines[name], self.clock, port=name, baudrate=baud, timeout=READ_SLICE_S)

    def _bus_port(self, name: str, baud: int) -> SimulatedPort:
        self.buses[name].host_baud = baud
        return self._port(name, baud)

    def _pose_at(self, at_s: float) -> RigPose:
        """Asked by the camera, as its time passes: the present pose."""
        return self.pose

    def _truth(self) -> RigPose:
        placement = self._file.axes.placement
        place = placement.to_rig(self.gantry.mechanics.position)
        at = {role: position_of(servo, self._axes[role]) for role, servo in self.servos.items()}
        theta_deg = placement.to_theta(at["pan"]) if "pan" in at else 0.0
        return RigPose(*place, theta_deg, at.get("zoom", 0.0))

    @cached_property
    def _runtime(self) -> Path:
        """Where the processes of this bench meet, as long as it lives."""
        folder = Path(tempfile.mkdtemp(prefix="rig-emulated-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return folder


def _timing(settings: CameraSettings) -> CameraTiming:
    """A camera as the bench file asks for."""
    rate_hz = settings.frame_rate_hz or _FRAME_RATE_HZ
    return CameraTiming(
        frame_rate_hz=rate_hz,
        exposure_s=min(settings.exposure_s or _EXPOSURE_S, 1.0 / rate_hz),
        readout_s=min(READOUT_S, settings.latency_s),
        buffer_frames=min(_MOST_BUFFERED, settings.buffer_frames),
    )
