"""The peers' pose solvers behind one call each: points, pixels and the nominal focal length in, a pose or ``None`` out.

All start from what a user would know, the nominal focal length and the image centre. All corners are right, so losses
are plain least squares, and RANSAC's threshold is wide enough for a camera that is not as told.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.bench_pose import SIZE
from benchmarks.peers.scenes import CENTRE

FloatArray = npt.NDArray[np.float64]
Found = tuple[FloatArray, FloatArray] | None
"""Rotation ``(3, 3)`` and translation ``(3,)`` mm, points -> camera; ``None``: the solver gave up."""
Solver = Callable[[FloatArray, FloatArray, float], Found]

INLIER_PX = 50.0
"""RANSAC's threshold: as much as 40 px of drift move a point."""
LEAST_SQUARES_PX = 1e3
"""Scale of pycolmap's Cauchy loss that leaves plain least squares."""
COLMAP_PIXEL = 0.5
"""COLMAP counts pixels from the corner of the first one, not from its centre."""
_QUADS = [np.random.default_rng(k).permutation(12)[:4] for k in range(30)]


def opencv_nominal(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """``solvePnP`` (SQPnP, then Levenberg-Marquardt) with the nominal camera."""
    import cv2

    camera = _matrix(focal)
    found, rotation, shift = cv2.solvePnP(points, pixels, camera, None, flags=cv2.SOLVEPNP_SQPNP)
    if not found:
        return None
    rotation, shift = cv2.solvePnPRefineLM(points, pixels, camera, None, rotation, shift)
    return cv2.Rodrigues(rotation)[0], shift[:, 0]


def opencv_calibrated(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """``calibrateCamera`` on the one view: fx, fy, u0, v0 free, no distortion."""
    import cv2

    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    given = [points.astype(np.float32)], [pixels.astype(np.float32)]
    try:
        _, _, _, rotations, shifts = cv2.calibrateCamera(*given, SIZE, _matrix(focal), None, flags=flags)
    except cv2.error:
        return None
    return cv2.Rodrigues(rotations[0])[0], shifts[0][:, 0]


def poselib_nominal(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """``estimate_absolute_pose`` (P3P in RANSAC, bundle adjustment) with the nominal camera."""
    import poselib

    options = {"max_reproj_error": INLIER_PX, "min_iterations": 50}
    pose, told = poselib.estimate_absolute_pose(
        pixels, points, _poselib_camera(focal), options, {"loss_type": "TRIVIAL"}
    )
    return (pose.R, pose.t) if told["num_inliers"] >= 4 else None


def poselib_focal(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """``p4pf`` on 30 random fours, the pose and focal length that fit all points best, refined at that focal length.

    Its bundle adjustment of absolute poses does not refine a focal length.
    """
    import poselib

    about = pixels - CENTRE
    best, least = None, np.inf
    for quad in _QUADS:
        for pose, f in zip(*poselib.p4pf(about[quad], points[quad], True), strict=True):
            seen = points @ pose.R.T + pose.t
            if seen[:, 2].min() <= 0:
                continue
            off = float(((f * seen[:, :2] / seen[:, 2:] - about) ** 2).sum())
            if off < least:
                best, least = (pose, f), off
    if best is None:
        return None
    pose, f = best
    pose, _ = poselib.refine_absolute_pose(pixels, points, pose, _poselib_camera(f), {"loss_type": "TRIVIAL"})
    return pose.R, pose.t


def pycolmap_focal(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """``estimate_and_refine_absolute_pose``: focal length estimated in LO-RANSAC, then refined; centred."""
    found = _colmap_start(points, pixels, focal)
    return None if found is None else found[:2]


def pycolmap_focal_and_centre(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """The same, then bundle adjustment with focal length and principal point (SIMPLE_PINHOLE) free."""
    return _colmap_adjusted(points, pixels, focal, "SIMPLE_PINHOLE")


def pycolmap_all_internals(points: FloatArray, pixels: FloatArray, focal: float) -> Found:
    """The same, then bundle adjustment with fx, fy and principal point (PINHOLE) free."""
    return _colmap_adjusted(points, pixels, focal, "PINHOLE")


ONE_VIEW: dict[str, Solver] = {
    "OpenCV solvePnP, nominal camera": opencv_nominal,
    "OpenCV calibrateCamera, one view": opencv_calibrated,
    "PoseLib, nominal camera": poselib_nominal,
    "PoseLib p4pf (focal length) + refinement": poselib_focal,
    "pycolmap, focal refined": pycolmap_focal,
    "pycolmap, focal + principal point refined": pycolmap_focal_and_centre,
    "pycolmap, fx, fy + principal point refined": pycolmap_all_internals,
}
PACKAGE = {name: name.split()[0].rstrip(",").lower() for name in ONE_VIEW}


def colmap_camera(number: int, focal: float, model: str, size: tuple[int, int] = SIZE) -> Any:
    """A camera with the given focal length and the principal point at the image's centre."""
    import pycolmap

    camera = pycolmap.Camera.create_from_model_name(number, model, focal, *size)
    centre = [(size[0] - 1) / 2 + COLMAP_PIXEL, (size[1] - 1) / 2 + COLMAP_PIXEL]
    camera.params = [focal, *centre] if model == "SIMPLE_PINHOLE" else [focal, focal, *centre]
    return camera


def adjustment_options() -> Any:
    """Bundle adjustment of poses and all internals; the points stay where they are."""
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.refine_points3D = False
    options.refine_sensor_from_rig = False
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1
    return options


def _colmap_start(points: FloatArray, pixels: FloatArray, focal: float) -> tuple[FloatArray, FloatArray, float] | None:
    import pycolmap

    camera = colmap_camera(1, focal, "SIMPLE_PINHOLE")
    estimation = pycolmap.AbsolutePoseEstimationOptions()
    estimation.estimate_focal_length = True
    estimation.ransac.max_error = INLIER_PX
    estimation.ransac.min_num_trials = 50
    estimation.ransac.random_seed = 0
    refinement = pycolmap.AbsolutePoseRefinementOptions()
    refinement.refine_focal_length = True
    refinement.loss_function_scale = LEAST_SQUARES_PX
    found = pycolmap.estimate_and_refine_absolute_pose(pixels + COLMAP_PIXEL, points, camera, estimation, refinement)
    if found is None:
        return None
    pose = found["cam_from_world"].matrix()
    return pose[:, :3], pose[:, 3], float(camera.params[0])


def _colmap_adjusted(points: FloatArray, pixels: FloatArray, focal: float, model: str) -> Found:
    import pycolmap

    start = _colmap_start(points, pixels, focal)
    if start is None:
        return None
    rotation, shift, refined = start
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), shift)
    scene = pycolmap.Reconstruction()
    # Only points seen twice may be adjusted to: a twin stands by, with its own camera, and takes no part.
    for number in (1, 2):
        scene.add_camera_with_trivial_rig(colmap_camera(number, refined, model))
        image = pycolmap.Image(name=str(number), keypoints=pixels + COLMAP_PIXEL, camera_id=number, image_id=number)
        scene.add_image_with_trivial_frame(image, pose)
    for k, point in enumerate(points):
        scene.add_point3D(point, pycolmap.Track([pycolmap.TrackElement(number, k) for number in (1, 2)]))
    config = pycolmap.BundleAdjustmentConfig()
    config.add_image(1)
    pycolmap.create_default_bundle_adjuster(adjustment_options(), config, scene).solve()
    found = scene.image(1).cam_from_world().matrix()
    return found[:, :3], found[:, 3]


def _matrix(focal: float) -> FloatArray:
    return np.array([[focal, 0.0, CENTRE[0]], [0.0, focal, CENTRE[1]], [0.0, 0.0, 1.0]])


def _poselib_camera(focal: float) -> dict[str, Any]:
    return {"model": "SIMPLE_PINHOLE", "width": SIZE[0], "height": SIZE[1], "params": [focal, *CENTRE]}
