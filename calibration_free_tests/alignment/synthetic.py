"""Tracks of a made-up target, seen by a camera that hangs as told: what a perfect feature tracker would hand over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt

from recognition.alignment.moves import Moves
from recognition.alignment.tracks import Tracks
from recognition.geometry import Mount, camera_in_rig, rotation_y
from rig.hal import RigPose
from sim_backends.projection import Internals

FloatArray = npt.NDArray[np.float64]

SIZE = (640, 480)
HUNG = Mount(x_mm=12.0, z_mm=45.0, pan_zero_deg=1.5, roll_deg=0.4, pitch_deg=-0.6)
LENS = Internals(900.0, 904.0, 325.0, 251.0, -0.05)


def lattice(
    xs: tuple[float, ...] = (-40.0, 0.0, 40.0),
    ys: tuple[float, ...] = (-30.0, 30.0),
    zs: tuple[float, ...] = (-30.0, 30.0),
    pans: tuple[float, ...] = (-15.0, 0.0, 15.0),
    zoom: float = 0.0,
) -> list[RigPose]:
    """Poses around the origin; the target stands some 400 mm in front of it."""
    return [RigPose(x, y, z, pan, zoom) for x, y, z, pan in product(xs, ys, zs, pans)]


def wall(rng: np.random.Generator, points: int = 300, depth_mm: float = 400.0, relief_mm: float = 15.0) -> FloatArray:
    """``(N, 3)`` points of a rough wall in front of the rig, not quite square to it."""
    x, y = rng.uniform(-300, 300, points), rng.uniform(-200, 200, points)
    return np.stack([x, y, depth_mm + 0.15 * x + 0.05 * y + rng.normal(0, relief_mm, points)], axis=1)


def moved_by_chance(poses: Sequence[RigPose], rng: np.random.Generator, sd_mm: float, sd_deg: float) -> list[RigPose]:
    """Where the rig really stands if it is told to go to these poses."""
    return [
        replace(
            pose,
            x_mm=pose.x_mm + rng.normal(0, sd_mm),
            y_mm=pose.y_mm + rng.normal(0, sd_mm),
            z_mm=pose.z_mm + rng.normal(0, sd_mm),
            theta_deg=pose.theta_deg + rng.normal(0, sd_deg),
        )
        for pose in poses
    ]


def seen(
    points: FloatArray,
    poses: list[RigPose],
    mount: Mount = HUNG,
    lens: Internals | list[Internals] = LENS,
    *,
    noise_px: float = 0.0,
    wrong: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Tracks:
    """Tracks of points from where the rig really stands; a share of the observations is ``wrong``: anywhere at all."""
    rng = rng or np.random.default_rng(0)
    lenses = lens if isinstance(lens, list) else [lens] * len(poses)
    pixels, view, label = [], [], []
    for k, (pose, inside) in enumerate(zip(poses, lenses, strict=True)):
        camera = camera_in_rig(pose, mount)
        cam = (points - camera.centre_mm) @ rotation_y(np.radians(camera.theta_deg)).T @ mount.tilt.T
        px = inside.pixels(np.where(cam[:, 2:] > 1.0, cam, [0.0, 0.0, 1.0]))
        there = np.flatnonzero((cam[:, 2] > 1.0) & ((px > 0) & (px < SIZE)).all(axis=1))
        pixels.append(px[there] + rng.normal(0, noise_px, (len(there), 2)) if noise_px else px[there])
        view.append(np.full(len(there), k))
        label.append(there)
    every = np.concatenate(pixels)
    lost = rng.random(len(every)) < wrong
    every[lost] = rng.uniform((0, 0), SIZE, (int(lost.sum()), 2))
    return Tracks.of(every, np.concatenate(view), np.concatenate(label), least=3)


def moves_of(poses: list[RigPose]) -> Moves:
    """As the estimator gets them."""
    return Moves.of(poses)
