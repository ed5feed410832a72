"""Reads the servos on their bus and compares them with the bench file.

Nothing is written to a servo: its bus is opened and read, but not the axis connected, since an axis that is closed
follows its torque policy, and what it carries might fall.
"""

from __future__ import annotations

from typing import Any

from drivers.dynamixel import DynamixelAxis, DynamixelBus
from drivers.dynamixel.answers import NoAnswerError
from drivers.dynamixel.probe import FoundServo, found_on
from drivers.dynamixel.reading import ServoReading, read_servo
from drivers.dynamixel.settings import BAUD_RATES, DynamixelSettings
from rig.bench import Device
from rig.devices import LiveAxis
from rig.doctor.finding import Finding, failed, in_two, not_tested, passed, raised
from rig.doctor.gantry import who_answers
from rig.doctor.servo_checks import CHECKS, Seen, check_servo
from rig.doctor.surroundings import Surroundings
from rig.errors import HardwareError


def lines_of(device: Device) -> tuple[str, ...]:
    """What is looked at behind the port, to be told as not tested where that failed."""
    return ("answers", *CHECKS) if isinstance(device.settings, DynamixelSettings) else ("answers", "state")


def check_axis(device: Device, *, missing: Device | None, on_bus: int, world: Surroundings) -> list[Finding]:
    """All lines of a pan axis or zoom ring behind those of its port.

    Args:
        device: the axis.
        missing: the bench's gantry, where it did not answer: it may be on this port.
        on_bus: how many axes of the bench share the port.
        world: this computer.
    """
    axis = (world.make or (lambda d, clock: d.make(d.settings, clock)))(device, world.clock)
    if isinstance(axis, DynamixelAxis):
        return _check_dynamixel(device.role, axis, missing, on_bus, world)
    return _check_other(device.role, axis)


def _check_dynamixel(
    subject: str, axis: DynamixelAxis, missing: Device | None, on_bus: int, world: Surroundings
) -> list[Finding]:
    settings = axis.settings
    # Looked at first, since packets for servos are not for the ears of a gantry's controller.
    swapped = None if missing is None else _swapped(subject, settings, missing, world)
    if swapped is not None:
        return _mute(subject, swapped)
    try:
        reading = _read(axis)
    except NoAnswerError as error:
        return _mute(subject, _elsewhere(subject, settings, axis.bus) or raised(subject, "answers", error))
    except HardwareError as error:
        return _mute(subject, raised(subject, "answers", error))
    answers = passed(subject, "answers", f"id {settings.id} at {settings.baud} baud")
    return [answers, *check_servo(Seen(subject, settings, reading, on_bus, _latency_ms(settings, world)))]


def _read(axis: DynamixelAxis) -> ServoReading:
    axis.bus.open(axis)
    try:
        return read_servo(axis.bus, axis.settings.id)
    finally:
        axis.bus.close(axis)


def _mute(subject: str, finding: Finding) -> list[Finding]:
    return [finding, *not_tested(subject, CHECKS, f"{subject}: answers")]


def _latency_ms(settings: DynamixelSettings, world: Surroundings) -> int | None:
    try:
        return world.latency_ms(world.find_port(settings.port))
    except HardwareError:
        return None  # unplugged meanwhile: the line that reads it has told


def _swapped(subject: str, settings: DynamixelSettings, gantry: Device, world: Surroundings) -> Finding | None:
    """Whether the gantry's controller is what answers on the servos' port."""
    identity = who_answers(gantry, world, port=settings.port)
    if identity is None:
        return None
    told = f"{identity.kind} {identity.version} answers on {settings.port}, which is to be the servos' port"
    return failed(subject, "answers", told, f"Swap the ports of gantry and {subject} in the bench file")


def _elsewhere(subject: str, settings: DynamixelSettings, bus: DynamixelBus) -> Finding | None:
    """Who does answer on this port, if anybody: under another id, or at another baud rate."""
    found: list[FoundServo] = []
    for baud in (settings.baud, *(baud for baud in BAUD_RATES if baud != settings.baud)):
        try:
            found += found_on(bus.at(baud))
        except HardwareError:
            return None  # the port has failed: the first error tells
    same = [servo for servo in found if servo.id == settings.id]
    if same:
        told = f"id {settings.id} answers at {same[0].baud} baud, not at {settings.baud}"
        return failed(subject, "answers", told, f"Set devices.{subject}.baud to {same[0].baud}")
    if found:
        there = ", ".join(f"id {servo.id} ({servo.model}) at {servo.baud} baud" for servo in found)
        told = f"nobody has the id {settings.id}; there is {there}"
        return failed(subject, "answers", told, f"Set devices.{subject}.id to the one that is meant")
    return None


def _check_other(subject: str, axis: LiveAxis | Any) -> list[Finding]:
    """An axis of another driver: connected, asked, closed, as `rig status` does."""
    try:
        identity = axis.connect()
    except HardwareError as error:
        return [raised(subject, "answers", error), *not_tested(subject, ("state",), f"{subject}: answers")]
    found = [passed(subject, "answers", f"{identity.kind} {identity.version}".strip())]
    try:
        status = axis.status()
        told, remedy = in_two(status.trouble)
        found.append(failed(subject, "state", told, remedy) if told else passed(subject, "state", status.motion.value))
    except HardwareError as error:
        found.append(raised(subject, "state", error))
    finally:
        axis.close()
    return found
