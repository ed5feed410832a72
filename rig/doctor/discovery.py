"""Finds out what is connected to this computer: gantry controllers and servos on its USB serial ports, and cameras.

Each port is asked for a gantry first, with status queries that mean nothing to a servo, and only where none answers for
servos, with pings to everyone. Nothing else is sent, and nothing is written to any device. Opening a port may restart a
board by its DTR line; it is opened with DTR off, which restarts few.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.camera_identity import FoundCamera
from drivers.dynamixel import DynamixelBus, FoundServo
from drivers.dynamixel.probe import found_on
from drivers.dynamixel.reading import read_servo
from drivers.dynamixel.settings import BAUD_RATES
from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblAxis, GrblDeadlines, GrblSettings
from rig.devices import Identity
from rig.doctor.gantry import USUAL_BAUD_RATES
from rig.doctor.surroundings import Surroundings
from rig.errors import HardwareError

_ANSWER_S = 3.0
"""A board that restarts when its port is opened needs two."""
_BY_PATH = "/dev/v4l/by-path/"
_PATIENT_MS = 255


@dataclass(frozen=True)
class SeenGantry:
    """A controller that answered."""

    port: str
    baud: int
    identity: Identity
    firmware: Mapping[int, float] = field(repr=False)


@dataclass(frozen=True, slots=True)
class SeenServo:
    """A servo that answered, its operating mode by number, and where it stands, ticks."""

    port: str
    servo: FoundServo
    mode: int
    position: int


@dataclass(frozen=True)
class SeenPort:
    """A port, who answered on it, and, where nobody did, why."""

    port: str
    gantry: SeenGantry | None = None
    servos: tuple[SeenServo, ...] = ()
    trouble: str = ""


@dataclass(frozen=True)
class Seen:
    """Everything that was found."""

    ports: tuple[SeenPort, ...]
    cameras: tuple[FoundCamera, ...]

    @property
    def gantry(self) -> SeenGantry | None:
        """The first one."""
        return next((port.gantry for port in self.ports if port.gantry is not None), None)

    @property
    def servos(self) -> tuple[SeenServo, ...]:
        """All of them, port by port."""
        return tuple(servo for port in self.ports for servo in port.servos)


def discover(world: Surroundings) -> Seen:
    """Ask every USB serial port, and list the cameras; up to half a minute for a port where nobody answers."""
    adapters = sorted(adapter.device for adapter in world.adapters() if adapter.vid is not None)
    cameras = tuple(camera for camera in world.cameras() if camera.index == 0 and camera.paths)
    return Seen(tuple(_asked(world.stable_name(device), world) for device in adapters), cameras)


def camera_path(camera: FoundCamera) -> str:
    """The path that tells where it is plugged in, or else another that stays."""
    return next((path for path in camera.paths if path.startswith(_BY_PATH)), camera.paths[0])


def found_object(found: Seen) -> dict[str, Any]:
    """For scripts, as one JSON object."""
    ports = []
    for port in found.ports:
        answers = [f"servo {s.servo.id}, {s.servo.model}, at {s.servo.baud} baud" for s in port.servos]
        if port.gantry is not None:
            who = port.gantry.identity
            answers.append(f"{who.kind} {who.version} at {port.gantry.baud} baud")
        ports.append({"port": port.port, "answers": answers, "trouble": port.trouble})
    cameras = [{"path": camera_path(camera), "identity": camera.identity} for camera in found.cameras]
    return {"ports": ports, "cameras": cameras}


def _asked(port: str, world: Surroundings) -> SeenPort:
    try:
        gantry = _gantry_on(port, world)
        if gantry is not None:
            return SeenPort(port, gantry)
        return SeenPort(port, servos=_servos_on(port, world))
    except HardwareError as error:
        return SeenPort(port, trouble=str(error))


def _gantry_on(port: str, world: Surroundings) -> SeenGantry | None:
    nowhere = GrblAxis(lower_mm=-1.0, upper_mm=0.0, feed_mm_per_min=1.0)
    for baud in USUAL_BAUD_RATES:
        settings = GrblSettings(
            port=port, baud=baud, x=nowhere, y=nowhere, z=nowhere, deadlines=GrblDeadlines(connect_s=_ANSWER_S)
        )
        gantry = GrblGantry(settings, world.clock, open_port=world.open_gantry)
        try:
            identity = gantry.connect()
            return SeenGantry(port, baud, identity, gantry.firmware_settings)
        except HardwareError:
            continue  # one that is in use or may not be opened is told of when it is asked for servos
        finally:
            gantry.close()
    return None


def _servos_on(port: str, world: Surroundings) -> tuple[SeenServo, ...]:
    found = []
    for baud in BAUD_RATES:
        bus = DynamixelBus(port, baud, world.clock, latency_timer_ms=_PATIENT_MS, open_port=world.open_bus)
        for servo in found_on(bus):
            bus.open(servo)
            try:
                reading = read_servo(bus, servo.id)
            finally:
                bus.close(servo)
            found.append(SeenServo(port, servo, reading.setup.operating_mode, reading.state.position))
    return tuple(found)
