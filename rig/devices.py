"""What live devices show to the guard: a clock, status values, and narrow Protocols of a gantry, an axis and a camera.

A driver makes these of one device family and knows nothing of the others. Frames and units: a gantry speaks its
controller's machine coordinates in mm, a pan axis degrees, a zoom ring 0..1; signs, scales and squareness of the
bench are applied above. Every time is monotonic, in seconds, from the `Clock` that the driver was given.
No method retries a motion by itself, and none homes, unlocks, resets or enables torque that was not told to.
This module imports nothing of ours but `rig.hal`.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Protocol

from rig.hal import Image

Triple = tuple[float, float, float]


class Clock(Protocol):
    """Monotonic time and waiting. Passed in, so that tests never sleep."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        ...

    def sleep_s(self, seconds: float) -> None:
        """Wait."""
        ...


class Motion(enum.Enum):
    """What a device says that it is doing."""

    UNKNOWN = "unknown"
    IDLE = "idle"
    MOVING = "moving"
    JOGGING = "jogging"
    HOMING = "homing"
    HOLDING = "holding"
    """Slowing down after a feed hold."""
    HELD = "held"
    """At rest after a feed hold, moves still buffered."""
    ALARM = "alarm"


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answered at the other end.

    Attributes:
        kind: device family, e.g. ``GRBL``, ``grblHAL``, ``FluidNC``, ``XM430-W350``.
        version: firmware, as the device writes it.
        where: port, bus id or path by which it was reached.
    """

    kind: str
    version: str
    where: str


@dataclass(frozen=True, slots=True)
class GantryStatus:
    """The gantry as last read.

    Attributes:
        position_mm: machine coordinates; ``None``: not known (not homed, homing failed, position lost).
        homed: the machine coordinates mean something.
        alarm: the controller's alarm code.
        read_at_s: when the report was received.
        trouble: what is wrong and what to do about it, for people; empty where nothing is.
    """

    motion: Motion
    position_mm: Triple | None
    homed: bool
    read_at_s: float
    alarm: int | None = None
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """A pan axis or zoom ring as last read.

    Attributes:
        position: degrees, or zoom 0..1; ``None``: not known (rebooted, or it does not answer).
        referenced: the position means something (a servo that has rebooted is not referenced).
        read_at_s: when it was read.
        torque: the servo holds its place.
        temperature_c, voltage_v, load: as read; ``load`` is a share of the largest, -1..1.
        trouble: what is wrong and what to do about it, for people; empty where nothing is.
    """

    motion: Motion
    position: float | None
    referenced: bool
    read_at_s: float
    torque: bool = False
    temperature_c: float | None = None
    voltage_v: float | None = None
    load: float | None = None
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class StopReport:
    """What a STOP did.

    Attributes:
        sent_at_s: when the first byte that stops went out; ``None``: it could not be sent.
        confirmed: the device said that it is at rest.
        position_kept: the position is still known.
        trouble: what could not be done, for people; empty where all was.
    """

    sent_at_s: float | None
    confirmed: bool
    position_kept: bool
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A camera's picture before anybody knows where it was taken. ``sequence`` counts the camera's frames."""

    image: Image = field(repr=False)
    sequence: int
    exposed_at_s: float


class LiveGantry(Protocol):
    """Three linear axes on one controller. One thread at a time, except `stop`, which any thread may call."""

    def connect(self) -> Identity:
        """Open, lock and identify. Never homes, unlocks, resets or moves.

        Raises:
            HardwareError: no such port, permission denied, in use (names the holder), an unknown or mute device.
        """
        ...

    def status(self) -> GantryStatus:
        """Ask and wait for the answer.

        Raises:
            HardwareError: no valid report within the bound; the link is then dead until `connect`.
        """
        ...

    def home(self) -> GantryStatus:
        """Home all axes; its own, long deadline.

        Raises:
            HardwareError: it failed; the position is unknown.
        """
        ...

    def move_to(self, x_mm: float, y_mm: float, z_mm: float) -> Triple:
        """Move in a straight line and return the position read back once it is at rest there, machine coordinates.

        Raises:
            UnreachableError: not finite, or outside the limits the driver was given. Nothing was sent.
            HardwareError: alarm, time-out, lost answer, or not arrived. Motion has been stopped.
        """
        ...

    def jog(self, dx_mm: float, dy_mm: float, dz_mm: float) -> Triple:
        """One step relative to the present place, waiting until at rest; errors as `move_to`."""
        ...

    def unlock(self) -> GantryStatus:
        """Leave an alarm that keeps the position, on a person's request; one that does not asks for homing instead.

        Raises:
            HardwareError: this alarm cannot be left so, and what to do instead.
        """
        ...

    def stop(self) -> StopReport:
        """Stop now: feed hold, wait until held, then reset; a hard time-out resets regardless. Never raises."""
        ...

    def close(self) -> None:
        """Release the port. Safe to call twice."""
        ...


class LiveAxis(Protocol):
    """One servo axis: the pan in degrees, or the zoom ring 0..1. Threads as for `LiveGantry`."""

    def connect(self) -> Identity:
        """Open and check model, id, mode and hardware errors. Moves nothing and enables no torque.

        Raises:
            HardwareError: as `LiveGantry.connect`, or another model, id or mode than told.
        """
        ...

    def status(self) -> AxisStatus:
        """Read it all, with a bounded number of retries.

        Raises:
            HardwareError: it does not answer.
        """
        ...

    def enable(self) -> AxisStatus:
        """Hold the present place: goal := present, then torque on. Moves nothing.

        Raises:
            HardwareError: a hardware error is latched, or the servo has rebooted and its turns are lost.
        """
        ...

    def move_to(self, position: float) -> float:
        """Move and return the position read back once at rest there.

        Raises:
            UnreachableError: not finite, or outside the limits the driver was given. Nothing was sent.
            HardwareError: stuck, overloaded, hot, not arrived, no answer. Motion has been stopped.
        """
        ...

    def reference(self, position: float) -> AxisStatus:
        """Say, on a person's request, that the axis now stands at ``position``; after a reboot."""
        ...

    def reboot(self) -> AxisStatus:
        """Reboot the servo on a person's request, after a hardware error; it is then not referenced."""
        ...

    def stop(self) -> StopReport:
        """Stop now: goal := present; torque as its policy says. Never raises."""
        ...

    def close(self) -> None:
        """Release the port and follow the torque policy. Safe to call twice.

        Raises:
            HardwareError: the torque policy could not be followed.
        """
        ...


class LiveCamera(Protocol):
    """A camera that nobody has calibrated."""

    def connect(self) -> Identity:
        """Open the camera that was meant, lock what the device lets lock, and start draining.

        Raises:
            HardwareError: no such camera, another one, or it gives no pictures.
        """
        ...

    def capture(self, after_s: float) -> Picture:
        """A picture whose exposure began after ``after_s`` on the driver's clock.

        Raises:
            HardwareError: none came in time, or it is frozen.
        """
        ...

    def latest(self) -> Picture | None:
        """The newest picture, however old, for previews."""
        ...

    def close(self) -> None:
        """Release the camera. Safe to call twice."""
        ...
