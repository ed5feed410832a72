"""A GRBL-family controller's settings beside what the bench file wants of it, and how a person changes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.grbl_settings import GrblSettings
from rig.devices import Triple

STEPS, RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130
"""Numbers of X's settings; Y and Z follow."""
_IN_CONFIG_YAML = {
    1: "stepping: idle_ms",
    10: "$Report/Status",
    13: "report_inches",
    20: "soft_limits of each axis",
    21: "hard_limits of each motor",
    22: "homing: cycle of each axis",
    25: "homing: seek_mm_per_min of each axis",
    27: "pulloff_mm of each motor",
    STEPS: "steps_per_mm",
    RATE: "max_rate_mm_per_min",
    ACCELERATION: "acceleration_mm_per_sec2",
    TRAVEL: "max_travel_mm",
}
_ZERO_AT_HOME = 8
"""Bit of grblHAL's $22: the machine's zero is where it is homed."""


@dataclass(frozen=True, slots=True)
class Controller:
    """A controller and what is wanted of it.

    Attributes:
        kind: ``GRBL``, ``grblHAL`` or ``FluidNC``.
        firmware: its ``$`` settings by number.
        settings: the bench file's.
        speeds_mm_per_s: the rig frame's, by which the bench file plans and estimates.
    """

    kind: str
    firmware: Mapping[int, float]
    settings: GrblSettings
    speeds_mm_per_s: Triple

    def axis(self, first: int) -> Triple | None:
        """The settings of X, Y and Z that begin at a number; ``None``: not all are told."""
        found = [self.firmware.get(first + axis) for axis in range(3)]
        return (found[0], found[1], found[2]) if None not in found else None  # type: ignore[return-value]  # narrowed

    def flag(self, number: int, bit: int = 1) -> bool | None:
        """A bit of a setting; ``None``: the setting is not told."""
        value = self.firmware.get(number)
        return None if value is None else bool(int(value) & bit)

    def set_to(self, number: int, value: str) -> str:
        """How a person sets it."""
        if self.kind == "FluidNC":
            key = _IN_CONFIG_YAML[number if number < STEPS else number // 10 * 10]
            return f"set {key} in the controller's config.yaml"
        return f"send `${number}={value}` to it with a terminal"

    def turned_on(self, number: int) -> str:
        """How a person turns a flag on, keeping the other bits that grblHAL has there."""
        return self.set_to(number, f"{int(self.firmware.get(number, 0)) | 1}")


def homes_down(firmware: Mapping[int, float], axis: int) -> bool:
    """The switch of an axis is at its lower end."""
    return bool(int(firmware.get(23, 0)) & 1 << axis)


def ranges(kind: str, firmware: Mapping[int, float], axis: int, travel_mm: float) -> list[tuple[float, float]]:
    """Where the machine coordinates of an axis may lie once it is homed; several where the settings do not tell."""
    below, above = (-travel_mm, 0.0), (0.0, travel_mm)
    if kind == "FluidNC":
        return [below, above]
    zero_at_home = kind == "grblHAL" and int(firmware.get(22, 0)) & _ZERO_AT_HOME and homes_down(firmware, axis)
    return [above if zero_at_home else below]


def sentence(*ways: str) -> str:
    """Ways to put something right, as one sentence; empty ones are left out."""
    text = ", or ".join(filter(None, ways))
    return text[:1].upper() + text[1:]
