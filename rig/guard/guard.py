"""The guard: the one way by which live commands reach the devices of a bench, whoever gives them.

It is a `rig.hal.Rig`, so the recogniser runs on it as on the mock. A command is checked for state, limits, keep-out
boxes and fresh status before a byte is sent, and the pose is read back after it. `stop` and `hold` may be called by any
thread at any time: they wait for nothing that a command holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from drivers.combined import CombinedRig
from rig.devices import Clock, Identity, Picture, StopReport
from rig.errors import HardwareError, UnreachableError
from rig.guard import remedies
from rig.guard.activity import HOMED_OR_NOT, Activities
from rig.guard.by_hand import ByHand
from rig.guard.errors import RefusedError
from rig.guard.link import Companion, Link
from rig.guard.machine import Machine
from rig.guard.rules import LINEAR, Rules
from rig.guard.states import Event, State
from rig.guard.stopping import Stopping
from rig.guard.watch import GuardStatus, HomingMemory, Seen, StopLatch, Watch
from rig.guard.ways import Play, arrived, offers, plan, preflight, refuse_inside, refuse_outside, refuse_way, seconds
from rig.hal import AXES, Frame, RigLimits, RigPose


class Guard:
    """A live rig that cannot be driven past its rules. A context manager: entering connects, leaving closes.

    Args:
        rig: the devices. Nobody else may send them anything.
        rules: of the bench.
        clock: the same that the devices have.
        memory: keeps over the end of a process where the gantry was left homed.
        latch: keeps a STOP over the end of a process.
        company: contexts that are entered before the devices are connected and left after they are closed, e.g. who
            listens for a STOP from other processes.
        seen: is told every transition of the state.
        bench: its file, for messages that name commands.

    Attributes:
        bench: as told.
        rules: as told.
        clock: as told.
    """

    def __init__(
        self,
        rig: CombinedRig,
        rules: Rules,
        clock: Clock,
        *,
        memory: HomingMemory | None = None,
        latch: StopLatch | None = None,
        company: Sequence[Companion] = (),
        seen: Seen = lambda source, event, target: None,
        bench: str = remedies.BENCH,
    ) -> None:
        self._rig, self.rules, self.clock = rig, rules, clock
        self.bench = bench
        self._machine = Machine(seen, bench)
        self._watch = Watch(rig, rules, clock, self._machine, memory, latch)
        self._activities = Activities(rig, self._machine, self._watch, clock)
        self._link = Link(rig, self._machine, self._watch, latch, company)
        self._stopping = Stopping(rig, self._machine, self._watch, latch)
        self._by_hand = ByHand(rig, rules, self._machine, self._watch)
        self._sequence = 0

    # What is known.

    @property
    def state(self) -> State:
        """The present state."""
        return self._machine.state

    @property
    def running(self) -> str:
        """The command that is under way; empty if none is."""
        return self._machine.running

    @property
    def identities(self) -> dict[str, Identity]:
        """Who answered when connecting, by device."""
        return dict(self._watch.identities)

    @property
    def pose(self) -> RigPose:
        """Where the rig stands, as last read back.

        Raises:
            RefusedError: not known.
        """
        return self._watch.known_pose()

    @property
    def limits(self) -> RigLimits:
        """Travel and speeds; what approaches against backlash need is taken off."""
        return self.rules.usable

    @property
    def internals_fixed_by_zoom(self) -> bool:
        """True if the bench vouches for it."""
        return self.rules.internals_fixed_by_zoom

    def glance(self) -> GuardStatus:
        """What is known without asking any device; any thread, at any time."""
        return self._watch.glance()

    def status(self) -> GuardStatus:
        """Ask all devices, unless a command is under way or none is connected: then what is known at a glance."""
        if self._watch.connected and not self.running:
            with suppress(RefusedError), self._machine.alone("reading the status", yields=True):
                self._machine.find(self._watch.found(self._watch.ask()))
        return self.glance()

    def latest(self) -> Picture | None:
        """The camera's newest picture, however old, for previews; any thread."""
        return self._rig.camera.latest() if self._watch.connected else None

    # Where it may go.

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        """A lattice around a pose (or around where the rig stands), as far as it may be gone to from there."""
        return offers(self.rules, near or self.pose)

    def nearest(self, wish: RigPose) -> RigPose:
        """The wish itself: a live rig can be anywhere within its limits and outside its keep-out boxes.

        Raises:
            UnreachableError: it is not finite, outside the limits, or in a keep-out box.
        """
        refuse_outside(wish, self.limits)
        refuse_inside(wish, self.rules.keep_out)
        return wish

    def preflight(self, poses: Sequence[RigPose]) -> None:
        """Return if all poses can be gone to in this order, from where the rig stands. Nothing is sent.

        Raises:
            UnreachableError: names the first that cannot, its number, and why.
        """
        at = self._watch.at
        preflight(self.rules, self._watch.play or (None if at is None else Play(at)), poses)

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        """Seconds from one pose to the other, one device after the other, settling and exposure included."""
        return seconds(self.rules.travel, start, end)

    # Commands, one at a time. A second one is refused with a BusyError that names the first.

    def connect(self) -> dict[str, Identity]:
        """Connect all devices. Nothing moves, nothing is unlocked, and no torque is enabled.

        Where they are connected already only the camera is, anew: a lost one costs neither homing nor torque.

        Raises:
            HardwareError: lists every device that cannot be connected.
            StoppedError, RefusedError: not now.
        """
        self._link.connect(self)
        return self.identities

    def home(self) -> RigPose | None:
        """Home the gantry; where it then stands, or ``None`` while the pan or the zoom is not referenced.

        Raises:
            StoppedError, HeldError, RefusedError: not now.
            HardwareError: it failed, and the position is unknown.
        """
        with self._machine.alone("homing"):
            self._watch.ready(Event.HOME)
            self._watch.enable()
            with self._activities.during(Event.HOME, State.MOVING, HOMED_OR_NOT):
                self._watch.homed, self._watch.fault = False, ""
                self._rig.home()
                self._watch.homed = True
        return self._watch.at

    def move_to(self, pose: RigPose) -> RigPose:
        """Move to a pose, by way of the approaches against backlash, and return the pose read back.

        Raises:
            UnreachableError: not finite, outside the limits, in a keep-out box, or the way leads through one.
            StoppedError, HeldError, RefusedError: not now, or ended by a STOP or a hold.
            HardwareError: a device failed, or the pose read back is another. Motion has been stopped.
        """
        refuse_outside(pose, self.limits)
        refuse_inside(pose, self.rules.keep_out)
        with self._machine.alone(f"a move to {_told(pose)}"):
            self._watch.ready(Event.MOVE)
            ways = plan(self.rules, self._watch.play or Play(self.pose), pose)
            self._watch.enable()
            with self._activities.during(Event.MOVE, State.MOVING):
                for leg in ways:
                    self._activities.refuse_broken_off()
                    self._watch.verify(leg, self._rig.move_to(leg))
            self._watch.commanded, self._watch.play = pose, arrived(pose, self.rules.overshoot)
        return self.pose

    def jog(
        self,
        *,
        dx_mm: float = 0.0,
        dy_mm: float = 0.0,
        dz_mm: float = 0.0,
        dtheta_deg: float = 0.0,
        dzoom: float = 0.0,
    ) -> RigPose | None:
        """One step from where the rig stands; returns the pose read back, ``None`` if that means nothing (unhomed).

        Raises:
            UnreachableError, StoppedError, HeldError, RefusedError, HardwareError: as `move_to`.
        """
        step = RigPose(dx_mm, dy_mm, dz_mm, dtheta_deg, dzoom)
        with self._machine.alone("a jog"):
            self._watch.ready(Event.JOG)
            if self.state is State.UNHOMED:
                self._jog_unhomed(step)
                return None
            start = self.pose
            target = RigPose(*(getattr(start, axis) + getattr(step, axis) for axis in AXES))
            # An axis that is not jogged may stay where it reads a hair beyond its limit.
            refuse_outside(target, self.rules.travel, axes=[axis for axis in AXES if getattr(step, axis)])
            refuse_way(start, target, self.rules.keep_out)
            self._watch.enable()
            with self._activities.during(Event.JOG, State.JOGGING):
                self._watch.play = None
                self._watch.verify(target, self._rig.step(start, target))
            self._watch.commanded = target
        return self.pose

    def capture(self) -> Frame:
        """Settle, take a picture exposed after that and after this call, and see that the rig stood still meanwhile.

        Raises:
            StoppedError, HeldError, RefusedError: not now, or stopped meanwhile.
            HardwareError: no picture, or the rig did not stand still; the picture is dropped.
        """
        with self._machine.alone("a capture"):
            self._watch.ready(Event.CAPTURE)
            pose = self.pose
            with self._activities.during(Event.CAPTURE, State.CAPTURING):
                settled_s = self._watch.rest_since_s + self.rules.travel.settle_s
                self.clock.sleep_s(max(0.0, settled_s - self.clock.now_s()))
                picture = self._rig.capture(self.clock.now_s())
            self._watch.refuse_unsteady(pose)
            self._sequence += 1
            commanded = self._watch.commanded or pose
        return Frame(picture.image, pose, commanded, f"{self._sequence:06d}", self._sequence, picture.exposed_at_s)

    def unlock(self) -> State:
        """On a person's request: leave an alarm that keeps the position, or take note of a failed move.

        Raises:
            HardwareError: this alarm cannot be left so, and what to do instead.
            StoppedError, RefusedError: not now.
        """
        self._by_hand.unlock()
        return self.state

    def reference(self, axis: str, value: float) -> State:
        """On a person's request: ``theta_deg`` or ``zoom`` now stands at this value.

        Raises:
            UnreachableError: not within the axis's limits.
            RefusedError, HardwareError: not now; no such axis; the axis refuses.
        """
        self._by_hand.reference(axis, value)
        return self.state

    def reboot(self, axis: str) -> State:
        """On a person's request: reboot the servo of an axis that reports a hardware error, once its cause is removed.

        Its torque is then off, and where it stands is not known until `reference`.

        Raises:
            RefusedError: not now; no such axis; it reports no hardware error.
            StoppedError, HardwareError: STOP is latched; it does not come back.
        """
        self._by_hand.reboot(axis)
        return self.state

    def close(self) -> None:
        """Close all devices, each following its torque policy; what is under way is held first. Safe to call twice.

        Raises:
            HardwareError: a device could not be closed as its policy says, or what was under way did not end.
        """
        if self.running:
            self.hold()
        self._link.close()

    def __enter__(self) -> Guard:
        if self._watch.connected:
            return self
        try:
            self.connect()
        except BaseException:
            # Whatever was opened is closed again; why it was not all opened says more than why it does not close.
            with suppress(HardwareError):
                self.close()
            raise
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

    # Stopping. Any thread, at any time.

    def stop(self, by: str = "by hand") -> StopReport:
        """STOP: everything at rest, and nothing moves before `release`. Never raises; says what is not certain."""
        return self._stopping.stop(by)

    def hold(self) -> StopReport | None:
        """Stop motion, without latching STOP: a picture being taken is finished, and nothing moves until `resume`.

        Never raises; returns what stopping did, or ``None`` where nothing moved.
        """
        return self._stopping.hold()

    def resume(self) -> State:
        """Let motion be commanded again after a hold. What was held does not go on by itself.

        Raises:
            StoppedError, RefusedError: not now.
        """
        with self._machine.alone("resuming"):
            self._machine.refuse(Event.RESUME)
            self._machine.go(Event.RESUME, self._watch.found(self._watch.ask()))
        return self.state

    def release(self) -> State:
        """Release STOP, on a person's request; the state is then what the devices say.

        Raises:
            RefusedError: it is not stopped, or the stopped command has not ended yet.
            StoppedError: another STOP came meanwhile; that one is latched.
        """
        self._stopping.release()
        return self.state

    # Within.

    def _jog_unhomed(self, step: RigPose) -> None:
        """A step of the gantry, and only that, if the bench allows it.

        Its limits mean nothing yet, unless it is a servo alone that does not know its place.
        """
        longest = self.rules.unhomed_jog_mm
        for axis in LINEAR:
            # Written so that a value which is not a number is too long.
            if not abs(getattr(step, axis)) <= longest:
                raise UnreachableError(
                    f"d{axis} = {getattr(step, axis):g} is more than {longest:g}, the longest jog before homing "
                    f"(safety.unhomed_jog_mm). {remedies.out_of(State.UNHOMED, self._machine.bench)}"
                )
        if step.theta_deg or step.zoom:
            remedy = remedies.out_of(State.UNHOMED, self._machine.bench)
            raise RefusedError(f"before homing only the gantry can be jogged. {remedy}")
        gantry = self._watch.ask().gantry
        if gantry is not None and gantry.homed and gantry.position_mm is not None:
            start = RigPose(*self._rig.place_of(gantry.position_mm), 0.0)
            target = RigPose(*(getattr(start, axis) + getattr(step, axis) for axis in AXES))
            refuse_outside(target, self.rules.travel, axes=[axis for axis in LINEAR if getattr(step, axis)])
            refuse_way(start, target, self.rules.keep_out)
        with self._activities.during(Event.JOG, State.JOGGING, HOMED_OR_NOT):
            self._rig.step_unplaced((step.x_mm, step.y_mm, step.z_mm))


def _told(pose: RigPose) -> str:
    return ", ".join(f"{axis} {getattr(pose, axis):g}" for axis in AXES)
