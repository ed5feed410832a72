"""A rig that renders its pictures on demand: the same seed and pose give the same picture; the truth is kept aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, Mount, camera_in_object, camera_in_rig
from rig.errors import InputError, UnreachableError
from rig.hal import AXES, AxisLimits, Frame, RigLimits, RigPose, travel_seconds
from sim_backends.appearance import Sensor
from sim_backends.internals_policy import FixedByZoom, InternalsPolicy
from sim_backends.projection import Internals
from sim_backends.renderer import DEFAULT_SIZE, PartTruth, render, visible_parts
from sim_backends.scene import Scene
from sim_backends.viewpoints import CLEAR_MM, Plan
from sim_backends.walls import walls_of


@dataclass(frozen=True, slots=True)
class Lattice:
    """Steps of the axes, and how many of them around a pose are offered as next views."""

    x_mm: float = 40.0
    y_mm: float = 40.0
    z_mm: float = 40.0
    theta_deg: float = 15.0
    zooms: tuple[float, ...] = (0.0,)
    reach: int = 2


@dataclass(frozen=True, slots=True)
class ViewTruth:
    """What nobody but a scorer may know of a view. The camera is its upright part: the mount's tilt comes on top."""

    camera_in_object: CameraPose
    internals: Internals


class RenderedRig:
    """A ``rig.hal.Rig`` whose pictures are rendered. Frames carry no truth: scorers ask ``truth`` and ``parts``."""

    def __init__(
        self,
        scene: Scene,
        limits: RigLimits,
        offers: Lattice | Sequence[RigPose],
        *,
        internals: InternalsPolicy | None = None,
        seed: int = 0,
        size: tuple[int, int] = DEFAULT_SIZE,
        sensor: Sensor | None = None,
        mount: Mount | None = None,
        start: RigPose | None = None,
        clear_mm: float = CLEAR_MM,
    ) -> None:
        """Set the rig up.

        Args:
            scene: what stands in front of it.
            limits: travel and speeds.
            offers: the poses it can take, or the steps of a lattice within the limits, clear of the object's walls.
            internals: the camera's inside; ``None``: fixed by the zoom, of the given size.
            seed: of noise and changing internals; the same seed and pose give the same picture.
            size: of the pictures, pixels.
            sensor: blur, noise, exposure.
            mount: how the camera hangs; ``None``: perfectly.
            start: where the rig stands at first; ``None``: the first pose, or the lattice's low corner.
            clear_mm: how near the lattice comes to walls.

        Raises:
            InputError: there is no pose at all.
            UnreachableError: a pose lies outside the limits.
        """
        self._scene, self._limits, self._mount, self._clear_mm = scene, limits, mount, clear_mm
        self._tilt = mount.tilt if mount is not None and (mount.roll_deg or mount.pitch_deg) else None
        self._lattice = offers if isinstance(offers, Lattice) else None
        self._poses = () if isinstance(offers, Lattice) else tuple(offers)
        self._policy = internals or FixedByZoom.for_size(size)
        self._seed, self._size, self._sensor = seed, size, sensor or Sensor()
        self._plan = Plan.of(walls_of(scene.object_model))
        self._sequence, self._clock_s = 0, 0.0
        if self._lattice is None and not self._poses:
            raise InputError("a rendered rig needs at least one pose", where="offers", remedy="Give poses or a Lattice")
        self._offered = frozenset(self._poses)
        for pose in self._poses:
            self._check(pose)
        self._pose = start or (self._poses[0] if self._poses else self._home())
        self._check(self._pose)

    @property
    def pose(self) -> RigPose:
        """Where the rig stands."""
        return self._pose

    @property
    def limits(self) -> RigLimits:
        """Travel and speeds."""
        return self._limits

    @property
    def internals_fixed_by_zoom(self) -> bool:
        """True if the same zoom setting always means the same internals."""
        return self._policy.fixed_by_zoom

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        """The given poses, or the lattice's poses around ``near`` (or around where the rig stands)."""
        if self._lattice is None:
            return self._poses
        around = near or self._pose
        steps = range(-self._lattice.reach, self._lattice.reach + 1)
        axes = [
            _lattice_values(getattr(self._limits, axis), getattr(self._lattice, axis), getattr(around, axis), steps)
            for axis in AXES[:-1]
        ]
        zooms = [z for z in self._lattice.zooms if self._limits.zoom.lower <= z <= self._limits.zoom.upper]
        poses = [RigPose(*values) for values in product(*axes, zooms)]
        free = self._free(poses)
        return [pose for pose, good in zip(poses, free, strict=True) if good]

    def nearest(self, wish: RigPose) -> RigPose:
        """The offered pose nearest to a wish, in seconds of travel along each axis.

        Raises:
            UnreachableError: the wish is not finite or outside the limits, or nothing around it is free.
        """
        self._check(wish)
        offers = self.reachable(wish)
        if not offers:
            raise UnreachableError(f"no pose around {wish} is clear of the object. Wish for one further from its walls")
        speeds = np.array([getattr(self._limits, axis).speed_per_s for axis in AXES])
        gaps = (_table(offers) - _table([wish])) / speeds
        return offers[int(np.argmin((gaps**2).sum(axis=1)))]

    def move_to(self, pose: RigPose) -> RigPose:
        """Move at once; the rig's own clock goes on by the time that the move takes.

        Raises:
            UnreachableError: outside the limits, not among the given poses, or too near to a wall.
        """
        self._check(pose)
        if self._poses and pose not in self._offered:
            raise UnreachableError(f"{pose} is not one of the {len(self._poses)} poses. Ask nearest() first")
        if not self._poses and not self._free([pose])[0]:
            raise UnreachableError(f"{pose} is nearer than {self._clear_mm:g} mm to a wall. Ask nearest() first")
        self._clock_s += self.travel_s(self._pose, pose)
        self._pose = pose
        return pose

    def capture(self) -> Frame:
        """Render the picture at the present pose."""
        truth = self.truth(self._pose)
        camera = camera_in_rig(self._pose, self._mount)
        rng = self._rng(self._pose, 1)
        image = render(self._scene, camera, truth.internals, self._size, rng=rng, sensor=self._sensor, tilt=self._tilt)
        self._sequence += 1
        name = f"rendered-{self._sequence:04d}"
        return Frame(image, self._pose, self._pose, name, self._sequence, self._clock_s)

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        """Seconds from one pose to the other, settling and exposure included."""
        return travel_seconds(self._limits, start, end)

    def close(self) -> None:
        """Nothing to release."""

    def __enter__(self) -> RenderedRig:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures, pixels."""
        return self._size

    @property
    def scene(self) -> Scene:
        """For scoring only: what is in front of the rig."""
        return self._scene

    def truth(self, pose: RigPose | None = None) -> ViewTruth:
        """For scoring only: where the camera really is in the object frame, and its internals, at a pose."""
        at = pose or self._pose
        camera = camera_in_object(camera_in_rig(at, self._mount), self._scene.object_in_rig)
        return ViewTruth(camera, self._policy.internals(at.zoom, self._rng(at, 0)))

    def parts(self, pose: RigPose | None = None) -> list[PartTruth]:
        """For scoring only: the parts that a picture taken at a pose really shows."""
        at = pose or self._pose
        camera, internals = camera_in_rig(at, self._mount), self.truth(at).internals
        return visible_parts(self._scene, camera, internals, self._size, tilt=self._tilt)

    def _home(self) -> RigPose:
        """The lattice's pose nearest to the lower ends of x and z, the middle of the others."""
        at = {axis: getattr(self._limits, axis) for axis in AXES}
        middle = {axis: (limit.lower + limit.upper) / 2 for axis, limit in at.items()}
        return self.nearest(RigPose(**{**middle, "x_mm": at["x_mm"].lower, "z_mm": at["z_mm"].lower}))

    def _rng(self, pose: RigPose, purpose: int) -> np.random.Generator:
        """A generator that depends on the seed and the pose (to a micrometre) only."""
        key = [round(getattr(pose, axis) * 1000) % 2**32 for axis in AXES]
        return np.random.default_rng([self._seed, purpose, *key])

    def _free(self, poses: Sequence[RigPose]) -> npt.NDArray[np.bool_]:
        if not poses:
            return np.zeros(0, dtype=bool)
        to_object = self._scene.object_in_rig.inverse()
        centres = np.array([camera_in_rig(pose, self._mount).centre_mm for pose in poses])
        in_object = centres @ to_object.rotation.T + to_object.translation_mm
        return self._plan.free(in_object[:, [0, 2]], self._clear_mm)

    def _check(self, pose: RigPose) -> None:
        for axis in AXES:
            value, limit = float(getattr(pose, axis)), getattr(self._limits, axis)
            if not (np.isfinite(value) and limit.lower <= value <= limit.upper):
                raise UnreachableError(
                    f"{axis} = {value:g} is outside {limit.lower:g} .. {limit.upper:g}. Choose a pose within the limits"
                )


def _lattice_values(limit: AxisLimits, step: float, near: float, steps: range) -> list[float]:
    """The lattice's values of one axis (counted from its lower limit) around ``near``, within the limit."""
    home = round((near - limit.lower) / step)
    values = [limit.lower + (home + k) * step for k in steps]
    return [value for value in values if limit.lower <= value <= limit.upper + 1e-9]


def _table(poses: Sequence[RigPose]) -> npt.NDArray[np.float64]:
    return np.array([[getattr(pose, axis) for axis in AXES] for pose in poses])
