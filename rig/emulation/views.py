"""What an emulated bench's camera looks at: an object of a model base in front of the gantry, or an image grid."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from recognition.geometry import Pose4, rotation_y
from rig.bench import BenchConfig
from rig.emulation.emulable import emulable
from rig.imagegrid import ImageGrid
from sim_backends.camera_pictures import Pictures, grid_pictures, scene_pictures
from sim_backends.internals_policy import ChangingInternals, FixedByZoom
from sim_backends.renderer import DEFAULT_SIZE
from sim_backends.viewpoints import CLEAR_MM, facing_deg
from sim_backends.walls import walls_of

if TYPE_CHECKING:
    from drivers.camera_settings import CameraSettings
    from recognition.modelbase import ModelBase
    from sim_backends.scene import Scene

_STAND_OFF = 8.0
"""In heights of a part: each part is then large enough to be told, and several are in view."""
_LEAST_TURN_DEG, _MOST_TURN_DEG, _SHIFT_MM = 4.0, 10.0, 30.0


def object_view(config: BenchConfig, scene: Scene, *, seed: int = 0) -> Pictures:
    """Rendered pictures of a scene, of the bench's picture size, through its camera on its mount.

    The internals change from view to view unless the bench vouches that they do not.
    """
    size = picture_size(config)
    inside = FixedByZoom.for_size(size)
    fixed = config.file.camera.internals == "fixed_by_zoom"
    policy = inside if fixed else ChangingInternals(inside, f_sd=0.03, centre_sd_px=0.012 * size[0])
    return scene_pictures(scene, size=size, internals=policy, mount=config.mount, seed=seed)


def grid_view(config: BenchConfig, grid: ImageGrid) -> Pictures:
    """The grid's picture nearest to where the rig is."""
    bounds = config.bounds()
    return grid_pictures(grid, distance_mm=math.sqrt(bounds.distance_min_mm * bounds.distance_max_mm))


def picture_size(config: BenchConfig) -> tuple[int, int]:
    """Width and height of the emulated camera's pictures, pixels."""
    settings: CameraSettings = config.devices["camera"].settings  # type: ignore[assignment]  # `emulable` has seen to it
    return settings.size or DEFAULT_SIZE


def stand_in_front(config: BenchConfig, model_base: ModelBase, object_id: str, *, seed: int = 0) -> Scene:
    """An object of a model base in front of the gantry: the wall with most parts faces it, turned a little.

    Looks, turn and a small shift are drawn from the seed.

    Raises:
        InputError: there is no such object, or the bench cannot be emulated (`emulable`).
    """
    from sim_backends.simulate import draw_scene

    emulable(config)
    scene = draw_scene(model_base, object_id, seed)
    wall = max(walls_of(scene.object_model), key=lambda one: len(one.parts))
    rng = np.random.default_rng([seed, 2])
    turn_deg = float(rng.uniform(_LEAST_TURN_DEG, _MOST_TURN_DEG) * rng.choice([-1.0, 1.0]))
    phi_deg = facing_deg(wall) + turn_deg
    swing_mm = 0.5 * wall.size_mm[0] * math.sin(math.radians(abs(turn_deg)))
    target = _in_front(config, _STAND_OFF * scene.typical_mm, CLEAR_MM + swing_mm)
    target += np.append(rng.uniform(-_SHIFT_MM, _SHIFT_MM, 2), 0.0)
    x, y, z = (float(v) for v in target - rotation_y(math.radians(phi_deg)) @ wall.corners_mm.mean(axis=0))
    return replace(scene, object_in_rig=Pose4(phi_deg, x, y, z))


def _in_front(config: BenchConfig, stand_off_mm: float, clear_mm: float) -> npt.NDArray[np.float64]:
    """The place ``(3,)`` before the middle of the travel where the wall's middle comes, rig frame, mm."""
    travel, arm = emulable(config).travel, config.mount
    middle = np.array([(axis.lower + axis.upper) / 2.0 for axis in (travel.x_mm, travel.y_mm, travel.z_mm)])
    half_mm = (travel.z_mm.upper - travel.z_mm.lower) / 2.0
    reach_mm = math.hypot(arm.x_mm, arm.y_mm, arm.z_mm)
    return np.asarray(middle + np.array([0.0, 0.0, max(stand_off_mm, half_mm + clear_mm) + reach_mm]))
