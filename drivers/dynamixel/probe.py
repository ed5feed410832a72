"""Looks which servos are on a port, at which baud rates and ids. Writes nothing to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.dynamixel.answers import NoAnswerError
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.settings import BAUD_RATES
from drivers.dynamixel.table import model_named
from drivers.serial_link import SerialPort
from rig.devices import Clock


@dataclass(frozen=True, slots=True)
class FoundServo:
    """A servo that answered."""

    baud: int
    id: int
    model: str
    firmware: int


def probe(
    port: str,
    clock: Clock,
    bauds: Sequence[int] = BAUD_RATES,
    *,
    open_port: Callable[[str, int], SerialPort] | None = None,
) -> list[FoundServo]:
    """All servos that answer a ping to everyone, by baud rate and id; about a second for each baud rate.

    Raises:
        HardwareError: the port cannot be opened, is in use (names the holder), or fails.
    """
    found = []
    for baud in bauds:
        bus = DynamixelBus(port, baud, clock, latency_timer_ms=_PATIENT_MS, open_port=open_port)
        user = object()
        bus.open(user)
        try:
            for servo_id, (_, firmware) in sorted(bus.broadcast_ping().items()):
                try:
                    found.append(FoundServo(baud, servo_id, model_named(bus.ping(servo_id)), firmware))
                except NoAnswerError:
                    continue  # an echo or noise that looked like a servo
        finally:
            bus.close(user)
    return found


_PATIENT_MS = 255
"""Whatever the adapter's latency timer is, it may stay: nothing here is urgent."""
