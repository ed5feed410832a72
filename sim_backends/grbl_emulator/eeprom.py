"""What the emulated controller keeps over power cycles: its ``$`` settings and its coordinate offsets."""

from __future__ import annotations

from collections.abc import Mapping

from sim_backends.grbl_emulator.gcode import LineError, read_number

Triple = tuple[float, float, float]

AXES = "XYZ"
WRITE_S = 0.02
"""How long a write takes; the controller loses every byte that arrives meanwhile."""

_WHOLE = {0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 30, 31, 32}

DEFAULTS: Mapping[int, float] = {
    0: 10, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.01, 12: 0.002, 13: 0,
    20: 0, 21: 0, 22: 0, 23: 0, 24: 25, 25: 500, 26: 250, 27: 1, 30: 1000, 31: 0, 32: 0,
    100: 250, 101: 250, 102: 250, 110: 500, 111: 500, 112: 500,
    120: 10, 121: 10, 122: 10, 130: 200, 131: 200, 132: 200,
}  # fmt: skip
"""GRBL's own defaults: soft limits, hard limits and homing are off."""

BENCH: Mapping[int, float] = {
    **DEFAULTS, 20: 1, 21: 1, 22: 1, 23: 0, 24: 100, 25: 2000, 27: 2,
    110: 6000, 111: 6000, 112: 3000, 120: 500, 121: 500, 122: 300, 130: 400, 131: 300, 132: 200,
}  # fmt: skip
"""A bench that is set up well: 400 x 300 x 200 mm, homing, soft and hard limits on."""


class Eeprom:
    """The settings, and the offsets of G54 to G59. `write` says with an error code what it refuses."""

    def __init__(self, settings: Mapping[int, float] = BENCH) -> None:
        self._values = dict(settings)
        self.offsets: list[Triple] = [(0.0, 0.0, 0.0)] * 6

    def __getitem__(self, number: int) -> float:
        return self._values[number]

    def flag(self, number: int) -> bool:
        """Whether a switch is on."""
        return self._values[number] != 0

    def axes(self, first: int) -> Triple:
        """Three settings that follow each other, for X, Y, Z."""
        return (self._values[first], self._values[first + 1], self._values[first + 2])

    def report(self) -> list[str]:
        """The lines of ``$$``."""
        return [
            f"${number}={int(value)}" if number in _WHOLE else f"${number}={value:.3f}"
            for number, value in sorted(self._values.items())
        ]

    def write(self, assignment: str) -> None:
        """Obey ``n=value``.

        Raises:
            LineError: what GRBL answers to an unknown setting, a bad number, or soft limits without homing.
        """
        name, equals, text = assignment.partition("=")
        if not equals or not name.isdigit():
            raise LineError(3)
        value, rest = read_number(text)
        if rest:
            raise LineError(3)
        if value < 0:
            raise LineError(4)
        if int(name) not in self._values:
            raise LineError(3)
        if int(name) == 20 and value and not self.flag(22):
            raise LineError(10)
        self._values[int(name)] = value
        if int(name) == 22 and not value:
            self._values[20] = 0  # GRBL turns soft limits off with homing
