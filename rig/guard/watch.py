"""What the guard knows of the devices, and what it makes of their answers: homed or not, at rest or not, where."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from drivers.combined import CombinedRig
from drivers.rig_status import RigStatus
from rig.devices import Clock, Identity, Motion, StopReport, Triple
from rig.errors import HardwareError
from rig.guard import remedies
from rig.guard.errors import RefusedError
from rig.guard.machine import Machine
from rig.guard.rules import Rules
from rig.guard.states import Event, State
from rig.guard.ways import Play
from rig.hal import AXES, RigPose

_LOOKS, _LOOK_AGAIN_S = 3, 0.1


class HomingMemory(Protocol):
    """Where a gantry was left homed, over the end of a process."""

    def recall(self, gantry: Identity) -> Triple | None:
        """Machine coordinates at which it was left homed, mm, or ``None``. What is recalled is forgotten."""
        ...

    def remember(self, gantry: Identity, place_mm: Triple) -> None:
        """It is left here, homed and at rest."""
        ...


class StopLatch(Protocol):
    """A STOP that outlives the process: other processes must not move either before it is released by hand."""

    def note(self) -> str:
        """Who stopped the bench and when; empty if it is not stopped."""
        ...

    def set(self, note: str) -> str:
        """Latch; returns what went wrong, if that cannot be done. Never raises."""
        ...

    def clear(self) -> None:
        """Release."""
        ...


@dataclass(frozen=True, slots=True)
class GuardStatus:
    """What is known at a glance.

    Attributes:
        state: of the guard.
        running: the command that is under way; empty if none is.
        pose: where the rig stands, if that means anything.
        rig: the devices as last read; ``None``: never.
        age_s: how old that is.
        stale: older than the bench allows for moving; it must be shown as such.
        troubles: what is wrong, for people.
        stop: what the last STOP did.
    """

    state: State
    running: str
    pose: RigPose | None
    rig: RigStatus | None
    age_s: float
    stale: bool
    troubles: tuple[str, ...]
    stop: StopReport | None = None


class Watch:
    """Keeps what is known of the devices, and asks them. Used by one command at a time; `glance` by any thread.

    Attributes:
        homed: the gantry has been homed in this session, or stands where the last one left it homed.
        at: where the rig stands, ``None`` where that means nothing.
        play: what is known of the backlash.
        commanded: the pose it was last sent to, and has reached.
        fault: what went wrong last and nobody has taken note of yet.
        rest_since_s: when the last motion ended.
        stop: what the last STOP did.
    """

    def __init__(
        self,
        rig: CombinedRig,
        rules: Rules,
        clock: Clock,
        machine: Machine,
        memory: HomingMemory | None,
        latch: StopLatch | None,
    ) -> None:
        self._rig, self._rules, self._clock, self._machine = rig, rules, clock, machine
        self._memory, self._latch = memory, latch
        self.identities: dict[str, Identity] = {}
        self.connected = self.homed = False
        self.fault = ""
        self.rest_since_s = clock.now_s()
        self.stop: StopReport | None = None
        self.at: RigPose | None = None
        self.play: Play | None = None
        self.commanded: RigPose | None = None
        self._enabled: set[str] = set()

    def connect(self) -> RigStatus:
        """Connect all devices and see how they are.

        Raises:
            HardwareError: lists every device that cannot be connected.
        """
        self.forget()
        self.fault = ""
        self.identities = self._rig.connect()
        self.connected, self.rest_since_s = True, self._clock.now_s()
        status = self._rig.status()
        self.homed = self._is_remembered(status)
        self.take(status)
        return status

    def connect_camera(self) -> None:
        """Close the camera and open it anew; nothing else is asked or told anything.

        Raises:
            HardwareError: it cannot be connected.
        """
        # What is left of a camera that has failed need not close well.
        with suppress(HardwareError):
            self._rig.camera.close()
        try:
            self.identities["camera"] = self._rig.camera.connect()
        except HardwareError as error:
            raise HardwareError(f"camera: {error}") from error

    def forget(self) -> None:
        """Nothing is known of where the rig stands."""
        self.connected = self.homed = False
        self.at = self.play = self.commanded = None
        self._enabled.clear()

    def let_go(self, axis: str | None = None) -> None:
        """An axis, or all, may have let go, and that is no fault."""
        self._enabled -= set(self._rig.axes) if axis is None else {axis}

    def glance(self) -> GuardStatus:
        """What is known without asking."""
        status = self._rig.last_status()
        age_s = 0.0 if status is None else self._clock.now_s() - status.read_at_s
        stale = status is None or age_s > self._rules.stale_s
        told = [f"STOP: {self._machine.stop_note}" if self._machine.stop_note else "", self.fault]
        told += [] if status is None else status.troubles
        pose = None if status is None or not self._is_homed(status) else status.pose
        running = self._machine.running
        return GuardStatus(
            self._machine.state, running, pose, status, age_s, stale, tuple(filter(None, told)), self.stop
        )

    def ask(self) -> RigStatus:
        """Ask all devices, once more where one has not quite come to rest, and take what they say."""
        for _ in range(_LOOKS):
            status = self._rig.status()
            if all(motion in (Motion.IDLE, Motion.ALARM) for motion in status.motions.values()):
                break
            self._clock.sleep_s(_LOOK_AGAIN_S)
        self.take(status)
        return status

    def take(self, status: RigStatus) -> None:
        """Believe what the devices say, and forget what it contradicts."""
        if status.gantry is not None and not status.gantry.homed:
            self.homed = False
        self.at = status.pose if self._is_homed(status) else None
        if self.at is None:
            self.play = self.commanded = None

    def found(self, status: RigStatus) -> State:
        """The state that the devices' answers mean. Motion that nobody has commanded is an alarm too."""
        if status.mute or not self.connected:
            return State.DISCONNECTED
        if self.fault or any(motion is not Motion.IDLE for motion in status.motions.values()):
            return State.ALARM
        return State.IDLE if self.at is not None else State.UNHOMED

    def ready(self, event: Event) -> RigStatus:
        """A fresh status that allows a command.

        Raises:
            StoppedError, HeldError, RefusedError: the state does not allow it.
            HardwareError: a device does not answer, is in alarm, or its status is stale.
        """
        self._machine.refuse(event)
        if self._latch is not None and (note := self._latch.note()):
            self._machine.latch_stop(note)
            self._machine.note_stop()
        status = self.ask()
        self._machine.find(self.found(status))
        if status.mute:
            raise HardwareError(f"{'; '.join(status.mute)}. Nothing was sent. Connect again")
        age_s = self._clock.now_s() - status.read_at_s
        if not age_s <= self._rules.stale_s:
            raise HardwareError(
                f"the status is {age_s:.1f} s old, more than {self._rules.stale_s:g} s. Nothing was sent. "
                "Look at the devices' links, then connect again"
            )
        if event is not Event.HOME and self._machine.state is State.ALARM:
            raise HardwareError(f"{event.value} is not possible in alarm: {self.why(status)}")
        self._machine.refuse(event)
        return status

    def why(self, status: RigStatus) -> str:
        """What is wrong, for people."""
        told = [*([self.fault] if self.fault else []), *status.troubles]
        return "; ".join(told) or ", ".join(f"{name} is {motion.value}" for name, motion in status.motions.items())

    def enable(self) -> None:
        """Let the axes hold their place before anything moves; one that has let go by itself is not taken again.

        Raises:
            HardwareError: an axis has let go, or must not be enabled.
        """
        status = self._rig.last_status()
        for axis, told in ({} if status is None else status.axes).items():
            if axis in self._enabled and not told.torque:
                self._enabled.discard(axis)
                raise HardwareError(
                    f"{axis}: the servo has let go by itself, and its load may have moved. Look at it, then try again"
                )
            if told.referenced and told.motion is not Motion.ALARM:
                # Also one that holds already: whoever left it so may have sent it somewhere else.
                if axis not in self._enabled:
                    self._rig.enable(axis)
                self._enabled.add(axis)

    def verify(self, wanted: RigPose, back: RigPose) -> None:
        """Compare commanded and read back; a difference stops everything.

        Raises:
            HardwareError: names axis, both values and the tolerance.
        """
        for axis in AXES:
            asked, got, most = getattr(wanted, axis), getattr(back, axis), self._rules.tolerance.of(axis)
            if not abs(got - asked) <= most:
                self._rig.stop()
                raise HardwareError(
                    f"{axis} was commanded to {asked:g} and reads back {got:g}, more than {most:g} off. "
                    "Look for lost steps or something in the way, then home it"
                )

    def refuse_unsteady(self, before: RigPose) -> None:
        """Drop a picture during whose exposure the rig did not stand still.

        Raises:
            HardwareError: names axis and by how much it moved.
        """
        for axis in AXES:
            moved = abs(getattr(self.known_pose(), axis) - getattr(before, axis))
            if not moved <= self._rules.tolerance.of(axis):
                raise HardwareError(f"{axis} moved by {moved:g} while the picture was taken. The picture was dropped")

    def known_pose(self) -> RigPose:
        """Where the rig stands.

        Raises:
            StoppedError: not known, and STOP is latched: that has to be seen to first.
            RefusedError: not known.
        """
        if self.at is None:
            if self._machine.stop_note:
                self._machine.refuse(Event.MOVE)
            status = self._rig.last_status()
            lost = [] if status is None else remedies.lost_axes(status.axes)
            remedy = remedies.find_place(lost, self._machine.bench)
            raise RefusedError(f"where the rig stands is not known. {remedy}")
        return self.at

    def remember(self) -> None:
        """Note where the gantry is left, if it is left homed and in order."""
        if self._memory is None or not self.connected or not self.homed or self._machine.state is not State.IDLE:
            return
        status = self.ask()
        if self.found(status) is State.IDLE and status.gantry is not None and status.gantry.position_mm is not None:
            self._memory.remember(self.identities["gantry"], status.gantry.position_mm)

    def _is_homed(self, status: RigStatus) -> bool:
        return status.homed and (self.homed or self._rules.homing == "as_found")

    def _is_remembered(self, status: RigStatus) -> bool:
        """The gantry stands where it was left homed. Recalled once: a session that ends badly leaves nothing."""
        if self._memory is None:
            return False
        left = self._memory.recall(self.identities["gantry"])
        place = None if status.gantry is None or not status.gantry.homed else status.gantry.position_mm
        if self._rules.homing != "remembered" or left is None or place is None:
            return False
        return max(abs(a - b) for a, b in zip(left, place, strict=True)) <= self._rules.tolerance.mm


Seen = Callable[[State, Event, State], None]
