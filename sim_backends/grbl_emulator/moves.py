"""Obeys a line of g-code: plans its move, waits its dwell, stores its offset; soft limits are checked here."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from sim_backends.grbl_emulator import report
from sim_backends.grbl_emulator.eeprom import WRITE_S
from sim_backends.grbl_emulator.gcode import Dwell, LineError, Move, StoreOffset, interpret
from sim_backends.grbl_emulator.states import State

if TYPE_CHECKING:  # the machine imports this module, by way of its main loop
    from sim_backends.grbl_emulator.machine import GrblMachine

Waiting = Generator[None, None, None]


def run_gcode(machine: GrblMachine, line: str, *, jog: bool = False) -> Waiting:
    """Obey a line of g-code, or what follows ``$J=``.

    Raises:
        LineError: it is refused.
    """
    modal, action = interpret(line, machine.modal, machine.eeprom.offsets, machine.planner.end, jog=jog)
    offset_before = report.offset(machine)
    match action:
        case Move():
            yield from _plan(machine, action, jog=jog)
        case Dwell(seconds=seconds):
            yield from wait_rest(machine)
            yield from machine.wait_s(seconds)
        case StoreOffset(system=system, offset=stored):
            yield from wait_rest(machine)
            if stored is not None:
                machine.eeprom.offsets[system] = stored
            yield from machine.wait_s(WRITE_S, "deaf")
    machine.modal = modal
    if report.offset(machine) != offset_before:
        machine.reports.offset_changed()


def wait_rest(machine: GrblMachine) -> Waiting:
    """Wait until everything planned is done."""
    while len(machine.planner) or machine.state in (State.RUN, State.JOG):
        machine.start_cycle()
        yield


def _plan(machine: GrblMachine, move: Move, *, jog: bool) -> Waiting:
    inside = all(-t - 1e-6 <= v <= 1e-6 for v, t in zip(move.target, machine.eeprom.axes(130), strict=True))
    if machine.eeprom.flag(20) and not inside and (machine.homed or machine.dialect.checks_unhomed_jogs):
        if not jog:
            yield from _soft_limit(machine)
            return
        raise LineError(15)
    while len(machine.planner) >= machine.dialect.planner_blocks:
        machine.start_cycle()
        yield
    feed = None if move.feed_mm_min is None else move.feed_mm_min / 60.0
    if machine.planner.add(move.target, feed, machine.limits()):
        if jog and machine.state in (State.IDLE, State.JOG):
            machine.state = State.JOG
            if not machine.planner.holding:
                machine.planner.start(machine.now_s)
        elif machine.planner.running and not machine.planner.holding:
            machine.planner.replan(machine.now_s)


def _soft_limit(machine: GrblMachine) -> Waiting:
    """It brakes first, so that the position stays known, and then raises alarm 2."""
    machine.planner.hold(machine.now_s)
    while machine.planner.running:
        yield
    machine.raise_alarm(2)
    while machine.dialect.mute_when_critical:  # only a reset ends this
        yield
