"""Draws the scenes that all pose solvers are given: noisy points on two faces, seen by a camera that drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.bench_pose import SIZE, two_faces
from recognition.geometry import rotation_y

FloatArray = npt.NDArray[np.float64]

CENTRE = (np.array(SIZE) - 1.0) / 2.0
DRIFT_PX, DRIFT_ASPECT = 40.0, 0.02
"""Sd of fx about the nominal focal length and of u0, v0 about the image centre; sd of fy/fx about 1. In every view."""
FILLS = 0.6
"""Of the picture's width: the zoom is chosen for each distance so that the points do."""


@dataclass(frozen=True)
class Scenes:
    """H scenes of V views of N points.

    Attributes:
        points_mm: ``(H, N, 3)``.
        pose: ``(H, 4)`` theta (radians), x, y, z: points -> camera of the first view.
        cameras: ``(H, V, 4)`` theta (radians) and centre: the known moves, in the frame of the first view's camera.
        internals: ``(H, V, 4)`` true fx, fy, u0, v0.
        nominal_px: ``(H,)`` focal length that a user would know of this zoom.
        pixels: ``(H, V, N, 2)``.
        noise_px: sd of one coordinate.
    """

    points_mm: FloatArray
    pose: FloatArray
    cameras: FloatArray
    internals: FloatArray
    nominal_px: FloatArray
    pixels: FloatArray
    noise_px: float

    @property
    def rotation(self) -> FloatArray:
        """``(H, 3, 3)`` points -> camera of the first view."""
        return rotation_y(self.pose[:, 0])

    def first(self, count: int) -> Scenes:
        """The first scenes alone."""
        pick = (self.points_mm, self.pose, self.cameras, self.internals, self.nominal_px, self.pixels)
        return Scenes(*(a[:count] for a in pick), self.noise_px)


def draw(rng: np.random.Generator, count: int, noise_px: float, moves_deg: tuple[float, ...] = (0.0,)) -> Scenes:
    """Scenes 100 to 600 mm away, seen at 20 to 70 degrees; the camera circles them by the moves, of which one is 0."""
    points = np.array([two_faces(rng) for _ in range(count)])
    theta = np.radians(rng.uniform(20, 70, count))
    distance = rng.uniform(100, 600, count)
    turned = points @ rotation_y(theta).swapaxes(1, 2)
    shift = np.column_stack([rng.uniform(-0.1, 0.1, (count, 2)) * distance[:, None], distance])
    # Distances count from the nearest point, which keeps everything in front of the camera at 100 mm, too.
    shift[:, 2] -= turned[..., 2].min(axis=1)
    shift[:, :2] -= turned.mean(axis=1)[:, :2]
    placed = turned + shift[:, None]
    nominal = FILLS * SIZE[0] / np.ptp(placed[..., 0] / placed[..., 2], axis=1)
    cameras = _around(placed.mean(axis=1)[:, 2], np.radians(np.array(moves_deg)))
    internals = drifting(rng, nominal, len(moves_deg))
    clean = project(points, rotation_y(theta), shift, cameras, internals)
    pixels = clean + noise_px * rng.standard_normal(clean.shape)
    return Scenes(points, np.column_stack([theta, shift]), cameras, internals, nominal, pixels, noise_px)


def _around(distance: FloatArray, moves: FloatArray) -> FloatArray:
    """Cameras ``(H, V, 4)`` on a circle about the point straight ahead at the given distances."""
    pivot = np.zeros((len(distance), 3))
    pivot[:, 2] = distance
    centre = pivot[:, None] - np.einsum("vji,hj->hvi", rotation_y(moves), pivot)
    return np.concatenate([np.broadcast_to(moves[None, :, None], (len(distance), len(moves), 1)), centre], axis=2)


def drifting(rng: np.random.Generator, nominal: FloatArray, views: int) -> FloatArray:
    """Internals ``(H, V, 4)``, another set in every view."""
    shape = (len(nominal), views)
    fx = nominal[:, None] + DRIFT_PX * rng.standard_normal(shape)
    fy = fx * (1.0 + DRIFT_ASPECT * rng.standard_normal(shape))
    centre = CENTRE + DRIFT_PX * rng.standard_normal((*shape, 2))
    return np.concatenate([fx[..., None], fy[..., None], centre], axis=-1)


def project(
    points: FloatArray, rotation: FloatArray, shift: FloatArray, cameras: FloatArray, internals: FloatArray
) -> FloatArray:
    """Pixels ``(H, V, N, 2)`` of points ``(H, N, 3)`` at poses ``(H, 3, 3)``, ``(H, 3)`` from the cameras."""
    placed = points @ rotation.swapaxes(1, 2) + shift[:, None]
    relative = placed[:, None] - cameras[:, :, None, 1:]
    seen = relative @ rotation_y(cameras[..., 0]).swapaxes(-1, -2)
    normalised = seen[..., :2] / seen[..., 2:]
    return np.asarray(internals[:, :, None, :2] * normalised + internals[:, :, None, 2:])
