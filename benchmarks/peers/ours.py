"""Our estimator on the same scenes: all at once from the closed form, or one at a time from nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.bench_pose import SIZE
from benchmarks.peers.scenes import DRIFT_PX, Scenes
from recognition.closed_form import general_starts, upright_starts
from recognition.geometry import CameraPose, Pose4, rotation_y
from recognition.pose import estimate_pose
from recognition.priors import Priors
from recognition.projected import Problem
from recognition.varpro import minimise, refine_batch, start_state
from recognition.views import View
from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Poses = tuple[FloatArray, FloatArray]
"""Rotations ``(H, 3, 3)`` and translations ``(H, 3)``, points -> camera of the first view; NaN where there is none."""

SOFT = Priors(image_size=SIZE)
"""What the recogniser believes of any camera: nothing that was told of these scenes."""


@dataclass(frozen=True)
class Table:
    """The scenes as ``refine_batch`` takes them; the moves differ from scene to scene, so each brings its cameras."""

    points: FloatArray
    pixels: FloatArray
    weight: FloatArray
    view: IntArray
    cameras: FloatArray
    group: IntArray


def table(scenes: Scenes) -> Table:
    """Laid out anew for each call, since that is part of what a solve costs."""
    h, v, n = scenes.pixels.shape[:3]
    view = np.arange(h)[:, None] * v + np.repeat(np.arange(v), n)
    return Table(
        np.tile(scenes.points_mm, (1, v, 1)),
        scenes.pixels.reshape(h, v * n, 2),
        np.full((h, v * n), 1.0 / scenes.noise_px),
        view,
        scenes.cameras.reshape(h * v, 4),
        np.tile(np.arange(v), h),
    )


def batch_upright(scenes: Scenes, priors: Priors | None) -> Poses:
    """Four degrees of freedom, all scenes at once."""
    t = table(scenes)
    start, sound = upright_starts(scenes.points_mm, scenes.pixels[:, 0])
    found = refine_batch(start, t.points, t.pixels, t.weight, t.view, t.cameras, t.group, priors)
    placement = np.where((found.valid & sound)[:, None], found.placement, np.nan)
    return rotation_y(placement[:, 0]), placement[:, 1:]


def batch_general(scenes: Scenes, priors: Priors | None) -> Poses:
    """Six degrees of freedom, all scenes at once."""
    t = table(scenes)
    rotation, shift, sound = general_starts(scenes.points_mm, scenes.pixels[:, 0])
    groups = scenes.pixels.shape[1]
    problem = Problem(t.points, t.pixels, t.weight, t.view, t.cameras, t.group[t.view], groups, priors)
    state, fit, _ = minimise(problem, start_state(rotation, shift, priors), iterations=10, tolerance=1e-3)
    good = (fit.valid & sound)[:, None]
    return np.where(good[..., None], state.rotation, np.nan), np.where(good, state.shift, np.nan)


def single(scenes: Scenes, dof: int, priors: Priors | None) -> Poses:
    """``estimate_pose`` scene by scene, from nothing: a search over all rotations and distances."""
    found = [_estimated(scenes, k, dof, priors, None) for k in range(len(scenes.pose))]
    return np.array([f[0] for f in found]), np.array([f[1] for f in found])


def told_nominal(scenes: Scenes) -> Poses:
    """``estimate_pose`` from the closed form, upright, with soft priors and the nominal focal length the peers know."""
    start, _ = upright_starts(scenes.points_mm, scenes.pixels[:, 0])
    found = []
    for k, focal in enumerate(scenes.nominal_px):
        priors = Priors(image_size=SIZE, focal_range_px=(focal - DRIFT_PX, focal + DRIFT_PX))
        found.append(_estimated(scenes, k, 4, priors, Pose4.of(float(np.degrees(start[k, 0])), start[k, 1:])))
    return np.array([f[0] for f in found]), np.array([f[1] for f in found])


def _estimated(scenes: Scenes, k: int, dof: int, priors: Priors | None, start: Pose4 | None) -> Poses:
    seen = zip(scenes.pixels[k], scenes.cameras[k], strict=True)
    views = [
        View(scenes.points_mm[k], pixels, CameraPose(float(np.degrees(c[0])), *c[1:]), sigma_px=scenes.noise_px)
        for pixels, c in seen
    ]
    try:
        pose = estimate_pose(views=views, dof=dof, priors=priors, start=start).pose
    except DegenerateGeometryError:
        return np.full((3, 3), np.nan), np.full(3, np.nan)
    return pose.rotation, pose.translation_mm
