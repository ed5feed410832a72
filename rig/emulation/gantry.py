"""An emulated GRBL controller whose travel, homing and speeds fit what a bench file says of its gantry."""

from __future__ import annotations

import math

from drivers.grbl_settings import GrblSettings
from rig.errors import InputError
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH, Triple
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.grbl_emulator.mechanics import Mechanics
from sim_backends.grbl_emulator.monitor import Monitor

_SPARE_MM = 1.0
"""How far soft limits and switches lie beyond what the bench uses."""
_LOCATE_SHARE = 0.1
"""Homing looks for the switches at the slowest axis's speed, and finds where they are at this share of it."""


def emulated_gantry(settings: GrblSettings, *, dialect: Dialect = GRBL_1_1, start_delay_s: float = 0.0) -> GrblMachine:
    """A controller and machine for these settings, just switched on, with a monitor that judges every byte.

    A machine that homes stands in the middle of its travel at first; one that cannot (``homing: none``) at its zero.

    Args:
        settings: from the bench file.
        dialect: the firmware.
        start_delay_s: see `GrblMachine`.

    Raises:
        InputError: GRBL cannot have such machine coordinates.
    """
    lower, upper = (_triple(settings, end) for end in ("lower_mm", "upper_mm"))
    homes = settings.homing != "none"
    _refuse_coordinates(lower, upper, homes=homes)
    monitor = Monitor(lower, upper, needs_homing=homes, unhomed_jog_mm=settings.unhomed_jog_mm)
    # A machine that does not home has no switches to speak of: they lie behind its travel at both ends.
    ends = tuple((low - 2 * _SPARE_MM, high + 2 * _SPARE_MM) for low, high in zip(lower, upper, strict=True))
    return GrblMachine(
        dialect,
        settings=_eeprom(settings, lower, upper, homes=homes),
        mechanics=None if homes else Mechanics(ends, start_mm=(0.0, 0.0, 0.0)),
        monitor=monitor,
        start_delay_s=start_delay_s,
    )


def _eeprom(settings: GrblSettings, lower: Triple, upper: Triple, *, homes: bool) -> dict[int, float]:
    feeds = [axis.feed_mm_per_min for axis in settings.axes]
    values = {**BENCH, **{110 + k: feed for k, feed in enumerate(feeds)}}
    if homes:
        values |= {130 + k: math.ceil(-low) + _SPARE_MM for k, low in enumerate(lower)}
        # It homes upwards and pulls off to where every axis is within its limits.
        values |= {
            24: _LOCATE_SHARE * min(feeds),
            25: min(feeds),
            27: max(_SPARE_MM, *(-u for u in upper)),
        }
    else:
        values |= {20: 0, 22: 0}
    return values


def _refuse_coordinates(lower: Triple, upper: Triple, *, homes: bool) -> None:
    for name, low, high in zip("xyz", lower, upper, strict=True):
        where, given = f"devices.gantry.{name}", f"{low:g} .. {high:g}"
        if homes and high > 0.0:
            raise InputError(
                f"the emulated controller counts from its switches downwards, so not {given}",
                where=where,
                remedy="Give lower_mm and upper_mm of 0 or less, as GRBL has them after homing",
            )
        if not homes and not low <= 0.0 <= high:
            raise InputError(
                f"a machine that cannot home starts at 0, which is outside {given}",
                where=where,
                remedy="Let the travel include 0, or let the machine home",
            )


def _triple(settings: GrblSettings, end: str) -> Triple:
    x, y, z = (float(getattr(axis, end)) for axis in settings.axes)
    return x, y, z
