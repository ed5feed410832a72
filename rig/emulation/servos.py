"""Emulated Dynamixel servos on emulated buses, as a bench file names them: by id, model, mode and port."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.dynamixel import DynamixelSettings
from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.bus import EmulatedBus
from sim_backends.dynamixel_emulator.monitor import Monitor
from sim_backends.dynamixel_emulator.servo import Servo

_MODES = {"position": table.POSITION, "extended": table.EXTENDED, "current_based": table.CURRENT_BASED}


def emulated_servo(settings: DynamixelSettings) -> Servo:
    """A servo as the settings want it, just switched on; its axis stands at 0, or at the end next to it."""
    role = settings.role
    start = role.to_angle_deg(min(max(0.0, role.lower), role.upper))
    servo = Servo(
        table.MODELS[settings.model], settings.id, baud=settings.baud, shaft_ticks=float(round(role.ticks_at(start)))
    )
    servo.memory[table.OPERATING_MODE] = _MODES[settings.mode]
    return servo


def emulated_buses(
    settings: Mapping[str, DynamixelSettings],
) -> tuple[dict[str, Servo], dict[str, EmulatedBus]]:
    """The servos by role, and the buses by port, each with a monitor that judges every packet.

    Args:
        settings: of each axis, by role.
    """
    servos = {role: emulated_servo(one) for role, one in settings.items()}
    buses = {}
    for port in dict.fromkeys(one.port for one in settings.values()):
        here = {role: one for role, one in settings.items() if one.port == port}
        monitor = Monitor({one.id: _travel(one) for one in here.values()})
        buses[port] = EmulatedBus([servos[role] for role in here], monitor)
    return servos, buses


def position_of(servo: Servo, settings: DynamixelSettings) -> float:
    """Where the axis behind a servo really is, degrees or zoom 0..1."""
    return settings.role.to_position(settings.role.angle_deg_at(servo.shaft_ticks))


def _travel(settings: DynamixelSettings) -> tuple[float, float]:
    """The shaft's lowest and highest tick; goals are whole ticks."""
    role = settings.role
    ends = [role.ticks_at(role.to_angle_deg(position)) for position in (role.lower, role.upper)]
    return min(ends) - 1.0, max(ends) + 1.0
