"""What the emulated controller does with a byte the moment it arrives: act at once, or put it into the buffer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_backends.grbl_emulator import report
from sim_backends.grbl_emulator.dialects import RealTime
from sim_backends.grbl_emulator.states import State

if TYPE_CHECKING:  # the machine imports this module
    from sim_backends.grbl_emulator.machine import GrblMachine


def receive(machine: GrblMachine, value: int) -> None:
    """Take a byte; one that finds the buffer full is lost, and GRBL throws away what it does not know above 0x7F."""
    request = machine.dialect.realtime.get(value)
    as_text = machine.dialect.text_in_system_lines and machine.system_line and value in b"?!~"
    if request is not None and not as_text:
        _obey(machine, request)
    elif value < 0x7F and len(machine.rx) < report.RX_BYTES:
        machine.rx.append(value)
        if value in b"\r\n":
            machine.line_open = machine.system_line = False
        elif value > 0x20 and not machine.line_open:
            machine.line_open, machine.system_line = True, value == ord("$")


def _obey(machine: GrblMachine, request: RealTime) -> None:
    if request is RealTime.RESET:
        machine.reset()
    elif machine.critical and machine.dialect.mute_when_critical:
        return
    elif request in (RealTime.STATUS, RealTime.FULL_STATUS):
        _report(machine, everything=request is RealTime.FULL_STATUS)
    elif request is RealTime.HOLD or (request is RealTime.JOG_CANCEL and machine.state is State.JOG):
        _hold(machine)
    elif request is RealTime.RESUME and machine.held:
        machine.state, machine.planner.holding = State.IDLE, False
    elif request is RealTime.MACRO and machine.monitor is not None:
        machine.monitor.record(machine.now_s, "a stored macro was started", "", altered=False)


def _report(machine: GrblMachine, *, everything: bool) -> None:
    if machine.state is State.HOME and not machine.dialect.answers_while_homing:
        machine.asked_while_homing = True
    else:
        machine.say(report.status(machine, everything=everything))


def _hold(machine: GrblMachine) -> None:
    """A jog is cancelled by a hold, every other motion is held."""
    if machine.state is State.JOG:
        machine.planner.hold(machine.now_s)
    elif machine.state in (State.RUN, State.IDLE):
        machine.timers.pop("start", None)
        machine.may_start = False
        machine.state = State.HOLD
        machine.planner.hold(machine.now_s)
