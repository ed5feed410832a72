"""What an emulated camera sees from a rig pose: a rendered scene, or the nearest picture of an image grid."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from recognition.geometry import Mount, camera_in_rig
from rig.hal import AXES, Image, RigPose
from rig.imagegrid import GridFrame, ImageGrid
from sim_backends.appearance import Sensor
from sim_backends.image_grid_rig import ZOOM_AS_DEG
from sim_backends.internals_policy import FixedByZoom, InternalsPolicy
from sim_backends.renderer import DEFAULT_SIZE, Scene, render

Pictures = Callable[[RigPose], Image]
"""The picture without noise at a rig pose; all of one size."""

_KEPT = 8
_STEP = 1e-3
"""Poses that differ by less (mm, degrees; zoom by a thousandth of it) show the same: a rig at rest is drawn once."""


def scene_pictures(
    scene: Scene,
    *,
    size: tuple[int, int] = DEFAULT_SIZE,
    internals: InternalsPolicy | None = None,
    mount: Mount | None = None,
    seed: int = 0,
) -> Pictures:
    """Pictures rendered of a scene, from anywhere.

    Args:
        scene: what stands in front of the rig.
        size: of the pictures, pixels.
        internals: the camera's inside; ``None``: fixed by the zoom.
        mount: how the camera hangs.
        seed: of internals that change.
    """
    policy, sensor = internals or FixedByZoom.for_size(size), Sensor(noise_sd=0.0)

    @lru_cache(maxsize=_KEPT)
    def drawn(key: tuple[int, ...]) -> Image:
        pose = _pose_of(key)
        rng = np.random.default_rng([seed, *(k % 2**32 for k in key)])
        inside = policy.internals(pose.zoom, rng)
        return render(scene, camera_in_rig(pose, mount), inside, size, rng=rng, sensor=sensor)

    return lambda pose: drawn(_key_of(pose))


def grid_pictures(grid: ImageGrid, *, distance_mm: float = 1000.0) -> Pictures:
    """The grid's picture nearest to the pose, measured as the mock rig does.

    Args:
        grid: the pictures; each one's digest is checked when it is loaded.
        distance_mm: of what is looked at, roughly; says how many millimetres count like a degree.
    """
    mm_per_deg = math.radians(1.0) * distance_mm
    weights = np.array([1.0, 1.0, 1.0, mm_per_deg, mm_per_deg * ZOOM_AS_DEG])
    table = np.array([[getattr(frame.pose, axis) for axis in AXES] for frame in grid.frames])

    @lru_cache(maxsize=_KEPT)
    def loaded(index: int) -> Image:
        frame: GridFrame = grid.frames[index]
        return grid.load(frame)

    def nearest(pose: RigPose) -> Image:
        gaps = table - np.array([getattr(pose, axis) for axis in AXES])
        gaps[:, 3] = (gaps[:, 3] + 180.0) % 360.0 - 180.0
        return loaded(int(np.argmin(np.linalg.norm(gaps * weights, axis=1))))

    return nearest


def _key_of(pose: RigPose) -> tuple[int, ...]:
    return tuple(round(getattr(pose, axis) / (_STEP * _STEP if axis == "zoom" else _STEP)) for axis in AXES)


def _pose_of(key: tuple[int, ...]) -> RigPose:
    return RigPose(*(k * (_STEP * _STEP if axis == "zoom" else _STEP) for k, axis in zip(key, AXES, strict=True)))
