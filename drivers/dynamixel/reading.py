"""Reads everything that a servo tells of itself, and writes nothing: for checks of a bench that nobody drives."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.dynamixel.answers import NoAnswerError
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.table import SETUP_ADDRESS, SETUP_LENGTH, ServoState, Setup, parse_setup
from rig.errors import HardwareError

_RETURN_LEVEL_ADDRESS = 68
_RETURN_DELAY_UNIT_S = 2e-6


@dataclass(frozen=True, slots=True)
class Protection:
    """The servo's own limits, kept in EEPROM.

    Attributes:
        return_delay_s: it waits so long before it answers.
        temperature_c, voltage_v: beyond these it reports a hardware error.
        velocity: its largest, in units of the profile velocity.
        shutdown: bits of the hardware errors that switch torque off.
        return_level: 2: it answers to everything, 1: to pings and reads, 0: to pings.
    """

    return_delay_s: float
    temperature_c: float
    voltage_v: tuple[float, float]
    velocity: int
    shutdown: int
    return_level: int


@dataclass(frozen=True, slots=True)
class ServoReading:
    """A servo at one moment: its model number, EEPROM and state."""

    model_number: int
    setup: Setup
    protection: Protection
    state: ServoState


def read_servo(bus: DynamixelBus, servo_id: int) -> ServoReading:
    """Read a servo on an open bus.

    Raises:
        NoAnswerError: nobody has this id.
        HardwareError: it answers pings alone, or the port has failed.
    """
    model_number = bus.ping(servo_id)
    try:
        block = bus.read(servo_id, SETUP_ADDRESS, SETUP_LENGTH)
        level = bus.read(servo_id, _RETURN_LEVEL_ADDRESS, 1)[0]
        state = bus.state(servo_id)
    except NoAnswerError as error:
        raise HardwareError(
            f"servo {servo_id} answers pings, but not reads. Set its status return level (address 68) to 2"
        ) from error
    return ServoReading(model_number, parse_setup(block), _protection(block, level), state)


def _protection(block: bytes, level: int) -> Protection:
    def number(address: int, size: int) -> int:
        return int.from_bytes(block[address : address + size], "little")

    return Protection(
        return_delay_s=number(9, 1) * _RETURN_DELAY_UNIT_S,
        temperature_c=float(number(31, 1)),
        voltage_v=(number(34, 2) / 10.0, number(32, 2) / 10.0),
        velocity=number(44, 4),
        shutdown=number(63, 1),
        return_level=level,
    )
