"""The emulated homing cycle: Z, then X, then Y; each seeks its switch, pulls off, finds it again slowly, pulls off."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from sim_backends.grbl_emulator.gcode import Triple

if TYPE_CHECKING:  # the machine imports this module, by way of its commands
    from sim_backends.grbl_emulator.machine import GrblMachine

Waiting = Generator[None, None, None]
_SEEK_TRAVELS = 1.5
_LOCATE_PULL_OFFS = 5.0


class _FailedError(Exception):
    """Homing failed; ``alarm`` says how."""

    def __init__(self, alarm: int) -> None:
        super().__init__(f"ALARM:{alarm}")
        self.alarm = alarm


def home(machine: GrblMachine) -> Waiting:
    """Home all axes; a failure raises alarm 8 or 9, restarts the controller and never returns."""
    machine.begin_homing()
    try:
        for axis in (2, 0, 1):
            yield from _home_axis(machine, axis)
    except _FailedError as failed:
        machine.fail_homing(failed.alarm)
        while True:  # the restarted controller runs another main loop
            yield
    pull_off, travel = machine.eeprom[27], machine.eeprom.axes(130)
    places = [-travel[i] + pull_off if _direction(machine, i) < 0 else -pull_off for i in range(3)]
    machine.end_homing((places[0], places[1], places[2]))


def _direction(machine: GrblMachine, axis: int) -> float:
    """$23: bit set, the axis homes towards its negative end."""
    return -1.0 if int(machine.eeprom[23]) & (1 << axis) else 1.0


def _home_axis(machine: GrblMachine, axis: int) -> Waiting:
    direction, pull_off = _direction(machine, axis), machine.eeprom[27]
    seek, locate = machine.eeprom[25], machine.eeprom[24]
    yield from _towards_switch(machine, axis, direction * _SEEK_TRAVELS * machine.eeprom.axes(130)[axis], seek)
    yield from _pull_off(machine, axis, -direction * pull_off, seek)
    yield from _towards_switch(machine, axis, direction * _LOCATE_PULL_OFFS * pull_off, locate)
    yield from _pull_off(machine, axis, -direction * pull_off, locate)


def _towards_switch(machine: GrblMachine, axis: int, distance_mm: float, feed_mm_min: float) -> Waiting:
    _begin(machine, axis, distance_mm, feed_mm_min)
    while not machine.mechanics.tripped()[axis]:
        if not machine.planner.running:
            raise _FailedError(9)
        yield
    machine.planner.flush()


def _pull_off(machine: GrblMachine, axis: int, distance_mm: float, feed_mm_min: float) -> Waiting:
    _begin(machine, axis, distance_mm, feed_mm_min)
    while machine.planner.running:
        yield
    if machine.mechanics.tripped()[axis]:
        raise _FailedError(8)


def _begin(machine: GrblMachine, axis: int, distance_mm: float, feed_mm_min: float) -> None:
    place = list(machine.planner.position)
    place[axis] += distance_mm
    target: Triple = (place[0], place[1], place[2])
    machine.planner.add(target, feed_mm_min / 60.0, machine.limits())
    machine.planner.start(machine.now_s)
