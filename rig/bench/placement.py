"""How a gantry's machine coordinates and the pan servo's angle lie in the rig frame: signs and offsets.

How true and how square the axes are is no matter of where they are sent: `recognition.geometry.Mount` applies that.
"""

from __future__ import annotations

from dataclasses import dataclass

from rig.devices import Triple


@dataclass(frozen=True, slots=True)
class AxisPlacement:
    """A `drivers.combined.Placement`: a coordinate in the rig frame is ``offset + sign * machine coordinate``.

    Attributes:
        sign: -1 where an axis counts against the rig frame's direction.
        offset_mm: the place in the rig frame of the machine's zero.
        pan_sign, pan_offset_deg: theta in the rig frame is ``offset + sign * angle of the servo``.
    """

    sign: Triple = (1.0, 1.0, 1.0)
    offset_mm: Triple = (0.0, 0.0, 0.0)
    pan_sign: float = 1.0
    pan_offset_deg: float = 0.0

    def to_rig(self, machine_mm: Triple) -> Triple:
        """The place in the rig frame of machine coordinates, mm."""
        x, y, z = (o + s * m for o, s, m in zip(self.offset_mm, self.sign, machine_mm, strict=True))
        return (x, y, z)

    def to_machine(self, place_mm: Triple) -> Triple:
        """Machine coordinates of a place in the rig frame, mm."""
        x, y, z = ((p - o) * s for p, o, s in zip(place_mm, self.offset_mm, self.sign, strict=True))
        return (x, y, z)

    def to_axis(self, theta_deg: float) -> float:
        """The pan servo's angle at a pan of the rig frame, degrees."""
        return (theta_deg - self.pan_offset_deg) * self.pan_sign

    def to_theta(self, axis_deg: float) -> float:
        """The pan in the rig frame at an angle of the pan servo, degrees."""
        return self.pan_offset_deg + self.pan_sign * axis_deg
