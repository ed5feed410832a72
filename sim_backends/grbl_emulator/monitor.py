"""Judges every byte that reaches the emulated machine: does it command what must never be commanded?

It puts lines together by itself, apart from the machine's own reading, and looks at each as it ends. That a machine
has just lost its homing or gone into alarm cannot be known to the host at once: what was on its way then, however long
the wire kept it, is not held against it, and what the wire altered is marked so.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_backends.faults import WireByte
from sim_backends.grbl_emulator.gcode import LineError, Move, Triple, interpret

if TYPE_CHECKING:  # the machine imports this module
    from sim_backends.grbl_emulator.machine import GrblMachine

_NOT_FINITE = re.compile(r"NAN|INF|[0-9.]E[+-]?[0-9]")
_SLACK_MM = 1e-6


@dataclass(frozen=True, slots=True)
class Violation:
    """What should not have been commanded.

    Attributes:
        at_s: when the line was complete.
        what: the rule that it breaks.
        line: its text.
        altered: the wire changed some of its bytes; the host did not write it so.
    """

    at_s: float
    what: str
    line: str
    altered: bool


class Monitor:
    """Rules: no motion while unhomed, none in alarm, none outside the limits, no number that is not finite."""

    def __init__(
        self,
        lower_mm: Triple,
        upper_mm: Triple,
        *,
        needs_homing: bool = True,
        unhomed_jog_mm: float = 0.0,
        notice_s: float = 0.1,
    ) -> None:
        """Set the rules.

        Args:
            lower_mm, upper_mm: where the machine may be sent, machine coordinates.
            needs_homing: whether motion before homing is against the rules.
            unhomed_jog_mm: a jog that is no longer than this is allowed before homing.
            notice_s: how long a host is given to notice that homing was lost or an alarm raised.
        """
        self._lower_mm, self._upper_mm = lower_mm, upper_mm
        self._needs_homing, self._unhomed_jog_mm, self._notice_s = needs_homing, unhomed_jog_mm, notice_s
        self._line, self._altered = "", False
        self._since: dict[str, float] = {}
        self.violations: list[Violation] = []
        self.bytes_seen = 0
        self.moves_seen = 0

    @property
    def blamed_on_host(self) -> list[Violation]:
        """The violations that the host wrote itself."""
        return [violation for violation in self.violations if not violation.altered]

    def record(self, at_s: float, what: str, line: str, *, altered: bool) -> None:
        """Note a violation."""
        self.violations.append(Violation(at_s, what, line, altered))

    def look(self, machine: GrblMachine) -> None:
        """Note since when the machine has been unhomed or in alarm."""
        self._watch("unhomed", machine.now_s, holds=not machine.homed)
        self._watch("in alarm", machine.now_s, holds=machine.state.value == "Alarm")

    def observe(self, byte: WireByte, machine: GrblMachine) -> None:
        """Look at a byte, before the machine reads it."""
        self.bytes_seen += 1
        self.look(machine)
        self._altered = self._altered or byte.altered
        char = chr(byte.value)
        if byte.value == 0x18:
            self._line, self._altered = "", byte.altered
        elif char in "\r\n":
            self._judge(re.sub(r"\([^)]*\)|;.*", "", self._line).upper(), machine, byte.sent_at_s)
            self._line, self._altered = "", False
        elif char > " " and byte.value < 0x7F and char not in "?!~":
            self._line += char

    def _watch(self, name: str, now_s: float, *, holds: bool) -> None:
        if holds:
            self._since.setdefault(name, now_s)
        else:
            self._since.pop(name, None)

    def _known(self, name: str, sent_at_s: float) -> bool:
        """Whether it had been so for long enough to be known when the host wrote; a slow wire is no fault of its."""
        return name in self._since and sent_at_s - self._since[name] >= self._notice_s

    def _judge(self, line: str, machine: GrblMachine, sent_at_s: float) -> None:
        if _NOT_FINITE.search(line):
            self.record(machine.now_s, "a number that is not finite", line, altered=self._altered)
        jog = line.startswith("$J=")
        if line.startswith("$") and not jog:
            return
        at = machine.planner.end
        try:
            action = interpret(line[3:] if jog else line, machine.modal, machine.eeprom.offsets, at, jog=jog)[1]
        except LineError:
            return  # the machine refuses it
        if not isinstance(action, Move):
            return
        self.moves_seen += 1
        for what in self._broken_rules(action, at, machine, sent_at_s, jog=jog):
            self.record(machine.now_s, what, line, altered=self._altered)

    def _broken_rules(self, move: Move, at: Triple, machine: GrblMachine, sent_at_s: float, *, jog: bool) -> list[str]:
        broken = []
        length = math.dist(move.target, at)
        homed_enough = not self._needs_homing or (jog and length <= self._unhomed_jog_mm + _SLACK_MM)
        if self._known("unhomed", sent_at_s) and not homed_enough:
            broken.append("motion while unhomed")
        if self._known("in alarm", sent_at_s):
            broken.append("motion in alarm")
        ends = zip("XYZ", move.target, self._lower_mm, self._upper_mm, strict=True)
        if machine.homed:
            broken += [
                f"motion out of limits: {axis}{value:.3f}"
                for axis, value, lower, upper in ends
                if not (math.isfinite(value) and lower - _SLACK_MM <= value <= upper + _SLACK_MM)
            ]
        return broken
