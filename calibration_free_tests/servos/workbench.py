"""An emulated bench of servos for the tests: everything on simulated time, no real port."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from drivers.dynamixel import DynamixelAxis, DynamixelBus, DynamixelSettings
from drivers.serial_link import READ_SLICE_S, SerialPort
from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.bus import EmulatedBus
from sim_backends.dynamixel_emulator.line import BusLine
from sim_backends.dynamixel_emulator.monitor import Monitor
from sim_backends.dynamixel_emulator.servo import Servo
from sim_backends.faults import Fault
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.simulated_port import SimulatedPort

PAN, ZOOM = 1, 2
BAUD = 1_000_000
ZOOM_TABLE = ((0.0, 0.0), (0.25, 30.0), (0.7, 60.0), (1.0, 120.0))
MODE_NUMBER = {"position": table.POSITION, "extended": table.EXTENDED, "current_based": table.CURRENT_BASED}
COMMON: dict[str, Any] = {"port": "bus", "baud": BAUD, "latency_timer_ms": 1}


def pan_settings(**changes: Any) -> DynamixelSettings:
    """A pan axis without gear, -300° to 300°, 0° at 2048 ticks, in extended position mode."""
    role = {"kind": "pan", "lower_deg": -300.0, "upper_deg": 300.0, **changes.pop("role", {})}
    own = {"id": PAN, "model": "XM430-W350", "mode": "extended", "role": role}
    return DynamixelSettings(**{**COMMON, **own, **changes})


def zoom_settings(**changes: Any) -> DynamixelSettings:
    """A zoom ring behind a gear of 2, in position mode."""
    role = {"kind": "zoom", "table": ZOOM_TABLE, "gear_ratio": 2.0, "zero_ticks": 500, **changes.pop("role", {})}
    own = {"id": ZOOM, "model": "XL330-M288", "mode": "position", "role": role, "speed_deg_per_s": 60.0}
    return DynamixelSettings(**{**COMMON, **own, **changes})


class Workbench:
    """Servos as the settings want them, the emulated line that they are on, and axes that share one bus."""

    def __init__(
        self,
        *settings: DynamixelSettings,
        script: Sequence[Fault] = (),
        shaft_ticks: float = 2048.0,
        dead: Exception | None = None,
    ) -> None:
        """Set up, on simulated time; ``dead`` is what a port raises that was unplugged."""
        self.clock = SimulatedClock()
        self.dead = dead
        self.servos = [_servo(one, shaft_ticks) for one in settings]
        self.monitor = Monitor({one.id: _travel(one) for one in settings})
        self.emulated = EmulatedBus(self.servos, self.monitor)
        self.line = BusLine(self.emulated, script, baud=BAUD)
        self.clock.attach(self.line)
        self.bus = self.make_bus()
        self.axes = [DynamixelAxis(one, self.clock, bus=self.bus) for one in settings]

    def make_bus(self) -> DynamixelBus:
        """A bus as another process would make it."""
        return DynamixelBus("bus", BAUD, self.clock, latency_timer_ms=1, open_port=self.open_port)

    def open_port(self, name: str, baud: int) -> SerialPort:
        """Stands in for opening the real port."""
        self.emulated.host_baud = baud
        return SimulatedPort(self.line, self.clock, baudrate=baud, timeout=READ_SLICE_S, unplugged=self.dead)

    @property
    def axis(self) -> DynamixelAxis:
        """The first axis."""
        return self.axes[0]

    @property
    def servo(self) -> Servo:
        """The first servo."""
        return self.servos[0]

    def ready(self, position: float = 0.0) -> DynamixelAxis:
        """The first axis, connected, referenced and holding."""
        self.axis.connect()
        if not self.axis.status().referenced:
            self.axis.reference(position)
        self.axis.enable()
        return self.axis

    def angle_deg(self, axis: DynamixelAxis | None = None) -> float:
        """Where the shaft behind an axis really is."""
        one = axis or self.axis
        servo = self.emulated.servo(one.settings.id)
        self.line.advance_to(self.clock.now_s())
        return one.settings.role.angle_deg_at(servo.shaft_ticks)


def _servo(settings: DynamixelSettings, shaft_ticks: float) -> Servo:
    servo = Servo(table.MODELS[settings.model], settings.id, baud=settings.baud, shaft_ticks=shaft_ticks)
    servo.memory[table.OPERATING_MODE] = MODE_NUMBER[settings.mode]
    return servo


def _travel(settings: DynamixelSettings) -> tuple[float, float]:
    role = settings.role
    ends = [role.ticks_at(role.to_angle_deg(position)) for position in (role.lower, role.upper)]
    return min(ends) - 1.0, max(ends) + 1.0
