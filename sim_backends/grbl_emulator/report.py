"""What the emulated controller tells of itself: status reports, ``$G`` and ``$#``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_backends.grbl_emulator.gcode import MM_PER_INCH, Triple, work_offset

RX_BYTES = 128
"""What the receive buffer holds."""

if TYPE_CHECKING:  # the machine imports this module
    from sim_backends.grbl_emulator.machine import GrblMachine

_OFFSET_EVERY = {True: 30, False: 10}
_OVERRIDES_EVERY = {True: 20, False: 10}


@dataclass
class Counters:
    """How many reports until the next one that carries ``WCO`` or ``Ov``; they never come together."""

    to_offset: int = 0
    to_overrides: int = 1

    def offset_changed(self) -> None:
        """The next report tells the offset."""
        self.to_offset = 0

    def take(self, *, busy: bool) -> str:
        """``WCO``, ``Ov`` or nothing for the report that is being written."""
        if self.to_offset <= 0:
            self.to_offset = _OFFSET_EVERY[busy] - 1
            self.to_overrides = max(self.to_overrides, 1)
            return "WCO"
        self.to_offset -= 1
        if self.to_overrides <= 0:
            self.to_overrides = _OVERRIDES_EVERY[busy] - 1
            return "Ov"
        self.to_overrides -= 1
        return ""


def offset(machine: GrblMachine) -> Triple:
    """Machine minus work coordinates, mm."""
    return work_offset(machine.modal, machine.eeprom.offsets)


def _numbers(machine: GrblMachine, values: Triple) -> str:
    if machine.eeprom.flag(13):
        return ",".join(f"{v / MM_PER_INCH:.4f}" for v in values)
    return ",".join(f"{v:.3f}" for v in values)


def _rounded_to_steps(machine: GrblMachine) -> Triple:
    """The motors stand on whole steps."""
    steps = machine.eeprom.axes(100)
    place = machine.planner.position
    return (
        round(place[0] * steps[0]) / steps[0],
        round(place[1] * steps[1]) / steps[1],
        round(place[2] * steps[2]) / steps[2],
    )


def status(machine: GrblMachine, *, everything: bool = False) -> str:
    """The answer to ``?``. ``$10`` decides between MPos and WPos (bit 0) and on Bf (bit 1), ``$13`` on inches."""
    mask = int(machine.eeprom[10])
    state = machine.state.value
    if state == "Hold":
        state += ":1" if machine.planner.running else ":0"
    if state == "Alarm" and machine.alarm is not None and machine.dialect.name == "grblHAL":
        state += f":{machine.alarm}"
    place, shift = _rounded_to_steps(machine), offset(machine)
    if mask & 1:
        fields = [state, f"MPos:{_numbers(machine, place)}"]
    else:
        work = (place[0] - shift[0], place[1] - shift[1], place[2] - shift[2])
        fields = [state, f"WPos:{_numbers(machine, work)}"]
    if mask & 2:
        fields.append(f"Bf:{machine.dialect.planner_blocks - len(machine.planner)},{RX_BYTES - len(machine.rx)}")
    speed = sum(v * v for v in machine.planner.velocity) ** 0.5 * 60.0
    fields.append(f"FS:{speed / (MM_PER_INCH if machine.eeprom.flag(13) else 1.0):.0f},0")
    pins = "".join(axis for axis, pressed in zip("XYZ", machine.mechanics.tripped(), strict=True) if pressed)
    if pins:
        fields.append(f"Pn:{pins}")
    extra = machine.reports.take(busy=machine.planner.running)
    if extra == "WCO" or everything:
        fields.append(f"WCO:{_numbers(machine, shift)}")
    if extra == "Ov" or everything:
        fields.append("Ov:100,100,100")
    if everything:
        fields.append(f"H:{int(machine.homed)}")
    return "<" + "|".join(fields) + ">"


def modal_line(machine: GrblMachine) -> str:
    """The answer to ``$G``."""
    modal = machine.modal
    words = (
        f"G{modal.motion}",
        f"G{54 + modal.system}",
        "G17",
        "G20" if modal.inches else "G21",
        "G91" if modal.relative else "G90",
        "G93" if modal.inverse_time else "G94",
        "M5 M9 T0",
        f"F{modal.feed_mm_min:.0f} S0",
    )
    return f"[GC:{' '.join(words)}]"


def offset_lines(machine: GrblMachine) -> list[str]:
    """The answer to ``$#``, as far as it concerns a gantry."""
    lines = [f"[G{54 + number}:{_numbers(machine, value)}]" for number, value in enumerate(machine.eeprom.offsets)]
    return [*lines, f"[G92:{_numbers(machine, machine.modal.g92)}]"]
