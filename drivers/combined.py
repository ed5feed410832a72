"""Gantry, pan axis, zoom ring and camera as one rig, in the rig frame. It decides nothing: `rig.guard` does.

One device moves at a time, the gantry in a straight line: so the way of a move is known, and where one device fails
nothing else is on the way. Signs and offsets come in as a `Placement`; the mount's geometry does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Protocol, TypeVar

from drivers.frame_checks import BadFrameError
from drivers.not_arrived import NotArrivedError
from drivers.rig_status import NAMES, PAN, ZOOM, RigStatus
from drivers.stopping_all import Stops, in_threads, summed
from rig.devices import (
    AxisStatus,
    Clock,
    GantryStatus,
    Identity,
    LiveAxis,
    LiveCamera,
    LiveGantry,
    Motion,
    Picture,
    StopReport,
    Triple,
)
from rig.errors import HardwareError
from rig.hal import RigPose

Result = TypeVar("Result")


class Placement(Protocol):
    """How the gantry's machine coordinates and the pan servo's angle lie in the rig frame."""

    def to_machine(self, place_mm: Triple) -> Triple:
        """Machine coordinates of a place in the rig frame, mm."""
        ...

    def to_rig(self, machine_mm: Triple) -> Triple:
        """The place in the rig frame of machine coordinates, mm."""
        ...

    def to_axis(self, theta_deg: float) -> float:
        """The pan servo's angle at a pan of the rig frame, degrees."""
        ...

    def to_theta(self, axis_deg: float) -> float:
        """The pan in the rig frame at an angle of the pan servo, degrees."""
        ...


