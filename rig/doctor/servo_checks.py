"""Compares what a servo keeps and says of itself with what the bench file wants of it. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.dynamixel.checks import complain_of_limits, complain_of_mode, complain_of_traps, complaint_of
from drivers.dynamixel.reading import ServoReading
from drivers.dynamixel.settings import DynamixelSettings, position_at
from drivers.dynamixel.table import MODELS, STATE_LENGTH, TICKS_PER_TURN, VELOCITY_DEG_PER_S, model_named
from rig.doctor.finding import Finding, failed, in_two, passed, warned

_WIZARD = "with DYNAMIXEL Wizard"
_RUN_ON_V = {"XL330": (4.5, 6.0), "XL430": (9.0, 12.6), "XM430": (10.0, 14.8)}
"""What the e-manual recommends, by the model's first letters."""
_NEAR_HOT_C = 10.0
_BITS_PER_BYTE = 10
_ANSWERS_BESIDES = 40
"""Bytes of a question, and of the answer's own frame."""
_SHARE_OF_WATCHDOG = 0.5
_OVERLOAD = 0x20


@dataclass(frozen=True, slots=True)
class Seen:
    """A servo that was read.

    Attributes:
        subject: for the lines.
        settings: the bench file's.
        reading: what the servo tells.
        on_bus: how many servos of the bench share its bus.
        latency_ms: the timer of the bus's adapter; ``None``: it has none.
    """

    subject: str
    settings: DynamixelSettings
    reading: ServoReading
    on_bus: int
    latency_ms: int | None


Check = Callable[[Seen], Finding]


def check_servo(seen: Seen) -> list[Finding]:
    """All checks, in the order of `CHECKS`."""
    return [check(seen) for check in CHECKS.values()]


def _judged(seen: Seen, what: str, complaint: str, well: str) -> Finding:
    """A line from one of the driver's own complaints, which tell first what is wrong, then the remedy."""
    if not complaint:
        return passed(seen.subject, what, well)
    told, remedy = in_two(complaint)
    return failed(seen.subject, what, told, remedy)


def _model(seen: Seen) -> Finding:
    wanted, found = seen.settings.model, seen.reading.model_number
    if found != MODELS[wanted].number:
        return failed(
            seen.subject,
            "model",
            f"id {seen.settings.id} is a {model_named(found)}, and the bench file says {wanted}",
            f"Check id and port; if it is the one that is meant, set devices.{seen.subject}.model",
        )
    return passed(seen.subject, "model", f"{wanted}, id {seen.settings.id}, firmware {seen.reading.setup.firmware}")


def _mode(seen: Seen) -> Finding:
    complaint = complain_of_mode(seen.settings, seen.reading.setup)
    return _judged(seen, "operating mode", complaint, seen.settings.mode)


def _setup(seen: Seen) -> Finding:
    level = seen.reading.protection.return_level
    complaint = complain_of_traps(seen.reading.setup)
    if level != 2:
        complaint = f"its status return level is {level}, so that it does not answer to writes. Set it to 2 {_WIZARD}"
    return _judged(seen, "kept settings", complaint, "no homing offset, drive mode or start-up that gets in the way")


def _limits(seen: Seen) -> Finding:
    settings, protection = seen.settings, seen.reading.protection
    complaint = complain_of_limits(settings, seen.reading.setup)
    if not complaint and settings.profile_velocity > protection.velocity:
        most = protection.velocity * VELOCITY_DEG_PER_S / settings.role.gear_ratio
        complaint = (
            f"speed_deg_per_s is {settings.speed_deg_per_s:g}, and its own velocity limit allows {most:.0f}, so that "
            f"moves time out. Set devices.{seen.subject}.speed_deg_per_s to {most:.0f} or less, or raise its limit "
            f"{_WIZARD}"
        )
    return _judged(seen, "limits", complaint, "its own limits leave room for the bench file's travel and speed")


def _health(seen: Seen) -> Finding:
    complaint = complaint_of(seen.reading.state, seen.subject, rebooted=False, referenced=True)
    return _judged(seen, "hardware error", complaint, "none")


