"""What all devices of a rig say of themselves, in one value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.devices import AxisStatus, GantryStatus, Motion
from rig.hal import RigPose

PAN, ZOOM = "theta_deg", "zoom"
NAMES = {PAN: "pan", ZOOM: "zoom"}


@dataclass(frozen=True, slots=True)
class RigStatus:
    """All devices as last read; what does not answer is ``None`` and named in ``mute``.

    Attributes:
        gantry: of the gantry.
        axes: of the pan (``theta_deg``) and the zoom ring (``zoom``), where the rig has them and they answer.
        pose: in the rig frame; ``None`` unless every position is known.
        homed: the gantry is homed and every axis is referenced.
        read_at_s: when the oldest of these was read.
        mute: who did not answer, and what became of asking.
    """

    gantry: GantryStatus | None
    axes: Mapping[str, AxisStatus]
    pose: RigPose | None
    homed: bool
    read_at_s: float
    mute: tuple[str, ...] = ()

    @property
    def troubles(self) -> tuple[str, ...]:
        """What is wrong, for people, by device."""
        gantry = [] if self.gantry is None else [("gantry", self.gantry.trouble)]
        told = [*gantry, *((NAMES[axis], status.trouble) for axis, status in self.axes.items())]
        return (*self.mute, *(f"{name}: {trouble}" for name, trouble in told if trouble))

    @property
    def motions(self) -> dict[str, Motion]:
        """What every device that answers says that it is doing."""
        gantry = {} if self.gantry is None else {"gantry": self.gantry.motion}
        return gantry | {NAMES[axis]: status.motion for axis, status in self.axes.items()}
