"""Projects planar polygons through a camera with any internals: near-plane and frame clipping, one radial term."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, Pose4
from rig.errors import InputError

FloatArray = npt.NDArray[np.float64]

NEAR_MM = 1.0
"""Nothing nearer than this to the camera's plane is drawn."""

_GUARD_PX = 8.0  # polygons are cut this far outside the frame, so that the cut is never seen
_CHORD_PX = 12.0  # a straight edge bent by the radial term is drawn as chords of this length (error < 0.01 px)


@dataclass(frozen=True, slots=True)
class Internals:
    """A camera's inside: focal lengths and principal point in pixels, and one radial term.

    ``u = fx x (1 + k1 r^2) + u0``, ``v = fy y (1 + k1 r^2) + v0`` with x, y the normalised coordinates and
    ``r^2 = x^2 + y^2``. Pixel (0, 0) is the centre of the top-left pixel.
    """

    fx: float
    fy: float
    u0: float
    v0: float
    k1: float = 0.0

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.u0, self.v0, self.k1)
        if not (np.all(np.isfinite(values)) and self.fx > 0 and self.fy > 0):
            raise InputError(
                f"internals {values} are not usable", where="internals", remedy="Give finite numbers and fx, fy > 0"
            )

    def pixels(self, points_cam: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of camera-frame points ``(..., 3)`` with z > 0."""
        normalised = points_cam[..., :2] / points_cam[..., 2:]
        return self.distort(normalised)

    def distort(self, normalised: FloatArray, r2_max: float = np.inf) -> FloatArray:
        """Pixels ``(..., 2)`` of normalised coordinates ``(..., 2)``; the radial term stops growing at ``r2_max``."""
        if self.k1:
            r2 = np.minimum((normalised**2).sum(axis=-1, keepdims=True), r2_max)
            normalised = normalised * (1.0 + self.k1 * r2)
        return np.asarray(normalised * (self.fx, self.fy) + (self.u0, self.v0))

    def undistort(self, pixels: FloatArray) -> FloatArray:
        """Normalised coordinates ``(..., 2)`` of pixels ``(..., 2)``.

        Raises:
            InputError: the radial term folds the picture back before these pixels.
        """
        bent = (pixels - (self.u0, self.v0)) / (self.fx, self.fy)
        if not self.k1:
            return np.asarray(bent)
        r_bent = np.linalg.norm(bent, axis=-1, keepdims=True)
        if self.k1 < 0 and r_bent.max() > 0.95 * (2.0 / 3.0) / np.sqrt(-3.0 * self.k1):
            raise InputError(
                f"radial term k1 = {self.k1:g} folds the picture back at its corners",
                where="internals",
                remedy="Use a weaker radial term or a longer focal length",
            )
        r = r_bent.copy()
        for _ in range(12):  # Newton; converges from below for both signs inside the range checked above
            r -= (r + self.k1 * r**3 - r_bent) / (1.0 + 3.0 * self.k1 * r**2)
        return np.asarray(bent * (r / np.maximum(r_bent, 1e-12)))


@dataclass(frozen=True)
class View:
    """One camera looking at one object: all that is needed to put the object's points into the picture.

    Attributes:
        to_upright: object -> upright camera.
        internals: the camera's inside.
        size: width and height of the picture, pixels.
        tilt: ``(3, 3)`` upright camera -> camera: the mount's roll and pitch; ``None``: it hangs upright.
    """

    to_upright: Pose4
    internals: Internals
    size: tuple[int, int]
    tilt: FloatArray | None = None

    @staticmethod
    def of(
        camera: CameraPose,
        object_in_rig: Pose4,
        internals: Internals,
        size: tuple[int, int],
        tilt: FloatArray | None = None,
    ) -> View:
        """The view of an object placed in the rig frame by a camera posed in the rig frame."""
        return View(camera.to_camera() @ object_in_rig, internals, size, tilt)

    @cached_property
    def rotation(self) -> FloatArray:
        """``(3, 3)`` object -> camera."""
        upright = self.to_upright.rotation
        return upright if self.tilt is None else np.asarray(self.tilt @ upright)

    @cached_property
    def translation_mm(self) -> FloatArray:
        """``(3,)`` the object's origin in the camera frame."""
        upright = self.to_upright.translation_mm
        return upright if self.tilt is None else np.asarray(self.tilt @ upright)

    @cached_property
    def centre_mm(self) -> FloatArray:
        """``(3,)`` camera centre in the object frame."""
        return np.asarray(-(self.rotation.T @ self.translation_mm))

    @cached_property
    def _bounds(self) -> tuple[float, float, float, float]:
        """Smallest and largest normalised x and y that the picture (plus a guard band) can show."""
        w, h = self.size
        left, top, right, bottom = -_GUARD_PX, -_GUARD_PX, w - 1 + _GUARD_PX, h - 1 + _GUARD_PX
        along_x, along_y = np.linspace(left, right, 9), np.linspace(top, bottom, 9)
        border = np.concatenate(
            [np.stack([along_x, np.full(9, v)], -1) for v in (top, bottom)]
            + [np.stack([np.full(9, u), along_y], -1) for u in (left, right)]
        )
        seen = self.internals.undistort(border)
        (x0, y0), (x1, y1) = seen.min(axis=0), seen.max(axis=0)
        return float(x0), float(x1), float(y0), float(y1)

    @cached_property
    def _r2_max(self) -> float:
        x0, x1, y0, y1 = self._bounds
        return float(1.1 * (max(x0**2, x1**2) + max(y0**2, y1**2)))

    def in_camera(self, points_mm: FloatArray) -> FloatArray:
        """Camera-frame points ``(..., 3)`` of object-frame points ``(..., 3)``, mm."""
        return np.asarray(points_mm @ self.rotation.T + self.translation_mm)

    def pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of object-frame points ``(..., 3)``; NaN for points behind the near plane.

        Exact wherever the picture can show the point; far outside the frame the radial term is held constant,
        because a polynomial lens model folds back there.
        """
        cam = self.in_camera(points_mm)
        z = np.where(cam[..., 2:] >= NEAR_MM, cam[..., 2:], np.nan)
        return self.internals.distort(cam[..., :2] / z, self._r2_max)

    def polygon(self, corners_mm: FloatArray) -> FloatArray | None:
        """The outline ``(m, 2)`` in pixels of a planar polygon ``(n, 3)``, cut to the frame; ``None`` if out of view.

        Edges bent by the radial term come as short chords. Non-convex polygons may get edges of zero area along the
        cut, which the coverage of ``sim_backends.coverage`` cancels.
        """
        cam = self.in_camera(corners_mm)
        x0, x1, y0, y1 = self._bounds
        planes = np.array([[0, 0, 1], [1, 0, -x0], [-1, 0, x1], [0, 1, -y0], [0, -1, y1]], dtype=np.float64)
        offsets = np.array([NEAR_MM, 0, 0, 0, 0])
        side = cam @ planes.T - offsets
        if np.any(side.max(axis=0) <= 0):
            return None
        for index in np.flatnonzero(side.min(axis=0) < 0):
            cam = _clip(cam, planes[index], float(offsets[index]))
            if len(cam) < 3:
                return None
        flat = cam[:, :2] / cam[:, 2:]
        if self.internals.k1:
            flat = _subdivide(flat, _CHORD_PX / max(self.internals.fx, self.internals.fy))
        return self.internals.distort(flat)


def _clip(polygon: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """The part of a polygon ``(n, 3)`` where ``normal . p >= offset`` (Sutherland and Hodgman)."""
    side = polygon @ normal - offset
    kept: list[FloatArray] = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if side[i] >= 0:
            kept.append(polygon[i])
        if (side[i] >= 0) != (side[j] >= 0):
            t = side[i] / (side[i] - side[j])
            kept.append(polygon[i] + t * (polygon[j] - polygon[i]))
    return np.array(kept).reshape(-1, 3)


def _subdivide(polygon: FloatArray, step: float) -> FloatArray:
    """The polygon ``(n, 2)`` with points added so that no edge is longer than ``step``."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    counts = np.maximum(1, np.ceil(np.linalg.norm(edges, axis=1) / step).astype(int))
    start = np.repeat(np.arange(len(polygon)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(polygon[start] + (within / counts[start])[:, None] * edges[start])
