"""A Dynamixel servo as pan axis or zoom ring: a `rig.devices.LiveAxis`.

A servo whose count of turns was lost with its power is not driven before `DynamixelAxis.reference`
(`drivers.dynamixel.servo` tells how that is known). Torque is released or held by `close`, `stop`, and a `connect` or
`enable` that fails, as the settings say for each.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import replace

from drivers.dynamixel.answers import NoAnswerError
from drivers.dynamixel.bus import ATTEMPTS, DynamixelBus
from drivers.dynamixel.checks import load_of
from drivers.dynamixel.halting import halt
from drivers.dynamixel.motion import Leg, move
from drivers.dynamixel.servo import Servo, StoppedError
from drivers.dynamixel.settings import DynamixelSettings, position_at
from drivers.dynamixel.table import MOST_TURNS, TICKS_PER_TURN, ServoState
from drivers.serial_link import LinkLostError
from rig.devices import AxisStatus, Clock, Identity, Motion, StopReport
from rig.errors import HardwareError, InputError, UnreachableError


class DynamixelAxis:
    """A `rig.devices.LiveAxis`. Positions are degrees or zoom settings, as `DynamixelSettings.role` says."""

    Settings = DynamixelSettings

    def __init__(self, settings: DynamixelSettings, clock: Clock, *, bus: DynamixelBus | None = None) -> None:
        """An axis that is not connected.

        Args:
            settings: from the bench file.
            clock: times moves and time-outs.
            bus: shared with the other axes on the same port; one of its own where not given.
        """
        self.settings = settings
        self.bus = bus or DynamixelBus(settings.port, settings.baud, clock, latency_timer_ms=settings.latency_timer_ms)
        self.servo = Servo(settings, self.bus)
        self._clock = clock

    @classmethod
    def together(cls, settings: Sequence[DynamixelSettings], clock: Clock) -> list[DynamixelAxis]:
        """Axes of one bench, in the order of their settings; those on one port share its bus.

        Raises:
            InputError: axes on one port with different baud rates.
        """
        buses: dict[str, DynamixelBus] = {}
        for one in settings:
            bus = buses.setdefault(
                one.port, DynamixelBus(one.port, one.baud, clock, latency_timer_ms=one.latency_timer_ms)
            )
            if bus.baud != one.baud:
                raise InputError(
                    f"two baud rates on one port, {bus.baud} and {one.baud}",
                    where=one.port,
                    remedy="Give the servos of a bus the same baud rate",
                )
        return [cls(one, clock, bus=buses[one.port]) for one in settings]

    @property
    def name(self) -> str:
        """For messages: what the servo does, its id and port."""
        return self.servo.name

    # LiveAxis.

    def connect(self) -> Identity:
        """Open and check model, id and mode. Moves nothing, enables no torque; a latched hardware error is in `status`.

        Raises:
            HardwareError: as `DynamixelBus.open`; no answer; another model, id, mode or setup than is safe.
        """
        setup = self.servo.connect()
        return Identity(self.settings.model, str(setup.firmware), f"{self.settings.port} id {self.settings.id}")

    def status(self) -> AxisStatus:
        """Read it all.

        Raises:
            HardwareError: not connected, the link is lost, or it does not answer.
        """
        return self.status_in(self.servo.read())

    def enable(self) -> AxisStatus:
        """Hold the present place: goal := present, read back, then torque on. Clears a tripped watchdog. Moves nothing.

        Raises:
            HardwareError: a hardware error is latched, it is not referenced, its place changes, or a STOP came.
        """
        servo, stops = self.servo, self.servo.stops
        servo.refuse_trouble(replace(servo.read(), watchdog=0))
        try:
            state = servo.take_hold(stops)
        except StoppedError:
            raise
        except HardwareError as error:
            raise servo.failed_start(error) from error
        servo.enabled = True
        return self.status_in(state)

    def move_to(self, position: float) -> float:
        """Move and return the position read back once at rest there.

        Raises:
            UnreachableError: not finite, or outside the travel. Nothing was sent.
            HardwareError: not enabled, rebooted, stuck, failed, not arrived, no answer, or a STOP came. Motion has
                been halted; where that failed the message says so.
        """
        leg = self.leg(position)
        try:
            states = move(self.bus, [leg], self.settings.poll_s)
        except HardwareError as error:
            raise self.halted_after(error) from error
        return self.position_in(states[leg.servo_id])

    def reference(self, position: float) -> AxisStatus:
        """Say that the axis now stands at ``position``, roughly: the servo knows its place within a turn.

        Only whole turns are lost, so the nearest place that the servo's own count allows is taken. Lets go of torque.

        Raises:
            UnreachableError: not finite, or outside the travel.
            HardwareError: further than a quarter turn of the servo from any place that its count allows.
        """
        self._refuse_unreachable(position)
        state = self.servo.let_go()
        expected = self._ticks(position)
        turns = round((expected - state.position) / TICKS_PER_TURN) if self.settings.mode != "position" else 0
        counted = state.position + turns * TICKS_PER_TURN
        if abs(counted - expected) > TICKS_PER_TURN / 4 or abs(turns) > MOST_TURNS:
            raise HardwareError(
                f"{self.name} cannot stand at {position:g}: the nearest place by its own count is "
                f"{self._position(counted):.3f}. Check zero_ticks and gear_ratio, or say the place more exactly"
            )
        state = self.servo.note(turns)
        self.servo.enabled = False
        return self.status_in(state)

    def reboot(self) -> AxisStatus:
        """Reboot the servo; it is then not referenced.

        Raises:
            HardwareError: it does not come back, or goes on as if nothing had been.
        """
        self.servo.read()
        for _ in range(ATTEMPTS):
            # Perhaps it was heard and only the answer was lost: what it says when it is back tells.
            with contextlib.suppress(NoAnswerError):
                self.bus.reboot(self.settings.id)
            self.servo.forget_turns()
            state = self._wait_until_back()
            if state.turns is None and not state.torque:
                return self.status_in(state)
        raise HardwareError(f"{self.name} does not reboot. Switch its power off and on")

    def stop(self) -> StopReport:
        """Stop now: goal := where it stands or can brake to, or torque off, as `torque_at_stop` says. Never raises."""
        self.servo.stops += 1
        return halt(self.servo)

    def close(self) -> None:
        """Follow the torque policy and release the port. Safe to call twice.

        Raises:
            HardwareError: the torque policy could not be followed; the port is released all the same.
        """
        servo, policy = self.servo, self.settings.torque_at_close
        if not servo.connected:
            return
        servo.stops += 1
        try:
            if policy == "release":
                servo.let_go()
            elif not servo.read().at_rest and not (report := halt(servo)).confirmed:
                raise HardwareError(report.trouble)
        except HardwareError as error:
            raise HardwareError(f"{error}. So torque at close ({policy}) is not as the bench file says") from error
        finally:
            servo.disconnect()

    # For moves of several axes (`drivers.dynamixel.group`).

    def leg(self, position: float) -> Leg:
        """This axis's part of a move, after all that must hold before it has been checked.

        Raises:
            UnreachableError, HardwareError: as `move_to`.
        """
        self._refuse_unreachable(position)
        servo, stops = self.servo, self.servo.stops
        settings, per_deg = self.settings, self.settings.role.ticks_per_deg
        state = servo.read()
        servo.refuse_trouble(state)
        if not servo.enabled:
            raise HardwareError(f"{self.name}: torque has not been enabled since it was connected. Enable it first")
        exact = self._ticks(position) - (servo.turns or 0) * TICKS_PER_TURN

        def off_by(state: ServoState) -> float:
            return (state.position - exact) / per_deg

        def check(state: ServoState | None) -> None:
            servo.refuse_stopped(stops)
            if state is not None:
                servo.see(state)
                servo.refuse_trouble(state)
                if not state.torque:
                    raise HardwareError(f"{self.name} has let go: its torque is off. Enable it again")

        check(state)
        speed = settings.speed_deg_per_s
        return Leg(
            name=self.name,
            servo_id=settings.id,
            goal=round(exact),
            off_by=off_by,
            tolerance_deg=settings.tolerance_deg,
            seconds=abs(off_by(state)) / speed + speed / settings.acceleration_deg_per_s2,
            watchdog_units=settings.watchdog_units,
            arrive_margin_s=settings.arrive_margin_s,
            stuck_s=settings.stuck_s,
            check=check,
        )

    def halted_after(self, error: HardwareError) -> HardwareError:
        """Halt after a failed move, unless a STOP did; returns the error with what came of it."""
        if isinstance(error, StoppedError):
            return error
        if isinstance(error, LinkLostError):
            watchdog_ms = self.settings.watchdog_ms
            outlook = f"Its bus watchdog halts it within {watchdog_ms} ms" if watchdog_ms else "Switch its power off"
            return type(error)(f"{error}. {self.name} could not be halted. {outlook}")
        report = halt(self.servo)
        return error if report.confirmed else type(error)(f"{error}. Halting it was not confirmed: {report.trouble}")

    def status_in(self, state: ServoState) -> AxisStatus:
        """What a state means."""
        servo = self.servo
        servo.see(state)
        moving = Motion.IDLE if state.at_rest else Motion.MOVING
        return AxisStatus(
            motion=Motion.ALARM if state.hardware_error else moving,
            position=None if servo.turns is None else self.position_in(state),
            referenced=servo.turns is not None,
            read_at_s=self._clock.now_s(),
            torque=state.torque,
            temperature_c=state.temperature_c,
            voltage_v=state.voltage_v,
            load=load_of(state, servo.setup),
            trouble=servo.complaint(state),
        )

    def position_in(self, state: ServoState) -> float:
        """Degrees or zoom setting in a state of a referenced servo."""
        return self._position(state.position + (self.servo.turns or 0) * TICKS_PER_TURN)

    # Within.

    def _ticks(self, position: float) -> float:
        return self.settings.role.ticks_at(self.settings.role.to_angle_deg(position))

    def _position(self, ticks: float) -> float:
        return position_at(self.settings.role, ticks)

    def _refuse_unreachable(self, position: float) -> None:
        role = self.settings.role
        if not (math.isfinite(position) and role.lower <= position <= role.upper):
            raise UnreachableError(
                f"{self.name}: {position:g} is outside {role.lower:g} .. {role.upper:g}. Ask for a place within"
            )

    def _wait_until_back(self) -> ServoState:
        deadline_s = self._clock.now_s() + self.settings.reboot_s
        while True:
            try:
                return self.servo.read()
            except NoAnswerError:
                if self._clock.now_s() > deadline_s:
                    raise
