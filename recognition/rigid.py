"""A rigid transform with all six degrees of freedom, for cameras that do not hang upright."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.geometry import rotation_y

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose6:
    """points -> camera, ``p_cam = rotation p + translation_mm``.

    The rotation reads as Rx(pitch) Rz(roll) Ry(theta): pan first, as on the rig, then the mount's roll and pitch.

    Attributes:
        rotation: ``(3, 3)``, right-handed and orthonormal.
        translation_mm: ``(3,)``.
    """

    rotation: FloatArray = field(repr=False)
    translation_mm: FloatArray

    @property
    def theta_deg(self) -> float:
        """Pan about Y, degrees."""
        return float(np.degrees(np.arctan2(self.rotation[0, 2], self.rotation[0, 0])))

    @property
    def roll_deg(self) -> float:
        """Roll about Z, degrees, in [-90, 90]."""
        return float(np.degrees(np.arcsin(np.clip(-self.rotation[0, 1], -1.0, 1.0))))

    @property
    def pitch_deg(self) -> float:
        """Pitch about X, degrees."""
        return float(np.degrees(np.arctan2(self.rotation[2, 1], self.rotation[1, 1])))

    @property
    def x_mm(self) -> float:
        """Translation along X."""
        return float(self.translation_mm[0])

    @property
    def y_mm(self) -> float:
        """Translation along Y."""
        return float(self.translation_mm[1])

    @property
    def z_mm(self) -> float:
        """Translation along Z."""
        return float(self.translation_mm[2])

    @staticmethod
    def from_angles(
        theta_deg: float, translation_mm: FloatArray, *, roll_deg: float = 0.0, pitch_deg: float = 0.0
    ) -> Pose6:
        """Rx(pitch) Rz(roll) Ry(theta) and a translation ``(3,)``."""
        r, p = np.radians([roll_deg, pitch_deg])
        rz = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
        rx = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
        return Pose6(rx @ rz @ rotation_y(np.radians(theta_deg)), np.asarray(translation_mm, dtype=np.float64))
