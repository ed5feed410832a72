"""Moves one servo or several of a bus together: arm the watchdogs, send the goals, wait until all are at rest there.

Every write is checked by reading back and repeated a bounded number of times; a goal says where to be, not how far to
go, so repeating it moves nothing twice. Any trouble, or a STOP, ends the move with an error; halting is the caller's.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from drivers.dynamixel.answers import NoAnswerError
from drivers.dynamixel.bus import ATTEMPTS, DynamixelBus
from drivers.dynamixel.table import GOAL, WATCHDOG, Register, ServoState
from rig.errors import HardwareError

_PROGRESS_TICKS = 2
"""Less than this is no progress."""


@dataclass(frozen=True)
class Leg:
    """One servo's part of a move.

    Attributes:
        name: for messages.
        goal: ticks as the servo counts them.
        off_by: how far a state is from where it was sent, in degrees of the axis, with sign.
        tolerance_deg: largest ``off_by`` that counts as arrived.
        seconds: what the move should take.
        check: raises where the state forbids to go on (and where a STOP was asked for).
    """

    name: str
    servo_id: int
    goal: int
    off_by: Callable[[ServoState], float]
    tolerance_deg: float
    seconds: float
    watchdog_units: int
    arrive_margin_s: float
    stuck_s: float
    check: Callable[[ServoState | None], None]


def write_checked(
    bus: DynamixelBus,
    register: Register,
    values: Mapping[int, int],
    check: Callable[[Mapping[int, ServoState]], None] = lambda states: None,
) -> dict[int, ServoState]:
    """Write a register of some servos until reading back shows the values; returns the states that show them.

    Args:
        bus: the bus.
        register: what to write.
        values: by servo id.
        check: raises where the write must not be made (any more). Called with the bus held before each attempt, with
            what the servos said of themselves after the one before, and with the states that are returned.

    Raises:
        RefusedError: a servo refuses.
        NoAnswerError, LinkLostError: as `DynamixelBus.state`.
        HardwareError: it does not take the value.
    """
    encoded = {servo_id: register.encode(value) for servo_id, value in values.items()}
    states: dict[int, ServoState] = {}
    for _ in range(ATTEMPTS):
        with bus.undisturbed():
            check(states)
            # Perhaps it was heard and only the acknowledgement was lost: reading back tells.
            with contextlib.suppress(NoAnswerError):
                bus.write(register, encoded)
        states = read_all(bus, list(values))
        wrong = [servo_id for servo_id, value in values.items() if register.shown_in(states[servo_id]) != value]
        if not wrong:
            check(states)
            return states
    raise HardwareError(
        f"{bus.port}: servo {wrong[0]}: {register.name} is {register.shown_in(states[wrong[0]])} after {ATTEMPTS} "
        f"attempts to make it {values[wrong[0]]}. Check the wiring, and that no other program uses the bus"
    )


def read_all(bus: DynamixelBus, servo_ids: Sequence[int]) -> dict[int, ServoState]:
    """The states of all these servos.

    Raises:
        NoAnswerError: one or more are mute; names them.
        LinkLostError: the port has failed.
    """
    states = bus.read_states(servo_ids)
    mute = [servo_id for servo_id in servo_ids if servo_id not in states]
    if mute:
        named = " and ".join(f"servo {servo_id}" for servo_id in mute)
        raise NoAnswerError(f"{bus.port}: no answer from {named}. Check power and cable")
    return states


def move(bus: DynamixelBus, legs: Sequence[Leg], poll_s: float) -> dict[int, ServoState]:
    """Carry out a move; returns the states in which all servos were seen at rest at their goals.

    Raises:
        HardwareError: a servo is stuck, has not arrived in time, fails, or does not answer. Nothing has been halted.
    """

    def check(states: Mapping[int, ServoState]) -> None:
        for leg in legs:
            leg.check(states.get(leg.servo_id))

    armed = {leg.servo_id: leg.watchdog_units for leg in legs if leg.watchdog_units}
    if armed:
        write_checked(bus, WATCHDOG, armed, check)
    states = write_checked(bus, GOAL, {leg.servo_id: leg.goal for leg in legs}, check)
    states = _watch(bus, legs, states, poll_s)
    if armed:
        states |= write_checked(bus, WATCHDOG, dict.fromkeys(armed, 0), check)
    return states


def _watch(
    bus: DynamixelBus, legs: Sequence[Leg], states: dict[int, ServoState], poll_s: float
) -> dict[int, ServoState]:
    clock = bus.clock
    began_s = clock.now_s()
    deadline_s = began_s + max(1.5 * leg.seconds + leg.arrive_margin_s for leg in legs)
    # Where each servo last made progress, and when.
    progress = {leg.servo_id: (states[leg.servo_id].position, began_s) for leg in legs}
    before: dict[int, ServoState] | None = None
    while True:
        for leg in legs:
            leg.check(states[leg.servo_id])
        if before is not None and all(_arrived(leg, before[leg.servo_id], states[leg.servo_id]) for leg in legs):
            return states
        for leg in legs:
            _expect_progress(leg, states[leg.servo_id], progress, clock.now_s())
        if clock.now_s() > deadline_s:
            late = max(legs, key=lambda leg: abs(leg.off_by(states[leg.servo_id])))
            off_deg = late.off_by(states[late.servo_id])
            raise HardwareError(
                f"{late.name} has not arrived within {deadline_s - began_s:.1f} s: it is {off_deg:+.3f}° off, "
                f"tolerance {late.tolerance_deg:g}°. Look what holds it, or raise tolerance_deg or the current limit"
            )
        clock.sleep_s(poll_s)
        before, states = states, read_all(bus, [leg.servo_id for leg in legs])


def _arrived(leg: Leg, before: ServoState, now: ServoState) -> bool:
    """At rest at the goal in two readings: slow creeping does not count as moving for the servo."""
    within = abs(leg.off_by(before)) <= leg.tolerance_deg and abs(leg.off_by(now)) <= leg.tolerance_deg
    same = now.goal == leg.goal and abs(now.position - before.position) < _PROGRESS_TICKS
    return within and same and before.at_rest and now.at_rest


def _expect_progress(leg: Leg, state: ServoState, progress: dict[int, tuple[int, float]], now_s: float) -> None:
    position, since_s = progress[leg.servo_id]
    if abs(state.position - position) >= _PROGRESS_TICKS or abs(leg.off_by(state)) <= leg.tolerance_deg:
        progress[leg.servo_id] = (state.position, now_s)
    elif now_s - since_s > leg.stuck_s:
        raise HardwareError(
            f"{leg.name} is stuck: {leg.off_by(state):+.3f}° from where it was sent, and no progress for "
            f"{leg.stuck_s:g} s. Look what holds it"
        )
