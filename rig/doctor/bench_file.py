"""Looks for what a bench file that can be read may still get wrong: limits that disagree, and safety left out. Pure."""

from __future__ import annotations

from itertools import product

from drivers.dynamixel.settings import DynamixelSettings
from drivers.grbl_settings import GrblSettings
from rig.bench import BenchConfig, LiveBenchFile
from rig.doctor.finding import Finding, failed, passed, warned

_SUBJECT = "bench file"
_LONG_JOG_MM = 10.0
_SLACK = 1e-6


def check_bench_file(config: BenchConfig, file: LiveBenchFile) -> list[Finding]:
    """All lines."""
    found = [_linear(config, file)]
    if file.axes.theta_deg is not None:
        found.append(_pan(config, file))
    return [*found, _keep_out(file), _before_homing(file)]


def _linear(config: BenchConfig, file: LiveBenchFile) -> Finding:
    """The rig frame's box, seen in machine coordinates, lies within the gantry's limits."""
    settings, axes = config.devices["gantry"].settings, file.axes
    if not isinstance(settings, GrblSettings):
        return passed(_SUBJECT, "limits", f"x, y, z: the driver {config.devices['gantry'].driver} checks them")
    corners = [axes.placement.to_machine(c) for c in product(axes.x_mm.ends, axes.y_mm.ends, axes.z_mm.ends)]
    for number, (name, axis) in enumerate(zip("xyz", settings.axes, strict=True)):
        low, high = min(c[number] for c in corners), max(c[number] for c in corners)
        if low < axis.lower_mm - _SLACK or high > axis.upper_mm + _SLACK:
            return failed(
                _SUBJECT,
                "limits",
                f"axes.{name}_mm reaches {low:.1f} .. {high:.1f} in machine coordinates, and devices.gantry.{name} "
                f"allows {axis.lower_mm:g} .. {axis.upper_mm:g}",
                f"Narrow axes.{name}_mm, or correct its sign and offset_mm",
            )
    return passed(_SUBJECT, "limits", "x, y, z of the rig frame lie within the gantry's")


def _pan(config: BenchConfig, file: LiveBenchFile) -> Finding:
    settings, axes = config.devices["pan"].settings, file.axes
    if not isinstance(settings, DynamixelSettings) or axes.theta_deg is None:
        return passed(_SUBJECT, "pan limits", f"the driver {config.devices['pan'].driver} checks them")
    low, high = sorted(axes.placement.to_axis(end) for end in axes.theta_deg.ends)
    role = settings.role
    if low < role.lower - _SLACK or high > role.upper + _SLACK:
        return failed(
            _SUBJECT,
            "pan limits",
            f"axes.theta_deg reaches {low:.1f} .. {high:.1f} of the servo's axis, and devices.pan allows "
            f"{role.lower:g} .. {role.upper:g}",
            "Narrow axes.theta_deg, or correct its sign and offset_deg",
        )
    return passed(_SUBJECT, "pan limits", "the pan of the rig frame lies within the servo's")


def _keep_out(file: LiveBenchFile) -> Finding:
    if not file.safety.keep_out:
        return warned(
            _SUBJECT,
            "keep-out",
            "none: nothing but the axes' limits keeps the camera from the object",
            "Measure the box that the object stands in, and give it under safety.keep_out",
        )
    names = ", ".join(box.name for box in file.safety.keep_out)
    return passed(_SUBJECT, "keep-out", f"{names}, with a margin of {file.safety.margin_mm:g} mm")


def _before_homing(file: LiveBenchFile) -> Finding:
    safety = file.safety
    if safety.unhomed_jog_mm > _LONG_JOG_MM:
        return warned(
            _SUBJECT,
            "before homing",
            f"jogs of {safety.unhomed_jog_mm:g} mm are allowed where no limit can hold",
            "Set safety.unhomed_jog_mm to what it takes to leave a limit switch, 5 or less",
        )
    if safety.homing == "as_found":
        return warned(
            _SUBJECT,
            "before homing",
            "homing: as_found believes the coordinates of whatever is found",
            "Set safety.homing to each_session or remembered, if the machine can home",
        )
    return passed(_SUBJECT, "before homing", f"nothing moves far (homing: {safety.homing})")
