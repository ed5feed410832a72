"""One servo behind the axis: what is known of it, checked writes, taking hold, letting go.

A servo keeps its place within a turn for ever, its count of turns only while it has power. So the turns that must be
added to its count are noted *in its RAM* (`drivers.dynamixel.table.NOTE`), where they vanish with the power, exactly
when the count does: a missing note is a servo that has rebooted, whether we were there or not. In position mode the
place is known without turns; a reboot in mid-session is flagged all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from drivers.dynamixel.answers import NoAnswerError
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.checks import check_model, check_setup, complaint_of
from drivers.dynamixel.motion import write_checked
from drivers.dynamixel.settings import DynamixelSettings
from drivers.dynamixel.table import (
    GOAL,
    GOAL_CURRENT,
    MODELS,
    NOTE,
    PROFILE_ACCELERATION,
    PROFILE_VELOCITY,
    SETUP_ADDRESS,
    SETUP_LENGTH,
    TICKS_PER_TURN,
    TORQUE,
    WATCHDOG,
    Register,
    ServoState,
    Setup,
    note_of,
    parse_setup,
)
from drivers.serial_link import LinkLostError
from rig.errors import HardwareError

_HERE_TICKS = 3
"""A goal this near to the present place is the present place."""

Check = Callable[[Mapping[int, ServoState]], None]


class StoppedError(HardwareError):
    """A STOP came while something was under way."""


class Servo:
    """A servo on a bus.

    Attributes:
        name: for messages.
        turns: turns to be added to the servo's count; ``None``: not known, the servo is not referenced.
        rebooted: it lost them while we were connected.
        enabled: we have taken hold of it since it was connected, or referenced.
        stops: how many STOPs there were; whoever drives the servo gives up when it changes.
    """

    def __init__(self, settings: DynamixelSettings, bus: DynamixelBus) -> None:
        """A servo that is not connected."""
        self.settings, self.bus = settings, bus
        self.name = f"{settings.role.kind} servo {settings.id} on {settings.port}"
        self.turns: int | None = None
        self.rebooted = self.enabled = False
        self.stops = 0
        self._noted = False
        self._setup: Setup | None = None
        self._session = 0

    # Connecting.

    def connect(self) -> Setup:
        """Open the bus, check the servo, and see whether it is referenced. Moves nothing.

        Raises:
            HardwareError: see `DynamixelAxis.connect`.
        """
        self._setup = None
        self.bus.open(self)
        try:
            setup = self._identify()
        except HardwareError:
            self.bus.close(self)
            raise
        self._session, self._setup = self.bus.session, setup
        self.rebooted = self.enabled = self._noted = False
        try:
            check_setup(self.name, self.settings, setup)
            self.turns = self.read().turns
        except HardwareError as error:
            failed = self.failed_start(error)
            self.disconnect()
            raise failed from error
        self._noted = self.turns is not None
        if self.settings.mode == "position":
            self.turns = 0
        return setup

    def _identify(self) -> Setup:
        check_model(self.name, self.settings, self.bus.ping(self.settings.id))
        try:
            return parse_setup(self.bus.read(self.settings.id, SETUP_ADDRESS, SETUP_LENGTH))
        except NoAnswerError as error:
            raise HardwareError(
                f"{self.name} answers pings, but not reads. Set its status return level (address 68) to 2"
            ) from error

    def disconnect(self) -> None:
        """Forget the servo and let go of the bus."""
        self._setup = None
        self.bus.close(self)

    @property
    def connected(self) -> bool:
        """It was connected and not yet disconnected, though the link may be lost."""
        return self._setup is not None

    @property
    def setup(self) -> Setup:
        """What is kept in the servo.

        Raises:
            LinkLostError: not connected, or the bus was opened anew since.
        """
        if self._setup is None or self._session != self.bus.session:
            raise LinkLostError(f"{self.name}: not connected, or the link was lost. Connect again")
        return self._setup

    # Reading and writing.

    def read(self) -> ServoState:
        """Its state now; notices a reboot.

        Raises:
            LinkLostError: not connected.
            NoAnswerError: it does not answer.
        """
        state = self.bus.state(self.setup.servo_id)
        self.see(state)
        return state

    def see(self, state: ServoState) -> None:
        """Notice a reboot in a state: the note is gone, or is another."""
        if self._noted and state.turns != self.turns:
            self.turns, self._noted, self.enabled, self.rebooted = None, False, False, True

    def write(self, register: Register, value: int, check: Check = lambda states: None) -> ServoState:
        """`write_checked` for this servo."""
        states = write_checked(self.bus, register, {self.setup.servo_id: value}, check)
        return states[self.settings.id]

    def note(self, turns: int) -> ServoState:
        """Note the turns in the servo; torque must be off."""
        self._noted = False
        state = self.write(NOTE, note_of(turns))
        self.turns, self._noted, self.rebooted = turns, True, False
        return state

    def forget_turns(self) -> None:
        """A reboot was asked for."""
        self.turns, self._noted, self.enabled, self.rebooted = None, False, False, True

    # Judging.

    def complaint(self, state: ServoState) -> str:
        """What is wrong, for people; empty where nothing is."""
        text = complaint_of(state, self.settings.role.kind, rebooted=self.rebooted, referenced=self.turns is not None)
        return text and f"{self.name} {text}"

    def refuse_trouble(self, state: ServoState) -> None:
        """Raise what stands against driving the servo.

        Raises:
            HardwareError: hardware error, rebooted, not referenced, or stopped by its watchdog.
        """
        if complaint := self.complaint(state):
            raise HardwareError(complaint)

    def refuse_stopped(self, stops: int) -> None:
        """Raise if a STOP came since ``stops`` was counted.

        Raises:
            StoppedError: it did.
        """
        if self.stops != stops:
            raise StoppedError(f"{self.name} was stopped. Release the STOP before you go on")

    # Taking hold and letting go.

    def take_hold(self, stops: int) -> ServoState:
        """Hold the present place. Nothing moves, whatever was left in the servo.

        Raises:
            HardwareError: it fails, its place changes, or a STOP came since ``stops`` was counted.
        """

        def check(states: Mapping[int, ServoState]) -> None:
            self.refuse_stopped(stops)
            for state in states.values():
                self.see(state)
                self.refuse_trouble(replace(state, watchdog=0))

        state = self.read()
        # Cleared with torque on, a tripped watchdog would let it go on to its old goal; the note needs torque off too.
        if state.torque and (state.watchdog < 0 or not self._noted):
            state = self.write(TORQUE, 0)
        if not state.torque and state.watchdog:
            state = self.write(WATCHDOG, 0)
        if not self._noted and self.turns is not None:
            state = self.note(self.turns)
        here = state.position
        if not (state.torque and state.at_rest and abs(state.goal - here) <= _HERE_TICKS):
            state = self.write(GOAL, here, check)
        for register, value in self._profile().items():
            state = self.write(register, value, check)
        if state.watchdog:
            state = self.write(WATCHDOG, 0, check)
        self._refuse_turned(state, here)
        if not state.torque:
            state = self.write(TORQUE, 1, check)
        self.refuse_trouble(state)
        return state

    def _profile(self) -> dict[Register, int]:
        settings = self.settings
        values = {
            PROFILE_ACCELERATION: settings.profile_acceleration,
            PROFILE_VELOCITY: settings.profile_velocity,
        }
        unit_ma = MODELS[settings.model].current_unit_ma
        if settings.mode == "current_based" and unit_ma:
            wanted = settings.current_limit_ma
            values[GOAL_CURRENT] = int(wanted / unit_ma) if wanted else self.setup.current_limit
        return values

    def _refuse_turned(self, state: ServoState, here: int) -> None:
        if not state.torque and abs(state.position - here) > _HERE_TICKS:
            raise HardwareError(
                f"{self.name} was turned by {abs(state.position - here) * 360 / TICKS_PER_TURN:.1f}° while torque was "
                "being enabled. Keep it still, then enable it again"
            )

    def let_go(self) -> ServoState:
        """Torque off.

        Raises:
            HardwareError: it could not be switched off.
        """
        state = self.read()
        return self.write(TORQUE, 0) if state.torque else state

    def failed_start(self, error: HardwareError) -> HardwareError:
        """Follow the torque policy after a failed start; returns the error with what came of it."""
        if self.settings.torque_at_failed_start == "hold":
            return error
        try:
            self.let_go()
        except HardwareError as second:
            return type(error)(f"{error}. Besides, torque could not be released: {second}")
        return error
