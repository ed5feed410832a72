"""Localises photographs against a map of SIFT points by pycolmap: one alone, or several with known moves as a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.peers.rigs import rig_scene
from benchmarks.peers.sift_map import Features, Known, Reference, SiftMap, match
from benchmarks.peers.solvers import COLMAP_PIXEL, adjustment_options, colmap_camera
from recognition.geometry import CameraPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FOCAL, ALL, GIVEN = "focal", "all", "given"
"""What is done about the internals: focal length refined with a centred principal point; fx, fy and the principal point
refined; taken over from the reference photographs of the same zoom."""

VOTING, VOTED = 500, 30
"""The largest features vote for photographs, and so many photographs are matched in full."""
MAX_ERROR_PX = 12.0
FIRST_FOCAL = 1.2
"""Of the longer side: where COLMAP starts without EXIF."""
LEAST_FOR_INTERNALS = 12
"""Fewer matches than this leave a view's internals as they are: they would follow the noise."""
_ROUNDS = 3
_TWIN = 1000


@dataclass(frozen=True)
class Matches:
    """Points ``(n, 3)``, m, and where a photograph shows them ``(n, 2)``."""

    points_m: FloatArray
    pixels: FloatArray


@dataclass(frozen=True)
class Located:
    """A camera in the object frame, and how many features agree with it, each counted once however often matched."""

    camera: CameraPose
    inliers: int


@dataclass(frozen=True)
class _Fit:
    """Object -> first camera ``(3, 4)``, m; a COLMAP camera and a mask of inliers for each view."""

    pose: FloatArray
    cameras: list[Any]
    inliers: list[npt.NDArray[np.bool_]]


def matches(sift: SiftMap, known: Known, seen: Features) -> Matches:
    """Match a photograph with those of the map that get most votes."""
    start = np.searchsorted(known.image, np.arange(len(sift.references) + 1))
    features = [known.feature[a:b] for a, b in pairwise(start)]
    few = seen.descriptors[:VOTING]
    votes = [len(match(few, sift.features[k].descriptors[mine[:VOTING]])) for k, mine in enumerate(features)]
    points, pixels = [np.zeros((0, 3))], [np.zeros((0, 2))]
    for k in np.argsort(votes)[::-1][:VOTED]:
        pairs = match(seen.descriptors, sift.features[k].descriptors[features[k]])
        points.append(known.points_m[start[k] + pairs[:, 1]])
        pixels.append(seen.pixels[pairs[:, 0]])
    return Matches(np.concatenate(points), np.concatenate(pixels))


def locate(views: Sequence[Matches], references: Sequence[Reference], how: str) -> Located | None:
    """The camera of the last view, from all views.

    Args:
        views: what each shows.
        references: for their moves (those of the rig), sizes and, if ``how`` is ``GIVEN``, internals. Their places in
            the object are not looked at, but for the differences between them.
        how: ``FOCAL``, ``ALL`` or ``GIVEN``.
    """
    moves = [_between(references[0], r) for r in references]
    fit = _one(views[0], references[0], how) if len(views) == 1 else _rig(views, references, moves, how)
    if fit is not None and how == ALL:
        fit = _adjusted(views, moves, fit)
    if fit is None:
        return None
    turn, shift = moves[-1][:, :3], moves[-1][:, 3]
    rotation, translation = turn @ fit.pose[:, :3], turn @ fit.pose[:, 3] + shift
    centre = -1000.0 * (rotation.T @ translation)
    pan = float(np.degrees(np.arctan2(rotation[0, 2], rotation[0, 0])))
    agree = zip(views, fit.inliers, strict=True)
    inliers = sum(len(np.unique(seen.pixels[which], axis=0)) for seen, which in agree)
    return Located(CameraPose(pan, *(float(c) for c in centre)), inliers)


def _between(one: Reference, other: Reference) -> FloatArray:
    """One camera -> the other ``(3, 4)``, m: a move of the rig, which is known."""
    turn = other.rotation @ one.rotation.T
    return np.column_stack([turn, other.rotation @ (one.centre_m - other.centre_m)])


def _camera(number: int, of: Reference, how: str, focal: float | None = None) -> Any:
    model = "SIMPLE_PINHOLE" if how == FOCAL else "PINHOLE"
    camera = colmap_camera(number, focal or FIRST_FOCAL * max(of.size), model, of.size)
    if how == GIVEN:
        camera.params = of.internals + np.array([0.0, 0.0, COLMAP_PIXEL, COLMAP_PIXEL])
    return camera


def _ransac(options: Any) -> Any:
    options.max_error = MAX_ERROR_PX
    options.random_seed = 0
    return options


def _refinement(how: str) -> Any:
    import pycolmap

    options = pycolmap.AbsolutePoseRefinementOptions()
    options.refine_focal_length = how == FOCAL
    return options


