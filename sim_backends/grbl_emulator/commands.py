"""The ``$`` commands of the emulated controller, and in which states each is refused."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from sim_backends.grbl_emulator import report
from sim_backends.grbl_emulator.eeprom import WRITE_S
from sim_backends.grbl_emulator.gcode import LineError
from sim_backends.grbl_emulator.homing import home
from sim_backends.grbl_emulator.moves import run_gcode

if TYPE_CHECKING:  # the machine imports this module
    from sim_backends.grbl_emulator.machine import GrblMachine

Waiting = Generator[None, None, None]


def obey(machine: GrblMachine, line: str) -> Waiting:
    """Obey a line that begins with ``$``.

    Raises:
        LineError: it is refused.
    """
    state = machine.state.value
    if line.startswith("$J="):
        if state not in ("Idle", "Jog"):
            raise LineError(8)
        yield from run_gcode(machine, line[3:], jog=True)
    elif line == "$G":
        machine.say(report.modal_line(machine))
    elif line == "$":
        machine.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
    elif line == "$X":
        _unlock(machine)
    elif state not in ("Idle", "Alarm"):
        raise LineError(8)
    elif line == "$$":
        for setting in machine.eeprom.report():
            machine.say(setting)
    elif line == "$I":
        for text in machine.dialect.identity:
            machine.say(text)
    elif line == "$#":
        for text in report.offset_lines(machine):
            machine.say(text)
    elif line == "$H":
        if not machine.eeprom.flag(22):
            raise LineError(5)
        if machine.critical:
            raise LineError(79)
        yield from home(machine)
    else:
        machine.eeprom.write(line[1:])
        yield from machine.wait_s(WRITE_S, "deaf")


def _unlock(machine: GrblMachine) -> None:
    if machine.state.value != "Alarm":
        return
    if machine.critical:
        raise LineError(79)
    if machine.alarm is not None and machine.alarm == machine.dialect.homing_lock_alarm:
        raise LineError(46)
    machine.unlock()
