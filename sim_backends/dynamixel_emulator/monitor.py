"""Watches every packet that reaches a servo and records what no host may ever do.

A host can only know what it was told: a goal that is on its way while the servo loses its power is no fault of the
host's. So the monitor keeps what each servo last *said* of itself, and judges commands by that and by the limits that
the bench gives. Goals that hold the present place are always allowed: torque is enabled with one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_backends.dynamixel_emulator import table

if TYPE_CHECKING:
    from sim_backends.dynamixel_emulator.servo import Servo
    from sim_backends.dynamixel_emulator.table import Register

HERE_TICKS = 5
"""A goal this near to the shaft is the present place."""


@dataclass
class _Told:
    """What a servo last said of itself."""

    torque_off: bool = True
    failed: bool = False
    unreferenced: bool = True


class Monitor:
    """The judge at the servos' side of the wire.

    Attributes:
        limits: lowest and highest goal by servo id, in ticks of the *shaft* (`Servo.shaft_ticks`), however the
            servo itself counts its turns.
        violations: one sentence for each, with its time; empty where all is well.
        goals: how many goals were seen that are not the present place.
    """

    def __init__(self, limits: Mapping[int, tuple[float, float]]) -> None:
        """Watch; a servo without limits is not held to any."""
        self.limits = dict(limits)
        self.violations: list[str] = []
        self.goals = 0
        self._told: dict[int, _Told] = {}

    def shown(self, servo: Servo, address: int, length: int) -> None:
        """A servo has answered a read."""

        def covers(register: Register) -> bool:
            return address <= register.address and register.end <= address + length

        told = self._told.setdefault(servo.servo_id, _Told())
        memory = servo.memory
        if covers(table.TORQUE):
            told.torque_off = not servo.torque
        if covers(table.HARDWARE_ERROR):
            told.failed = memory[table.HARDWARE_ERROR] != 0
        if covers(table.INDIRECT[0]) and memory[table.OPERATING_MODE] != table.POSITION:
            told.unreferenced = memory[table.INDIRECT[0]] == table.INDIRECT[0].initial

    def writing(self, servo: Servo, address: int, data: bytes, at_s: float) -> None:
        """A write is about to be carried out, or refused, by a servo."""

        def value(register: Register) -> int | None:
            low = register.address - address
            if low < 0 or low + register.size > len(data):
                return None
            return int.from_bytes(data[low : low + register.size], "little", signed=register.signed)

        goal = value(table.GOAL_POSITION)
        if goal is not None:
            self._goal(servo, goal, at_s)
        if value(table.TORQUE) == 1 and not servo.torque:
            off = servo.memory[table.GOAL_POSITION] - servo.present
            if abs(off) > HERE_TICKS:
                self._record(servo, at_s, f"torque enabled with a goal {off} ticks away")
            self._told.setdefault(servo.servo_id, _Told()).torque_off = False

    def factory_reset(self, servo: Servo, at_s: float) -> None:
        """Somebody asked for a factory reset."""
        self._record(servo, at_s, "factory reset")

    def _goal(self, servo: Servo, goal: int, at_s: float) -> None:
        ahead = goal - servo.present
        if abs(ahead) <= HERE_TICKS:
            return
        self.goals += 1
        told = self._told.setdefault(servo.servo_id, _Told())
        if told.torque_off:
            self._record(servo, at_s, f"goal {goal} while torque is off")
        # Less far than it was going: that halts it.
        before = servo.memory[table.GOAL_POSITION] - servo.present
        halts = 0 <= ahead <= before or before <= ahead <= 0
        if told.failed and not halts:
            self._record(servo, at_s, f"goal {goal} with hardware error 0x{servo.memory[table.HARDWARE_ERROR]:02x}")
        if told.unreferenced and servo.memory[table.OPERATING_MODE] != table.POSITION:
            self._record(servo, at_s, f"goal {goal} while not referenced")
        lower, upper = self.limits.get(servo.servo_id, (-float("inf"), float("inf")))
        if not lower <= servo.shaft_ticks + ahead <= upper and servo.torque:
            self._record(servo, at_s, f"goal {goal} outside {lower:g}..{upper:g}")

    def _record(self, servo: Servo, at_s: float, what: str) -> None:
        self.violations.append(f"{at_s:.4f} s: servo {servo.servo_id}: {what}")
