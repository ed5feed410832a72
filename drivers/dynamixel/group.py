"""Several servo axes of one bus read, or moved, together: one packet asks all, one packet sends all off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.dynamixel.axis import DynamixelAxis
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.motion import move
from rig.devices import AxisStatus, Motion
from rig.errors import HardwareError


def statuses(axes: Sequence[DynamixelAxis]) -> dict[DynamixelAxis, AxisStatus]:
    """The status of each axis; one that is mute has no position, and its trouble names it.

    Raises:
        LinkLostError: not connected, or the port has failed.
        HardwareError: the axes are not on one bus.
    """
    bus = _shared_bus(axes)
    states = bus.read_states([axis.servo.setup.servo_id for axis in axes])
    found = {}
    for axis in axes:
        if axis.settings.id in states:
            found[axis] = axis.status_in(states[axis.settings.id])
        else:
            trouble = f"{axis.name} does not answer. Check its power and its cable"
            found[axis] = AxisStatus(Motion.UNKNOWN, None, False, bus.clock.now_s(), trouble=trouble)
    return found


def move_together(wishes: Mapping[DynamixelAxis, float]) -> dict[DynamixelAxis, float]:
    """Move axes at the same time; returns the positions read back once all are at rest.

    Raises:
        UnreachableError: a wish is not finite, or outside the travel. Nothing was sent.
        HardwareError: as `DynamixelAxis.move_to`, for any of them; all have been halted.
    """
    axes = list(wishes)
    bus = _shared_bus(axes)
    legs = [axis.leg(wishes[axis]) for axis in axes]
    try:
        states = move(bus, legs, min(axis.settings.poll_s for axis in axes))
    except HardwareError as error:
        for axis in axes:
            error = axis.halted_after(error)  # each adds what came of halting it
        raise error from None
    return {axis: axis.position_in(states[axis.settings.id]) for axis in axes}


def _shared_bus(axes: Sequence[DynamixelAxis]) -> DynamixelBus:
    buses = {axis.bus for axis in axes}
    if len(buses) != 1:
        raise HardwareError(f"{len(axes)} axes on {len(buses)} buses cannot be handled together. Give them one bus")
    return buses.pop()