def _one(seen: Matches, of: Reference, how: str) -> _Fit | None:
    import pycolmap

    # RANSAC estimates one focal length; two are refined later.
    camera = _camera(1, of, GIVEN if how == GIVEN else FOCAL)
    estimation = pycolmap.AbsolutePoseEstimationOptions()
    estimation.estimate_focal_length = how != GIVEN
    _ransac(estimation.ransac)
    if len(seen.points_m) < 4:
        return None
    given = seen.pixels + COLMAP_PIXEL, seen.points_m
    refinement = _refinement(GIVEN if how == GIVEN else FOCAL)
    found = pycolmap.estimate_and_refine_absolute_pose(*given, camera, estimation, refinement)
    if found is None:
        return None
    if how == ALL:
        camera = _camera(1, of, ALL, float(camera.params[0]))
    return _Fit(found["cam_from_world"].matrix(), [camera], [np.asarray(found["inlier_mask"])])


def _rig(views: Sequence[Matches], references: Sequence[Reference], moves: list[FloatArray], how: str) -> _Fit | None:
    import pycolmap

    cameras = []
    for k, (seen, of) in enumerate(zip(views, references, strict=True)):
        # Internals to start from are those of the views alone, where these have a pose.
        alone = None if how == GIVEN else _one(seen, of, how)
        if alone is not None and how == ALL:
            alone = _adjusted([seen], moves[:1], alone)
        camera = _camera(k + 1, of, how)
        if alone is not None:
            camera.params = alone.cameras[0].params
        cameras.append(camera)
    which = np.repeat(np.arange(len(views)), [len(seen.points_m) for seen in views])
    if len(which) < 4:
        return None
    found = pycolmap.estimate_and_refine_generalized_absolute_pose(
        np.concatenate([seen.pixels for seen in views]) + COLMAP_PIXEL,
        np.concatenate([seen.points_m for seen in views]),
        [int(k) for k in which],
        [pycolmap.Rigid3d(m) for m in moves],
        cameras,
        _ransac(pycolmap.RANSACOptions()),
        _refinement(how),
    )
    if found is None:
        return None
    agree = np.asarray(found["inlier_mask"])
    return _Fit(found["rig_from_world"].matrix(), cameras, [agree[which == k] for k in range(len(views))])


def _adjusted(views: Sequence[Matches], moves: list[FloatArray], fit: _Fit) -> _Fit:
    """Bundle adjustment with all internals free, in rounds: each takes the matches that agree with the one before."""
    import pycolmap

    options = adjustment_options()
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    for _ in range(_ROUNDS):
        scene = rig_scene(fit.cameras, moves, fit.pose, [seen.pixels for seen in views])
        config = pycolmap.BundleAdjustmentConfig()
        for k, (seen, agree) in enumerate(zip(views, fit.inliers, strict=True)):
            config.add_image(k + 1)
            _add_points(scene, k + 1, seen, np.flatnonzero(agree))
            if agree.sum() < LEAST_FOR_INTERNALS:
                config.set_constant_cam_intrinsics(k + 1)
        pycolmap.create_default_bundle_adjuster(options, config, scene).solve()
        pose = scene.frame(1).rig_from_world.matrix()
        cameras = [scene.camera(k + 1) for k in range(len(views))]
        inliers = [_agree(*one, pose) for one in zip(views, moves, cameras, strict=True)]
        fit = _Fit(pose, [_copied(camera) for camera in cameras], inliers)
    return fit


def _add_points(scene: Any, number: int, seen: Matches, which: IntArray) -> None:
    """Points as tracks of two: only points seen twice may be adjusted to, so a twin image stands by."""
    import pycolmap

    twin = _copied(scene.camera(number))
    twin.camera_id = _TWIN + number
    scene.add_camera_with_trivial_rig(twin)
    image = pycolmap.Image(
        name=f"twin {number}", keypoints=seen.pixels + COLMAP_PIXEL, camera_id=twin.camera_id, image_id=_TWIN + number
    )
    scene.add_image_with_trivial_frame(image, scene.image(number).cam_from_world())
    for n in which:
        track = [pycolmap.TrackElement(number, int(n)), pycolmap.TrackElement(_TWIN + number, int(n))]
        scene.add_point3D(seen.points_m[n], pycolmap.Track(track))


def _copied(camera: Any) -> Any:
    import pycolmap

    return pycolmap.Camera(camera.todict())


def _agree(seen: Matches, move: FloatArray, camera: Any, pose: FloatArray) -> npt.NDArray[np.bool_]:
    placed = (seen.points_m @ pose[:, :3].T + pose[:, 3]) @ move[:, :3].T + move[:, 3]
    fx, fy, u0, v0 = camera.params
    off = placed[:, :2] / np.maximum(placed[:, 2:], 1e-6) * [fx, fy] + [u0, v0] - seen.pixels - COLMAP_PIXEL
    return np.asarray((placed[:, 2] > 0) & (np.linalg.norm(off, axis=1) < MAX_ERROR_PX))
