"""The known moves of a scan, and what they leave open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.geometry import Mount
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]

_STILL_MM, _STILL_DEG = 1e-3, 1e-2


@dataclass(frozen=True, slots=True)
class Moves:
    """Where the rig stood for each picture. ``table`` ``(V, 4)``: theta (radians), and x, y, z of the carriage in mm.

    Scale and squareness of the axes are applied already; lever arm, pan zero, roll and pitch are not.
    """

    table: FloatArray = field(repr=False)

    @staticmethod
    def of(poses: Sequence[RigPose], axes: Mount | None = None) -> Moves:
        """From rig poses, with the axes' scale and squareness of a mount."""
        carriage = np.array([[p.x_mm, p.y_mm, p.z_mm] for p in poses]) @ (axes or Mount()).axes.T
        return Moves(np.column_stack([np.radians([p.theta_deg for p in poses]), carriage]))

    @property
    def pan_span_deg(self) -> float:
        """From the lowest pan to the highest."""
        return float(np.degrees(np.ptp(self.table[:, 0])))

    @property
    def pans(self) -> bool:
        """Whether the rotary moved at all."""
        return self.pan_span_deg > _STILL_DEG

    @property
    def moved(self) -> tuple[bool, bool, bool]:
        """Whether x, y, z moved at all."""
        x, y, z = (bool(span > _STILL_MM) for span in np.ptp(self.table[:, 1:], axis=0))
        return x, y, z
