"""How a gantry's machine coordinates lie in the rig frame: sign, scale, offset, and axes that are not quite square."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rig.devices import Triple


@dataclass(frozen=True, slots=True)
class AffinePlacement:
    """A `drivers.combined.Placement`.

    The axes run along unit vectors e1, e2, e3: e1 is the rig frame's X, e2 lies in its X-Y plane. A place in the rig
    frame is ``offset + sum_k sign_k scale_k machine_k e_k``.

    Attributes:
        sign: -1 where an axis counts against the rig frame's direction.
        scale: true millimetres for one that the controller counts.
        offset_mm: the place in the rig frame of the machine's zero.
        squareness_deg: by how much the angles x-y, x-z, y-z between the axes' positive directions exceed 90 degrees.
        pan_sign, pan_offset_deg: theta in the rig frame is ``offset + sign * angle of the servo``.
    """

    sign: Triple = (1.0, 1.0, 1.0)
    scale: Triple = (1.0, 1.0, 1.0)
    offset_mm: Triple = (0.0, 0.0, 0.0)
    squareness_deg: Triple = (0.0, 0.0, 0.0)
    pan_sign: float = 1.0
    pan_offset_deg: float = 0.0

    def to_rig(self, machine_mm: Triple) -> Triple:
        """The place in the rig frame of machine coordinates, mm."""
        u, v, w = (m * s * k for m, s, k in zip(machine_mm, self.sign, self.scale, strict=True))
        (y1, y2), (z1, z2, z3) = self._directions()
        x0, y0, z0 = self.offset_mm
        return (x0 + u + v * y1 + w * z1, y0 + v * y2 + w * z2, z0 + w * z3)

    def to_machine(self, place_mm: Triple) -> Triple:
        """Machine coordinates of a place in the rig frame, mm."""
        (y1, y2), (z1, z2, z3) = self._directions()
        dx, dy, dz = (p - o for p, o in zip(place_mm, self.offset_mm, strict=True))
        w = dz / z3
        v = (dy - w * z2) / y2
        u = dx - v * y1 - w * z1
        x, y, z = (value / (s * k) for value, s, k in zip((u, v, w), self.sign, self.scale, strict=True))
        return (x, y, z)

    def to_axis(self, theta_deg: float) -> float:
        """The pan servo's angle at a pan of the rig frame, degrees."""
        return (theta_deg - self.pan_offset_deg) * self.pan_sign

    def to_theta(self, axis_deg: float) -> float:
        """The pan in the rig frame at an angle of the pan servo, degrees."""
        return self.pan_offset_deg + self.pan_sign * axis_deg

    def _directions(self) -> tuple[tuple[float, float], Triple]:
        """e2 (without its third coordinate, 0) and e3."""
        xy, xz, yz = (math.sin(math.radians(angle)) for angle in self.squareness_deg)
        y2 = math.sqrt(1.0 - xy * xy)
        z2 = -(yz + xy * xz) / y2
        return (-xy, y2), (-xz, z2, math.sqrt(1.0 - xz * xz - z2 * z2))
