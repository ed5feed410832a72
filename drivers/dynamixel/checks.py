"""What must be true of a servo before it is used, and what to tell people about the state of one."""

from __future__ import annotations

from drivers.dynamixel.settings import DynamixelSettings
from drivers.dynamixel.table import MODELS, MODES, SHUT_DOWN_BY, ServoState, Setup, model_named
from rig.errors import HardwareError

_DRIVE_MODE_BITS = {0x01: "reverse (use `sign` instead)", 0x04: "time-based profile", 0x08: "torque on by goal update"}
_WIZARD = "Set it with DYNAMIXEL Wizard"


def check_model(name: str, settings: DynamixelSettings, number: int) -> None:
    """The model that was meant answers.

    Raises:
        HardwareError: another one does.
    """
    if number != MODELS[settings.model].number:
        raise HardwareError(
            f"{name} is a {model_named(number)}, and the bench file says {settings.model}. Check id, port and model"
        )


def check_setup(name: str, settings: DynamixelSettings, setup: Setup) -> None:
    """What is kept in the servo fits the bench file, and holds no trap.

    Raises:
        HardwareError: it does not; tells what is to be set to what.
    """
    complaint = complain_of_mode(settings, setup) or complain_of_traps(setup) or complain_of_limits(settings, setup)
    if complaint:
        raise HardwareError(f"{name}: {complaint}")


def complain_of_mode(settings: DynamixelSettings, setup: Setup) -> str:
    """Why its id or operating mode is not the bench file's, and what to do about it; empty where it is."""
    if setup.servo_id != settings.id:
        return f"it says that its id is {setup.servo_id}. Give each servo on the bus its own id"
    if setup.operating_mode != MODES[settings.mode]:
        return (
            f"its operating mode is {setup.operating_mode}, and {settings.mode} is {MODES[settings.mode]}. {_WIZARD}, "
            "or change mode in the bench file"
        )
    return ""


def complain_of_traps(setup: Setup) -> str:
    """What is set in it that the driver cannot work with, and what to do about it; empty where nothing is."""
    for bit, meaning in _DRIVE_MODE_BITS.items():
        if setup.drive_mode & bit:
            return f"its drive mode is {setup.drive_mode}, which has {meaning}. {_WIZARD} to 0"
    if setup.homing_offset:
        return (
            f"its homing offset is {setup.homing_offset}, with which the bus watchdog can run it away. {_WIZARD} to 0 "
            "and use zero_ticks"
        )
    if setup.startup:
        return f"its startup configuration is {setup.startup}, which would hide that it has rebooted. {_WIZARD} to 0"
    return ""


def complain_of_limits(settings: DynamixelSettings, setup: Setup) -> str:
    """Which of its own limits the bench file exceeds, and what to do about it; empty where none."""
    role = settings.role
    ends = sorted(role.ticks_at(role.to_angle_deg(position)) for position in (role.lower, role.upper))
    if settings.mode == "position" and not setup.min_position <= ends[0] <= ends[1] <= setup.max_position:
        return (
            f"it limits its position to {setup.min_position} .. {setup.max_position} ticks, and the travel is "
            f"{ends[0]:.0f} .. {ends[1]:.0f}. Narrow the travel, or widen the servo's limits"
        )
    unit_ma = MODELS[settings.model].current_unit_ma
    if settings.current_limit_ma and unit_ma and settings.current_limit_ma > setup.current_limit * unit_ma:
        return (
            f"current_limit_ma is {settings.current_limit_ma:g}, and the servo's own limit is "
            f"{setup.current_limit * unit_ma:.0f} mA. Lower the one, or raise the other"
        )
    return ""


def complaint_of(state: ServoState, kind: str, *, rebooted: bool, referenced: bool) -> str:
    """What is wrong with the servo of a ``pan`` or a ``zoom``, and what to do about it; empty where nothing is."""
    if state.hardware_error:
        names = [name for bit, name in SHUT_DOWN_BY.items() if state.hardware_error & bit]
        return (
            f"reports {' and '.join(names) or 'a hardware error'} (0x{state.hardware_error:02x}, "
            f"{state.temperature_c:.0f} °C, {state.voltage_v:.1f} V). Remove the cause, then reboot it "
            f"(`rig home --reboot {kind}`)"
        )
    if rebooted:
        return "has rebooted and lost its count of turns. Reference it"
    if not referenced:
        return "does not know its count of turns since its power was off. Reference it"
    if state.watchdog < 0:
        return "was stopped by its bus watchdog: it had heard nothing for too long. Enable it again"
    return ""


def load_of(state: ServoState, setup: Setup) -> float:
    """Share of the largest load or current, -1..1."""
    full = setup.current_limit or 1000
    return max(-1.0, min(1.0, state.load / full))
