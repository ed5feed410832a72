"""What the rest of the system knows of a rig: value types and narrow Protocols.

Frames and units: the rig frame is right-handed, X right, Y down, Z forward, in millimetres; ``theta_deg`` is the
rotation about Y in degrees; zoom is a setting from 0 (widest) to 1 (longest), never a focal length.
This module imports nothing of the project.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
"""``(h, w)`` grey or ``(h, w, 3)`` BGR, 8 bits."""

AXES = ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom")
"""The axes of a pose, in order: the fields of `RigPose`, and those of `RigLimits` that are `AxisLimits`."""


@dataclass(frozen=True, slots=True)
class RigPose:
    """Where the rig stands: the camera mount's position in the rig frame, its pan, and the zoom setting."""

    x_mm: float
    y_mm: float
    z_mm: float
    theta_deg: float
    zoom: float = 0.0


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture and where it was taken.

    ``rig_pose`` is measured (read back), ``commanded`` what was asked for. ``exposed_at_s`` is monotonic time.
    """

    image: Image = field(repr=False)
    rig_pose: RigPose
    commanded: RigPose
    name: str
    sequence: int
    exposed_at_s: float = 0.0


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Travel of one axis, both ends reachable, in its unit (mm, degrees, or zoom 0..1), and its speed per second."""

    lower: float
    upper: float
    speed_per_s: float


@dataclass(frozen=True, slots=True)
class RigLimits:
    """Travel and speeds of all axes; ``settle_s`` is waited after each move, ``exposure_s`` taken by each picture."""

    x_mm: AxisLimits
    y_mm: AxisLimits
    z_mm: AxisLimits
    theta_deg: AxisLimits
    zoom: AxisLimits
    settle_s: float = 0.0
    exposure_s: float = 0.0


class Gantry(Protocol):
    """Three linear axes."""

    def move_to(self, x_mm: float, y_mm: float, z_mm: float) -> tuple[float, float, float]:
        """Move, wait until done, and return the position read back, mm."""
        ...


class Rotary(Protocol):
    """The rotation about Y."""

    def rotate_to(self, theta_deg: float) -> float:
        """Rotate, wait until done, and return the angle read back, degrees."""
        ...


class Zoom(Protocol):
    """The zoom ring, 0..1."""

    def zoom_to(self, zoom: float) -> float:
        """Set the zoom, wait until done, and return the setting read back."""
        ...


class Camera(Protocol):
    """A camera that nobody has calibrated."""

    def capture(self) -> Image:
        """Return a picture that was exposed after this call."""
        ...


@runtime_checkable
class Rig(Protocol):
    """A whole rig, real or mock. A context manager: leaving it releases the devices."""

    @property
    def pose(self) -> RigPose:
        """Where the rig stands, as read back."""
        ...

    @property
    def limits(self) -> RigLimits:
        """Travel and speeds."""
        ...

    @property
    def internals_fixed_by_zoom(self) -> bool:
        """True if the rig vouches that the camera's internals are the same whenever the zoom setting is the same."""
        ...

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        """Poses that the rig offers as next views: all cells of a grid, or a lattice within limits around ``near``."""
        ...

    def nearest(self, wish: RigPose) -> RigPose:
        """Snap a wish to the nearest reachable pose.

        Raises:
            UnreachableError: the wish is not finite or outside the limits.
        """
        ...

    def move_to(self, pose: RigPose) -> RigPose:
        """Move to a reachable pose, wait until settled, and return the pose read back.

        Raises:
            UnreachableError: the pose is not reachable; names axis, value and limit.
        """
        ...

    def capture(self) -> Frame:
        """Take a picture at the present pose."""
        ...

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        """Seconds from one pose to the other, settling and exposure included."""
        ...

    def close(self) -> None:
        """Release the devices. Safe to call twice."""
        ...

    def __enter__(self) -> Rig: ...

    def __exit__(self, *exc: Any) -> None: ...


def travel_seconds(limits: RigLimits, start: RigPose, end: RigPose) -> float:
    """Seconds of travel when all axes move at the same time at their own speed, plus settling and exposure."""
    longest = max(abs(getattr(end, axis) - getattr(start, axis)) / getattr(limits, axis).speed_per_s for axis in AXES)
    return float(longest + limits.settle_s + limits.exposure_s)