def _voltage(seen: Seen) -> Finding:
    volts, (low, high) = seen.reading.state.voltage_v, seen.reading.protection.voltage_v
    if not low <= volts <= high:
        return failed(
            seen.subject,
            "voltage",
            f"{volts:.1f} V is outside its limits, {low:g} .. {high:g} V",
            "Check the power supply and its cable",
        )
    well = next((v for name, v in _RUN_ON_V.items() if seen.settings.model.startswith(name)), (low, high))
    if not well[0] <= volts <= well[1]:
        return warned(
            seen.subject,
            "voltage",
            f"{volts:.1f} V, and {seen.settings.model} should run on {well[0]:g} .. {well[1]:g} V",
            "Check the power supply: it sags further under load",
        )
    return passed(seen.subject, "voltage", f"{volts:.1f} V")


def _temperature(seen: Seen) -> Finding:
    now, most = seen.reading.state.temperature_c, seen.reading.protection.temperature_c
    if now >= most - _NEAR_HOT_C:
        return (failed if now >= most else warned)(
            seen.subject,
            "temperature",
            f"{now:.0f} °C; at {most:.0f} °C it switches itself off",
            "Let it cool, and find out what it holds or rubs against",
        )
    return passed(seen.subject, "temperature", f"{now:.0f} °C of {most:.0f} °C")


def _protection(seen: Seen) -> Finding:
    shutdown = seen.reading.protection.shutdown
    if not shutdown & _OVERLOAD:
        return warned(
            seen.subject,
            "overload",
            f"its shutdown register is {shutdown}: it goes on pushing when it is overloaded",
            f"Set the shutdown register (address 63) to 52 {_WIZARD}",
        )
    return passed(seen.subject, "overload", "switches its torque off")


def _torque(seen: Seen) -> Finding:
    on, policy = seen.reading.state.torque, seen.settings.torque_at_close
    if on and policy == "release":
        return warned(
            seen.subject,
            "torque",
            "on, though nobody uses the bench (torque_at_close: release): a session has ended badly",
            "Hold what it carries, then run `rig status`, which lets go of it at its end",
        )
    return passed(seen.subject, "torque", "on, as torque_at_close says" if on else "off")


def _position(seen: Seen) -> Finding:
    role, state = seen.settings.role, seen.reading.state
    turns = 0 if seen.settings.mode == "position" else state.turns
    if turns is None:
        told = "not referenced since its power was off: say where it stands (`rig home --theta-deg`, `--zoom`)"
        return passed(seen.subject, "position", told)
    position = position_at(role, state.position + turns * TICKS_PER_TURN)
    if not role.lower <= position <= role.upper:
        return warned(
            seen.subject,
            "position",
            f"stands at {position:.3f}, outside its travel {role.lower:g} .. {role.upper:g}",
            "Turn it back by hand while its torque is off, or check zero_ticks, gear_ratio and sign",
        )
    return passed(seen.subject, "position", f"{position:.3f}, within {role.lower:g} .. {role.upper:g}")


def _answers(seen: Seen) -> Finding:
    """While it moves the host must be heard twice as often as the watchdog asks for, one retry included."""
    settings, delay_s = seen.settings, seen.reading.protection.return_delay_s
    wire_s = (STATE_LENGTH + _ANSWERS_BESIDES) * _BITS_PER_BYTE / settings.baud
    answer_s = wire_s + delay_s + (seen.latency_ms or 0) / 1000.0
    cycle_ms = 1000.0 * (settings.poll_s + seen.on_bus * answer_s)
    told = f"{1000.0 * answer_s:.1f} ms (return delay {1e6 * delay_s:.0f} µs"
    told += ")" if seen.latency_ms is None else f", latency timer {seen.latency_ms} ms)"
    if settings.watchdog_ms and cycle_ms > _SHARE_OF_WATCHDOG * settings.watchdog_ms:
        return warned(
            seen.subject,
            "answer time",
            f"{told}: asked every {cycle_ms:.0f} ms, one lost answer lets its watchdog of {settings.watchdog_ms} ms "
            "stop it",
            "Raise the servos' baud rate, lower latency_timer_ms and the return delay, or raise watchdog_ms",
        )
    return passed(seen.subject, "answer time", told)


CHECKS: Mapping[str, Check] = {
    "model": _model,
    "operating mode": _mode,
    "kept settings": _setup,
    "limits": _limits,
    "hardware error": _health,
    "voltage": _voltage,
    "temperature": _temperature,
    "overload": _protection,
    "torque": _torque,
    "position": _position,
    "answer time": _answers,
}
"""By the name of the line that each gives."""
