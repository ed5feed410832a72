"""Points, cameras and pictures that the pose tests share."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.geometry import Pose4, project

FloatArray = npt.NDArray[np.float64]

TWO_FACES = np.array(
    [
        *([-60, -30, 0], [-20, -30, 0], [-20, 10, 0], [-60, 10, 0], [-50, 20, 0], [-15, 22, 0]),
        *([0, -30, 20], [0, -30, 60], [0, 10, 60], [0, 10, 20], [0, 25, 50], [0, 22, 15]),
    ],
    dtype=np.float64,
)
WINDOW = np.array([[-15, -20, 0], [15, -20, 0], [15, 20, 0], [-15, 20, 0]], dtype=np.float64)
RECESSED = np.vstack([WINDOW, WINDOW * [0.7, 0.7, 1.0] + [0, 0, 8.0]])
GENERAL = np.array(
    [[-20, -18, 3], [22, -15, -9], [18, 21, 12], [-17, 16, -14], [5, 2, 20], [-6, 11, 8]], dtype=np.float64
)
INTERNALS = np.array([800.0, 812.0, 655.0, 470.0])
SIZE = (1280, 960)


def picture(points_mm: FloatArray, pose: Pose4, internals: FloatArray = INTERNALS) -> FloatArray:
    """Noise-free pixels ``(n, 2)`` of object points under the transform points -> camera."""
    return project(points_mm @ pose.rotation.T + pose.translation_mm, internals)