class CombinedRig:
    """All devices of a bench. One thread at a time, except `stop` and `halt`, which any thread may call.

    Args:
        gantry: three linear axes.
        axes: the pan (``theta_deg``) and the zoom ring (``zoom``), as far as the bench has them.
        camera: takes the pictures.
        placement: how machine coordinates lie in the rig frame.
        clock: the same that the devices have.
        fixed: where an axis stands that the bench does not have.
        stops: how several devices are stopped.
    """

    def __init__(
        self,
        gantry: LiveGantry,
        axes: Mapping[str, LiveAxis],
        camera: LiveCamera,
        placement: Placement,
        clock: Clock,
        *,
        fixed: Mapping[str, float] | None = None,
        stops: Callable[[Stops], dict[str, StopReport]] = in_threads,
    ) -> None:
        self.gantry, self.axes, self.camera = gantry, dict(axes), camera
        self._placement, self._clock, self._stops = placement, clock, stops
        self._fixed = {PAN: 0.0, ZOOM: 0.0} | dict(fixed or {})
        self._moving: str | None = None
        # Stops and halts so far, and how many there had been when the command under way began.
        self._breaks = self._begun_at = 0
        self._reached: dict[str, tuple[Triple | float, Triple | float]] = {}
        self._last: RigStatus | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The devices, for people."""
        return ("gantry", *(NAMES[axis] for axis in self.axes), "camera")

    def connect(self) -> dict[str, Identity]:
        """Connect all; nothing moves, and no torque is enabled. If one fails the others are closed again.

        Raises:
            HardwareError: lists every device that cannot be connected, and why.
        """
        self._reached.clear()
        found, failed = _each({name: self._device(name).connect for name in self.names})
        if failed:
            # A failed start follows the torque policy too, and whoever cannot says so.
            failed |= {f"{name}, closing again": error for name, error in _each(self._closes(found))[1].items()}
            raise _joined(f"{len(self.names) - len(found)} of {len(self.names)} devices cannot be connected", failed)
        return found

    def status(self) -> RigStatus:
        """Ask all; a mute device is named, and the others are told all the same."""
        asks: dict[str, Callable[[], GantryStatus | AxisStatus]] = {"gantry": self.gantry.status}
        asks |= {NAMES[axis]: device.status for axis, device in self.axes.items()}
        found, failed = _each(asks)
        gantry = found.get("gantry")
        axes = {axis: found[NAMES[axis]] for axis in self.axes if NAMES[axis] in found}
        self._last = self._told(
            gantry if isinstance(gantry, GantryStatus) else None,
            {axis: status for axis, status in axes.items() if isinstance(status, AxisStatus)},
            tuple(f"{name}: {error}" for name, error in failed.items()),
        )
        return self._last

    def last_status(self) -> RigStatus | None:
        """As last read, without asking. A driver that keeps its ``last_status`` is also followed while it moves."""
        if self._last is None:
            return None
        gantry = getattr(self.gantry, "last_status", None) or self._last.gantry
        axes = {
            axis: getattr(self.axes[axis], "last_status", None) or status for axis, status in self._last.axes.items()
        }
        return self._told(gantry, axes, self._last.mute)

    def home(self) -> None:
        """Home the gantry; pan and zoom know their place or are told it by `reference`.

        Raises:
            HardwareError: it failed; the position is unknown.
        """
        self._begun_at = self._breaks
        self._move("gantry", self.gantry.home)

    def enable(self, axis: str) -> None:
        """Let an axis hold its place.

        Raises:
            HardwareError: it must not; names the axis and says why.
        """
        self._reached.pop(NAMES[axis], None)
        _named(NAMES[axis], self.axes[axis].enable)

    def move_to(self, pose: RigPose) -> RigPose:
        """Move one device after the other, the gantry first, and return the pose read back.

        Raises:
            UnreachableError: beyond what a driver was given. That device was sent nothing.
            HardwareError: a device failed, or a STOP came; motion has been stopped.
        """
        self._begun_at = self._breaks
        place = self._placement.to_rig(self._go(self._placement.to_machine((pose.x_mm, pose.y_mm, pose.z_mm))))
        return RigPose(*place, *(self._turn(axis, getattr(pose, axis)) for axis in (PAN, ZOOM)))

    def step(self, start: RigPose, target: RigPose) -> RigPose:
        """Jog from where the rig stands to a place close by; only the devices that must move are sent anything.

        Raises:
            UnreachableError, HardwareError: as `move_to`.
        """
        self._begun_at = self._breaks
        here, there = ((p.x_mm, p.y_mm, p.z_mm) for p in (start, target))
        if here != there:
            here = self._placement.to_rig(self._jog(_minus(there, here)))
        turned = {
            axis: self._turn(axis, getattr(target, axis))
            for axis in self.axes
            if getattr(target, axis) != getattr(start, axis)
        }
        return RigPose(*here, turned.get(PAN, start.theta_deg), turned.get(ZOOM, start.zoom))

    def step_unplaced(self, step_mm: Triple) -> Triple:
        """Jog the gantry by a step along the rig frame's axes, wherever it is; returns machine coordinates, mm.

        Raises:
            UnreachableError, HardwareError: as `move_to`.
        """
        self._begun_at = self._breaks
        return self._jog(step_mm)

    def capture(self, after_s: float) -> Picture:
        """A picture whose exposure began after ``after_s``.

        Raises:
            BadFrameError: pictures come, but none that can be used.
            HardwareError: none came in time, or the camera has failed.
        """
        try:
            return _named("camera", partial(self.camera.capture, after_s))
        except HardwareError as error:
            # That pictures are bad, not that the camera has failed, is for a scan to know: it tries again.
            if isinstance(error.__cause__, BadFrameError):
                raise BadFrameError(str(error), error.__cause__.faults) from error
            raise

    def unlock(self) -> None:
        """Leave the gantry's alarm, if it is one that can be left so.

        Raises:
            HardwareError: it cannot, and what to do instead.
        """
        self._reached.pop("gantry", None)
        _named("gantry", self.gantry.unlock)

    def reference(self, axis: str, value: float) -> None:
        """Say that an axis now stands at ``value`` (degrees in the rig frame, or zoom 0..1).

        Raises:
            UnreachableError, HardwareError: the axis refuses.
        """
        self._reached.pop(NAMES[axis], None)
        _named(NAMES[axis], partial(self.axes[axis].reference, self._of_axis(axis, value)))

    def place_of(self, machine_mm: Triple) -> Triple:
        """Where the gantry stands in the rig frame, from machine coordinates."""
        return self._placement.to_rig(machine_mm)

    def reboot(self, axis: str) -> None:
        """Reboot the servo of an axis; where it stands is then not known, and its torque is off.

        Raises:
            HardwareError: it does not come back.
        """
        self._reached.pop(NAMES[axis], None)
        _named(NAMES[axis], self.axes[axis].reboot)

    def stop(self) -> StopReport:
        """Stop all devices now, and let the command under way begin with no further one. Never raises."""
        self._breaks += 1
        self._reached.clear()
        stops = {"gantry": self.gantry.stop} | {NAMES[axis]: device.stop for axis, device in self.axes.items()}
        return summed(self._stops(stops))

    def halt(self) -> StopReport | None:
        """Stop the device that moves, if one does; the torque of the others stays as it is. Never raises.

        The command under way begins with no further one.
        """
        self._breaks += 1
        moving = self._moving
        if moving is None:
            return None
        device = self.gantry if moving == "gantry" else self.axes[PAN if moving == "pan" else ZOOM]
        return summed({moving: device.stop()})

    def close(self) -> None:
        """Close all, each following its torque policy. Safe to call twice.

        Raises:
            HardwareError: lists every device that could not be closed as its policy says.
        """
        _, failed = _each(self._closes(self.names))
        if failed:
            raise _joined(f"{len(failed)} of {len(self.names)} devices did not close as they should", failed)

    def _device(self, name: str) -> LiveGantry | LiveAxis | LiveCamera:
        if name == "gantry":
            return self.gantry
        return self.camera if name == "camera" else self.axes[PAN if name == "pan" else ZOOM]

    def _closes(self, names: Sequence[str] | Mapping[str, Identity]) -> dict[str, Callable[[], None]]:
        return {name: self._device(name).close for name in names}

    def _jog(self, step_mm: Triple) -> Triple:
        origin = self._placement.to_machine((0.0, 0.0, 0.0))
        step = _minus(self._placement.to_machine(step_mm), origin)
        return self._move("gantry", self._in_rig_frame(partial(self.gantry.jog, *step)))

    def _move(self, name: str, action: Callable[[], Result]) -> Result:
        # First, so that who halts now sees it move.
        self._moving = name
        self._reached.pop(name, None)
        try:
            if self._breaks != self._begun_at:
                raise HardwareError(f"{name}: not moved, since motion was stopped before it began")
            return _named(name, action)
        finally:
            self._moving = None

    def _go(self, target: Triple) -> Triple:
        if self._is_there("gantry", target):
            status = _named("gantry", self.gantry.status)
            if status.homed and status.motion is Motion.IDLE and status.position_mm == self._reached["gantry"][1]:
                return status.position_mm
        back = self._move("gantry", self._in_rig_frame(partial(self.gantry.move_to, *target)))
        self._reached["gantry"] = target, back
        return back

    def _in_rig_frame(self, motion: Callable[[], Triple]) -> Callable[[], Triple]:
        """The motion, with the places in its errors as whoever asked for it tells them."""

        def told() -> Triple:
            try:
                return motion()
            except NotArrivedError as error:
                raise error.told_in("rig frame", self._placement.to_rig) from error

        return told

    def _is_there(self, name: str, target: Triple | float) -> bool:
        """It was last sent there and arrived, and nothing has happened since: then it is asked instead of sent again,
        which in a scan that changes one axis at a time takes a tenth of a second less for each that stays."""
        return name in self._reached and self._reached[name][0] == target

    def _turn(self, axis: str, value: float) -> float:
        device, name = self.axes.get(axis), NAMES[axis]
        if device is None:
            return self._fixed[axis]
        target = self._of_axis(axis, value)
        back = None
        if self._is_there(name, target):
            status = _named(name, device.status)
            if status.torque and status.motion is Motion.IDLE and status.position == self._reached[name][1]:
                back = status.position
        if back is None:
            back = self._move(name, partial(device.move_to, target))
            self._reached[name] = target, back
        return self._placement.to_theta(back) if axis == PAN else back

    def _of_axis(self, axis: str, value: float) -> float:
        return self._placement.to_axis(value) if axis == PAN else value

    def _told(self, gantry: GantryStatus | None, axes: Mapping[str, AxisStatus], mute: tuple[str, ...]) -> RigStatus:
        at = {axis: axes[axis].position if axis in axes else None for axis in self.axes}
        place = None if gantry is None else gantry.position_mm
        pose = None
        if place is not None and None not in at.values():
            values = self._fixed | {axis: value for axis, value in at.items() if value is not None}
            if PAN in at:
                values[PAN] = self._placement.to_theta(values[PAN])
            pose = RigPose(*self._placement.to_rig(place), values[PAN], values[ZOOM])
        homed = gantry is not None and gantry.homed and all(a in axes and axes[a].referenced for a in self.axes)
        times = [status.read_at_s for status in (gantry, *axes.values()) if status is not None]
        return RigStatus(gantry, axes, pose, homed, min(times, default=self._clock.now_s()), mute)


def _minus(a: Triple, b: Triple) -> Triple:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _each(actions: Mapping[str, Callable[[], Result]]) -> tuple[dict[str, Result], dict[str, HardwareError]]:
    """Do all, whatever becomes of the others: results and failures by name."""
    found, failed = {}, {}
    for name, action in actions.items():
        try:
            found[name] = action()
        except HardwareError as error:
            failed[name] = error
    return found, failed


def _named(name: str, action: Callable[[], Result]) -> Result:
    """Do it; a failure says which device it was."""
    try:
        return action()
    except HardwareError as error:
        raise HardwareError(f"{name}: {error}") from error


def _joined(what: str, failed: Mapping[str, HardwareError]) -> HardwareError:
    return HardwareError("\n".join([f"{what}:", *(f"  {name}: {error}" for name, error in failed.items())]))
