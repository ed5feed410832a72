"""Compares what a GRBL-family controller keeps in its settings with what the bench file wants of the gantry.

Pure: settings in, findings out. Sources: the settings pages of GRBL 1.1 and grblHAL; FluidNC tells the same numbers
where it has them, but keeps them in its config.yaml.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rig.doctor.controller import ACCELERATION, RATE, STEPS, TRAVEL, Controller, homes_down, ranges, sentence
from rig.doctor.finding import Finding, failed, passed, warned

AXES = "xyz"
_SWITCH_MM = 0.5
"""Nearer to a limit switch than this it may be pressed by backlash and vibration."""
_UNO_STEPS_PER_S = 30_000
"""What GRBL 1.1 can do on its 16 MHz processor."""
_HOMING_REACH = 1.5
"""GRBL gives homing up after one and a half travels."""

Check = Callable[[Controller], Finding]


def check_firmware(controller: Controller) -> list[Finding]:
    """All checks, in the order of `CHECKS`."""
    return [check(controller) for check in CHECKS.values()]


def _untold(c: Controller, what: str, numbers: str) -> Finding:
    return warned(
        "gantry",
        what,
        f"{c.kind} does not tell {numbers}",
        "Look it up in the controller's own configuration and compare it with the bench file by hand",
    )


def _homing(c: Controller) -> Finding:
    enabled, wanted = c.flag(22), c.settings.homing
    if enabled is None:
        return _untold(c, "homing", "$22")
    if not enabled and wanted == "none":
        return passed("gantry", "homing", "off ($22), and the bench file does without (homing: none)")
    if not enabled:
        return failed(
            "gantry",
            "homing",
            f"off ($22={c.firmware[22]:g}), and the bench file wants it (homing: {wanted})",
            sentence(f"once the switches are wired and tested, {c.turned_on(22)}"),
        )
    travel, seek = c.axis(TRAVEL), c.firmware.get(25)
    longest_s = _HOMING_REACH * sum(travel) / seek * 60.0 if travel and seek else 0.0
    if longest_s > c.settings.deadlines.home_s:
        return failed(
            "gantry",
            "homing",
            f"may take {longest_s:.0f} s at $25={seek:g} mm/min, and is given up after "
            f"{c.settings.deadlines.home_s:g} s",
            sentence(f"set deadlines.home_s to {longest_s * 1.2:.0f} in the bench file", c.set_to(25, "a faster seek")),
        )
    return passed("gantry", "homing", f"on ($22); at most {longest_s:.0f} s")


def _soft_limits(c: Controller) -> Finding:
    on = c.flag(20)
    if on is None:
        return _untold(c, "soft limits", "$20")
    if not on:
        return warned(
            "gantry",
            "soft limits",
            "off ($20=0): the bench file's limits hold, but nothing stops another program's moves",
            sentence(c.turned_on(20)),
        )
    return passed("gantry", "soft limits", "on ($20)")


def _hard_limits(c: Controller) -> Finding:
    on = c.flag(21)
    if on is None:
        return _untold(c, "hard limits", "$21")
    if not on:
        return warned(
            "gantry",
            "hard limits",
            "off ($21=0): a carriage that has lost steps runs into its end",
            sentence(f"if it has switches, {c.turned_on(21)}"),
        )
    return passed("gantry", "hard limits", "on ($21)")


def _travel(c: Controller) -> Finding:
    travel = c.axis(TRAVEL)
    if travel is None:
        return _untold(c, "travel", "$130 to $132")
    for number, (name, axis, length_mm) in enumerate(zip(AXES, c.settings.axes, travel, strict=True)):
        allowed = ranges(c.kind, c.firmware, number, length_mm)
        if not any(low <= axis.lower_mm and axis.upper_mm <= high for low, high in allowed):
            where = " or ".join(f"{low:g} .. {high:g}" for low, high in allowed)
            needed = max(abs(axis.lower_mm), abs(axis.upper_mm))
            longer = needed > length_mm and all(low <= axis.lower_mm or axis.upper_mm <= high for low, high in allowed)
            return failed(
                "gantry",
                "travel",
                f"{name}: the bench file goes from {axis.lower_mm:g} to {axis.upper_mm:g} mm, and the firmware's "
                f"travel is {where} mm (${TRAVEL + number}={length_mm:g})",
                sentence(
                    f"keep devices.gantry.{name} within {where}, in machine coordinates",
                    f"if the axis really is that long, {c.set_to(TRAVEL + number, f'{needed:g}')}" if longer else "",
                ),
            )
    return passed("gantry", "travel", "the bench file stays within " + " x ".join(f"{mm:g}" for mm in travel) + " mm")


def _pull_off(c: Controller) -> Finding:
    travel, pull_off = c.axis(TRAVEL), c.firmware.get(27)
    if pull_off is None:
        return _untold(c, "limit switches", "$27")
    if not (c.flag(22) and c.flag(21)):
        return passed("gantry", "limit switches", "only used for homing" if c.flag(22) else "not used")
    if pull_off < _SWITCH_MM:
        return failed(
            "gantry",
            "limit switches",
            f"homing ends {pull_off:g} mm off the switches ($27), so that backlash or a jolt raises an alarm",
            sentence(c.set_to(27, "2")),
        )
    for number, (name, axis) in enumerate(zip(AXES, c.settings.axes, strict=True)):
        for low, high in ranges(c.kind, c.firmware, number, travel[number]) if travel else []:
            near_mm = axis.lower_mm - low if homes_down(c.firmware, number) else high - axis.upper_mm
            if 0.0 <= near_mm < _SWITCH_MM:
                end = "lower_mm" if homes_down(c.firmware, number) else "upper_mm"
                return warned(
                    "gantry",
                    "limit switches",
                    f"{name} may go to {near_mm:g} mm from its switch, which raises an alarm when it is pressed",
                    f"Keep devices.gantry.{name}.{end} a millimetre away from it",
                )
    return passed("gantry", "limit switches", f"homing ends {pull_off:g} mm off them ($27)")


def _speed(c: Controller) -> Finding:
    rates = c.axis(RATE)
    if rates is None:
        return _untold(c, "speed", "$110 to $112")
    for number, (name, axis, most) in enumerate(zip(AXES, c.settings.axes, rates, strict=True)):
        if axis.feed_mm_per_min > most:
            return warned(
                "gantry",
                "speed",
                f"{name}: the bench file asks for {axis.feed_mm_per_min:g} mm/min, and the firmware allows {most:g} "
                f"(${RATE + number})",
                sentence(
                    f"set devices.gantry.{name}.feed_mm_per_min to {most:g}",
                    f"if the motors can do it, {c.set_to(RATE + number, f'{axis.feed_mm_per_min:g}')}",
                ),
            )
        planned = c.speeds_mm_per_s[number]
        if planned * 60.0 > 1.05 * axis.feed_mm_per_min:
            return warned(
                "gantry",
                "speed",
                f"axes.{name}_mm.speed_mm_per_s is {planned:g}, and the gantry is sent at {axis.feed_mm_per_min:g} "
                f"mm/min ({axis.feed_mm_per_min / 60.0:.1f} mm/s): times are estimated too short",
                f"Set axes.{name}_mm.speed_mm_per_s to {axis.feed_mm_per_min / 60.0:.1f}",
            )
    feeds = " x ".join(f"{axis.feed_mm_per_min:g}" for axis in c.settings.axes)
    return passed("gantry", "speed", f"{feeds} mm/min, which the firmware allows")


def _acceleration(c: Controller) -> Finding:
    accelerations, rates = c.axis(ACCELERATION), c.axis(RATE)
    if accelerations is None or rates is None:
        return _untold(c, "acceleration", "$120 to $122")
    hold_s, slowest_s = c.settings.deadlines.hold_s, 0.0
    for number, (name, axis) in enumerate(zip(AXES, c.settings.axes, strict=True)):
        speed, acceleration = min(axis.feed_mm_per_min, rates[number]) / 60.0, accelerations[number]
        stops_s = speed / acceleration if acceleration > 0.0 else float("inf")
        if stops_s > hold_s:
            return failed(
                "gantry",
                "acceleration",
                f"{name} takes {stops_s:.1f} s to stop from {speed:.0f} mm/s at ${ACCELERATION + number}="
                f"{acceleration:g} mm/s², and a STOP resets after {hold_s:g} s, which loses the position",
                sentence(
                    c.set_to(ACCELERATION + number, f"{max(speed / hold_s * 4.0, 1.0):.0f}"),
                    f"lower devices.gantry.{name}.feed_mm_per_min",
                ),
            )
        slowest_s = max(slowest_s, stops_s)
    return passed("gantry", "acceleration", f"stops within {slowest_s:.2f} s of a STOP")


def _resolution(c: Controller) -> Finding:
    steps = c.axis(STEPS)
    if steps is None:
        return _untold(c, "steps", "$100 to $102")
    for number, (name, axis, per_mm) in enumerate(zip(AXES, c.settings.axes, steps, strict=True)):
        if per_mm * c.settings.tolerance_mm < 1.0:
            return failed(
                "gantry",
                "steps",
                f"{name}: ${STEPS + number}={per_mm:g} steps/mm cannot keep a tolerance of "
                f"{c.settings.tolerance_mm:g} mm",
                sentence(
                    f"measure a long move and {c.set_to(STEPS + number, 'the true steps per mm')}",
                    "raise tolerance_mm in the bench file",
                ),
            )
        rate = per_mm * axis.feed_mm_per_min / 60.0
        if c.kind == "GRBL" and rate > _UNO_STEPS_PER_S:
            return warned(
                "gantry",
                "steps",
                f"{name}: {axis.feed_mm_per_min:g} mm/min at {per_mm:g} steps/mm are {rate:.0f} steps/s, more than "
                f"GRBL manages ({_UNO_STEPS_PER_S})",
                f"Lower devices.gantry.{name}.feed_mm_per_min, or use coarser microsteps",
            )
    return passed("gantry", "steps", " x ".join(f"{per_mm:g}" for per_mm in steps) + " per mm")


def _reports(c: Controller) -> Finding:
    machine, inches = c.flag(10), c.flag(13)
    if inches:
        return warned(
            "gantry",
            "status reports",
            "in inches ($13=1): converted, but other programs may take them for mm",
            sentence(c.set_to(13, "0")),
        )
    if machine is None:
        return _untold(c, "status reports", "$10")
    if not machine:
        return warned(
            "gantry",
            "status reports",
            f"tell work coordinates ($10={c.firmware[10]:g}): converted, but only some reports tell the offset",
            sentence(c.turned_on(10)),
        )
    return passed("gantry", "status reports", "machine coordinates ($10), in mm ($13)")


def _idle(c: Controller) -> Finding:
    keep = c.firmware.get(1)
    if keep is None:
        return _untold(c, "holding at rest", "$1")
    if keep != 255:
        return warned(
            "gantry",
            "holding at rest",
            f"the motors let go {keep:g} ms after a move ($1): a loaded axis sinks, and steps are lost unseen",
            sentence(c.set_to(1, "255")),
        )
    return passed("gantry", "holding at rest", "the motors hold ($1=255)")


CHECKS: Mapping[str, Check] = {
    "homing": _homing,
    "soft limits": _soft_limits,
    "hard limits": _hard_limits,
    "travel": _travel,
    "limit switches": _pull_off,
    "speed": _speed,
    "acceleration": _acceleration,
    "steps": _resolution,
    "status reports": _reports,
    "holding at rest": _idle,
}
"""By the name of the line that each gives."""
