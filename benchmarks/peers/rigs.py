"""The peers that take several views with known moves: a rig of cameras, each drifting on its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.peers.solvers import (
    COLMAP_PIXEL,
    INLIER_PX,
    LEAST_SQUARES_PX,
    Found,
    adjustment_options,
    colmap_camera,
)
from recognition.geometry import rotation_y

FloatArray = npt.NDArray[np.float64]
RigSolver = Callable[[FloatArray, FloatArray, float, FloatArray], Found]
"""Points ``(N, 3)``, pixels ``(V, N, 2)``, nominal focal length, cameras ``(V, 4)`` -> pose in the first camera."""


def pycolmap_rig_focal(points: FloatArray, pixels: FloatArray, focal: float, cameras: FloatArray) -> Found:
    """``estimate_and_refine_generalized_absolute_pose``: a focal length a view refined, centred principal points."""
    found = _generalised(points, pixels, focal, cameras)
    return None if found is None else (found[0][:, :3], found[0][:, 3])


def pycolmap_rig_all_internals(points: FloatArray, pixels: FloatArray, focal: float, cameras: FloatArray) -> Found:
    """The same, then bundle adjustment of the rig with fx, fy and principal point free in every view."""
    import pycolmap

    start = _generalised(points, pixels, focal, cameras)
    if start is None:
        return None
    pose, focals = start
    views = len(cameras)
    own = [colmap_camera(k + 1, focals[k], "PINHOLE") for k in range(views)]
    scene = rig_scene(own, _moves(cameras), pose, list(pixels))
    for n, point in enumerate(points):
        scene.add_point3D(point, pycolmap.Track([pycolmap.TrackElement(k + 1, n) for k in range(views)]))
    config = pycolmap.BundleAdjustmentConfig()
    for k in range(views):
        config.add_image(k + 1)
    pycolmap.create_default_bundle_adjuster(adjustment_options(), config, scene).solve()
    found = scene.frame(1).rig_from_world.matrix()
    return found[:, :3], found[:, 3]


def rig_scene(
    cameras: Sequence[Any], moves: Sequence[FloatArray], pose: FloatArray, pixels: Sequence[FloatArray]
) -> Any:
    """A COLMAP reconstruction of one frame of a rig, without points: images, cameras and sensors 1 to V.

    Args:
        cameras: V of them, numbered from 1.
        moves: ``(3, 4)`` first camera -> each camera.
        pose: ``(3, 4)`` world -> first camera.
        pixels: ``(n, 2)`` of each view.
    """
    import pycolmap

    scene, rig, frame = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1), pycolmap.Frame(frame_id=1, rig_id=1)
    for number, (camera, move) in enumerate(zip(cameras, moves, strict=True), start=1):
        scene.add_camera(camera)
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number)
        if number == 1:
            rig.add_ref_sensor(sensor)
        else:
            rig.add_sensor(sensor, pycolmap.Rigid3d(move))
        frame.add_data_id(pycolmap.data_t(sensor, number))
    scene.add_rig(rig)
    frame.rig_from_world = pycolmap.Rigid3d(pose)
    scene.add_frame(frame)
    for number, seen in enumerate(pixels, start=1):
        keypoints = seen + COLMAP_PIXEL
        image = pycolmap.Image(name=str(number), keypoints=keypoints, camera_id=number, image_id=number)
        image.frame_id = 1
        scene.add_image(image)
    scene.register_frame(1)
    return scene


RIGS: dict[str, RigSolver] = {
    "pycolmap rig, a focal length a view refined": pycolmap_rig_focal,
    "pycolmap rig, fx, fy + principal point a view refined": pycolmap_rig_all_internals,
}


def _moves(cameras: FloatArray) -> list[FloatArray]:
    """First camera -> each camera ``(3, 4)``."""
    turns = rotation_y(cameras[:, 0])
    return [np.column_stack([t, -t @ c]) for t, c in zip(turns, cameras[:, 1:], strict=True)]


def _generalised(
    points: FloatArray, pixels: FloatArray, focal: float, cameras: FloatArray
) -> tuple[FloatArray, list[float]] | None:
    """Pose ``(3, 4)`` in the first camera, and the focal lengths."""
    import pycolmap

    views, count = pixels.shape[:2]
    own = [colmap_camera(k + 1, focal, "SIMPLE_PINHOLE") for k in range(views)]
    estimation = pycolmap.RANSACOptions()
    estimation.max_error = INLIER_PX
    estimation.min_num_trials = 50
    estimation.random_seed = 0
    refinement = pycolmap.AbsolutePoseRefinementOptions()
    refinement.refine_focal_length = True
    refinement.loss_function_scale = LEAST_SQUARES_PX
    found = pycolmap.estimate_and_refine_generalized_absolute_pose(
        pixels.reshape(-1, 2) + COLMAP_PIXEL,
        np.tile(points, (views, 1)),
        [int(k) for k in np.repeat(np.arange(views), count)],
        [pycolmap.Rigid3d(move) for move in _moves(cameras)],
        own,
        estimation,
        refinement,
    )
    if found is None:
        return None
    return found["rig_from_world"].matrix(), [float(camera.params[0]) for camera in own]
