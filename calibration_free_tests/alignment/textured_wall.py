"""A rendered scan of a textured wall with a few windows, from a rig whose camera hangs badly and repeats badly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from calibration_free_tests.alignment.synthetic import SIZE, moved_by_chance
from calibration_free_tests.renderer.bench_building import part_on, wall_face
from recognition.geometry import Mount, Pose4, camera_in_rig
from recognition.modelbase import ObjectModel
from rig.hal import Frame, Image, RigPose
from rig.imagegrid import GridInfo, GridWriter
from sim_backends.appearance import Appearance, Sensor
from sim_backends.projection import Internals
from sim_backends.renderer import render
from sim_backends.scene import Scene


def textured_wall(seed: int, material: str = "stone") -> Scene:
    """A wall some 400 mm in front of the rig, turned and shifted as the seed has it."""
    rng = np.random.default_rng([seed, 5])
    face = wall_face("F", np.array([-500.0, 350.0, 0.0]), np.array([500.0, 350.0, 0.0]), 700.0)
    spots = [(x, y) for x in (150.0, 400.0, 650.0) for y in (180.0, 400.0)]
    parts = tuple(part_on(face, f"W{k}", "DW4", x, y, 60.0, 90.0, 12.0) for k, (x, y) in enumerate(spots))
    turn, x, y, z = rng.uniform((-8, -30, -30, 380), (8, 30, 30, 430))
    look = Appearance(seed=seed, material=material, texture=0.12)
    return Scene(ObjectModel("wall", parts, (face,)), Pose4(turn, x, y, z), look)


def pictures(
    scene: Scene,
    poses: Sequence[RigPose],
    mount: Mount,
    lens: Internals,
    rng: np.random.Generator,
    *,
    sd_mm: float = 0.0,
    sd_deg: float = 0.0,
    size: tuple[int, int] = SIZE,
) -> Iterator[Image]:
    """What the camera sees where the rig stands when it is told to go to the poses."""
    sensor = Sensor(exposure_sd=0.03)
    for pose in moved_by_chance(poses, rng, sd_mm, sd_deg):
        yield render(scene, camera_in_rig(pose, mount), lens, size, rng=rng, sensor=sensor, tilt=mount.tilt)


def write_scan(folder: Path, poses: Sequence[RigPose], images: Iterator[Image], info: GridInfo | None = None) -> Path:
    """An image grid of the pictures, as `rig scan` leaves it."""
    with GridWriter(folder, info or GridInfo(provenance="a test", internals="fixed_by_zoom")) as writer:
        for number, (pose, image) in enumerate(zip(poses, images, strict=True)):
            writer.add(Frame(image, pose, pose, "", number), f"images/{number:03d}.png")
    return folder
