"""The one module that owns frames and pose conversions.

Conventions (all right-handed, X right, Y down, Z forward; millimetres, degrees at interfaces, radians inside):

* ``Ry(theta) = [[c, 0, s], [0, 1, 0], [-s, 0, c]]``.
* A camera at centre ``c`` with pan ``theta`` in some frame sees ``p_cam = Ry(theta) (p - c)``.
* The paper's pose <theta, tx, ty, tz> is the transform part -> camera, ``p_cam = Ry(theta) p + t``.
* An object's placement in the rig frame is ``p_rig = Ry(phi) p_object + d``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]


def rotation_y(theta_rad: FloatArray | float) -> FloatArray:
    """``(..., 3, 3)`` rotation about Y for angles ``(...)`` in radians (design §2)."""
    theta = np.asarray(theta_rad, dtype=np.float64)
    c, s, zero, one = np.cos(theta), np.sin(theta), np.zeros_like(theta), np.ones_like(theta)
    rows = [np.stack(r, axis=-1) for r in ([c, zero, s], [zero, one, zero], [-s, zero, c])]
    return np.asarray(np.stack(rows, axis=-2))


def wrap_deg(angle_deg: float) -> float:
    """The same angle in [-180, 180)."""
    return float((angle_deg + 180.0) % 360.0 - 180.0)


@dataclass(frozen=True, slots=True)
class Pose4:
    """Four degrees of freedom: a rotation about Y and a translation. What it maps from and to, its user's name tells.

    As the paper's pose it maps ``p_cam = Ry(theta_deg) p + (x, y, z)``.
    """

    theta_deg: float
    x_mm: float
    y_mm: float
    z_mm: float

    @property
    def translation_mm(self) -> FloatArray:
        """``(3,)``."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    @property
    def rotation(self) -> FloatArray:
        """``(3, 3)``."""
        # Made by hand: one at a time, `rotation_y` takes ten times as long.
        theta = math.radians(self.theta_deg)
        c, s = math.cos(theta), math.sin(theta)
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

    @staticmethod
    def of(theta_deg: float, translation_mm: FloatArray) -> Pose4:
        """Build from an angle and a ``(3,)`` translation; the angle is wrapped."""
        x, y, z = (float(v) for v in translation_mm)
        return Pose4(wrap_deg(float(theta_deg)), x, y, z)

    def inverse(self) -> Pose4:
        """The transform back."""
        return Pose4.of(-self.theta_deg, -(self.rotation.T @ self.translation_mm))

    def __matmul__(self, other: Pose4) -> Pose4:
        """``T_a_b @ T_b_c = T_a_c``."""
        return Pose4.of(self.theta_deg + other.theta_deg, self.rotation @ other.translation_mm + self.translation_mm)


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Where a camera is in some frame: its centre, mm, and its pan, degrees (``p_cam = Ry(theta) (p - centre)``)."""

    theta_deg: float
    x_mm: float
    y_mm: float
    z_mm: float

    @property
    def centre_mm(self) -> FloatArray:
        """``(3,)``."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    def to_camera(self) -> Pose4:
        """The transform frame -> camera."""
        rotation = rotation_y(np.radians(self.theta_deg))
        return Pose4.of(self.theta_deg, -(rotation @ self.centre_mm))

    @staticmethod
    def from_to_camera(to_camera: Pose4) -> CameraPose:
        """The camera whose frame -> camera transform is given."""
        centre = -(to_camera.rotation.T @ to_camera.translation_mm)
        return CameraPose(to_camera.theta_deg, *(float(v) for v in centre))


@dataclass(frozen=True, slots=True)
class Mount:
    """How the camera hangs on the rig: its centre from the rotation axis, in the frame that turns with the pan, mm."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0


def camera_in_rig(rig_pose: RigPose, mount: Mount | None = None) -> CameraPose:
    """The camera's pose in the rig frame: the rig's position plus the lever arm rotated with theta (design §2)."""
    centre = np.array([rig_pose.x_mm, rig_pose.y_mm, rig_pose.z_mm])
    if mount is not None:
        arm = np.array([mount.x_mm, mount.y_mm, mount.z_mm])
        # Ry(theta) maps rig -> camera, so the arm, fixed in the turning frame, goes back by its transpose.
        centre = centre + rotation_y(np.radians(rig_pose.theta_deg)).T @ arm
    return CameraPose(rig_pose.theta_deg, *(float(v) for v in centre))


def camera_in_object(camera: CameraPose, object_in_rig: Pose4) -> CameraPose:
    """The camera in the object frame, from its pose in the rig frame and the object's placement (object -> rig)."""
    return CameraPose.from_to_camera(camera.to_camera() @ object_in_rig)


def project(points_cam: FloatArray, internals: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of camera-frame points ``(..., 3)`` for internals ``(fx, fy, u0, v0)``."""
    fx, fy, u0, v0 = internals
    z = points_cam[..., 2]
    return np.asarray(np.stack([fx * points_cam[..., 0] / z + u0, fy * points_cam[..., 1] / z + v0], axis=-1))
