"""The emulated controller's main loop: reads lines from the receive buffer, obeys them, and answers each.

Every ``yield`` is a place where the firmware would wait; it goes on after the next event.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from sim_backends.grbl_emulator import commands
from sim_backends.grbl_emulator.gcode import LineError
from sim_backends.grbl_emulator.moves import run_gcode
from sim_backends.grbl_emulator.states import State

if TYPE_CHECKING:  # the machine imports this module
    from sim_backends.grbl_emulator.machine import GrblMachine

Waiting = Generator[None, None, None]


def main_loop(machine: GrblMachine) -> Waiting:
    """GRBL's main loop: lines, and whenever there is nothing to read the start of what is planned."""
    line, overflow, comment = "", False, ""
    while True:
        if not machine.rx:
            machine.start_cycle()
            yield
            continue
        char = chr(machine.rx.popleft())
        if char in "\r\n":
            yield from _answer(machine, line, overflow=overflow)
            line, overflow, comment = "", False, ""
        elif comment:
            comment = "" if (comment, char) == ("(", ")") else comment
        elif char in "(;":
            comment = char
        elif char > " " and char != "/":
            overflow = overflow or len(line) >= machine.dialect.line_length
            line += "" if overflow else char.upper()


def _answer(machine: GrblMachine, line: str, *, overflow: bool) -> Waiting:
    yield from machine.wait_s(machine.lag_s)
    gcode = not overflow and line != "" and line[0] != "$"
    try:
        if overflow:
            raise LineError(11)
        if gcode and machine.state in (State.ALARM, State.JOG):
            raise LineError(9)
        if gcode and machine.dialect.errors_stick and machine.last_error:
            raise LineError(machine.last_error)
        if gcode:
            yield from run_gcode(machine, line)
        elif line:
            yield from commands.obey(machine, line)
    except LineError as error:
        machine.last_error = error.code
        machine.say(str(error))
        return
    machine.last_error = 0
    machine.say("ok")


def dead_loop() -> Waiting:
    """Obey nothing: no power, or an alarm that only a reset ends."""
    while True:
        yield
