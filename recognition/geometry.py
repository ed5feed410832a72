"""The one module that owns frames and pose conversions.

Conventions (all right-handed, X right, Y down, Z forward; millimetres, degrees at interfaces, radians inside):

* ``Ry(theta) = [[c, 0, s], [0, 1, 0], [-s, 0, c]]``.
* A camera at centre ``c`` with pan ``theta`` in some frame sees ``p_cam = Ry(theta) (p - c)``.
* The paper's pose <theta, tx, ty, tz> is the transform part -> camera, ``p_cam = Ry(theta) p + t``.
* An object's placement in the rig frame is ``p_rig = Ry(phi) p_object + d``.
* A mount that is not perfect (`Mount`) sees ``p_cam = Rx(pitch) Rz(roll) Ry(theta + pan zero) (p - c)`` from
  ``c = S (x, y, z) + Ry(theta)^T arm``, S being the scale and squareness of the gantry's axes. A `CameraPose` is its
  upright part; the roll and pitch are the same in every view (``Mount.tilt``).
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
    """How the camera hangs on the rig, and how straight the rig's axes are. The default is perfect.

    Attributes:
        x_mm, y_mm, z_mm: lever arm: the camera's centre from the rotation axis, in the frame that turns with the pan
            and coincides with the rig's at pan 0.
        pan_zero_deg: the camera's pan when the rotary stands at 0.
        roll_deg, pitch_deg: small turns of the camera about its own Z and X axis: Rx(pitch) Rz(roll) after the pan.
        x_scale, y_scale, z_scale: true millimetres per millimetre that the axis tells.
        xy_deg, xz_deg, yz_deg: squareness: by how much the angle between two axes falls short of 90 degrees. X keeps
            its direction, Y stays in the XY plane.
    """

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    pan_zero_deg: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    x_scale: float = 1.0
    y_scale: float = 1.0
    z_scale: float = 1.0
    xy_deg: float = 0.0
    xz_deg: float = 0.0
    yz_deg: float = 0.0

    @property
    def arm_mm(self) -> FloatArray:
        """``(3,)`` lever arm in the turning frame."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    @property
    def axes(self) -> FloatArray:
        """``(3, 3)`` S: what the axes tell -> rig frame, mm. Its columns: the axes' directions times their scales."""
        xy, xz, yz = np.sin(np.radians([self.xy_deg, self.xz_deg, self.yz_deg]))
        upright = np.sqrt(1.0 - xy**2)
        across = (yz - xz * xy) / upright
        # Unit directions whose scalar products are the sines of the angles that are missing to 90 degrees.
        directions = np.array([[1.0, xy, xz], [0.0, upright, across], [0.0, 0.0, np.sqrt(1.0 - xz**2 - across**2)]])
        return directions * (self.x_scale, self.y_scale, self.z_scale)

    @property
    def tilt(self) -> FloatArray:
        """``(3, 3)`` Rx(pitch) Rz(roll): upright camera -> camera."""
        (c, d), (s, t) = (f(np.radians([self.roll_deg, self.pitch_deg])) for f in (np.cos, np.sin))
        return np.array([[c, -s, 0.0], [d * s, d * c, -t], [t * s, t * c, d]])


def camera_in_rig(rig_pose: RigPose, mount: Mount | None = None) -> CameraPose:
    """The (upright part of the) camera's pose in the rig frame; the mount's tilt comes on top (design §2)."""
    centre = np.array([rig_pose.x_mm, rig_pose.y_mm, rig_pose.z_mm])
    if mount is None:
        return CameraPose(rig_pose.theta_deg, *(float(v) for v in centre))
    # Ry(theta) maps rig -> turning frame, so the arm, fixed in the turning frame, goes back by its transpose.
    centre = mount.axes @ centre + rotation_y(np.radians(rig_pose.theta_deg)).T @ mount.arm_mm
    return CameraPose(rig_pose.theta_deg + mount.pan_zero_deg, *(float(v) for v in centre))


def rig_pose_for(camera: CameraPose, mount: Mount | None = None, zoom: float = 0.0) -> RigPose:
    """What the rig must be told so that the camera is there: the inverse of `camera_in_rig`."""
    if mount is None:
        return RigPose(camera.x_mm, camera.y_mm, camera.z_mm, camera.theta_deg, zoom)
    theta_deg = camera.theta_deg - mount.pan_zero_deg
    carriage = camera.centre_mm - rotation_y(np.radians(theta_deg)).T @ mount.arm_mm
    x, y, z = (float(v) for v in np.linalg.solve(mount.axes, carriage))
    return RigPose(x, y, z, theta_deg, zoom)


def camera_in_object(camera: CameraPose, object_in_rig: Pose4) -> CameraPose:
    """The camera in the object frame, from its pose in the rig frame and the object's placement (object -> rig)."""
    return CameraPose.from_to_camera(camera.to_camera() @ object_in_rig)


def project(points_cam: FloatArray, internals: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of camera-frame points ``(..., 3)`` for internals ``(fx, fy, u0, v0)``."""
    fx, fy, u0, v0 = internals
    z = points_cam[..., 2]
    return np.asarray(np.stack([fx * points_cam[..., 0] / z + u0, fy * points_cam[..., 1] / z + v0], axis=-1))
