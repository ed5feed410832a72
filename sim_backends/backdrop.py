"""Sky and ground behind the object, turning and moving with the camera."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rig.hal import Image
from sim_backends.projection import View
from sim_backends.textures import fractal_noise

FloatArray = npt.NDArray[np.float64]

_COARSE = 8  # sky and ground are soft, so they are computed on every 8th pixel
_TILE = 512


@lru_cache(maxsize=8)
def _tiles(seed: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    rng = np.random.default_rng([seed, 501])
    tiles: list[npt.NDArray[np.float32]] = []
    for _ in range(2):
        noise = fractal_noise(rng, (_TILE, _TILE), 160.0, 6.0)
        mirrored = noise + noise[::-1] + noise[:, ::-1] + noise[::-1, ::-1]  # so that it repeats without a seam
        tiles.append((mirrored / 2).astype(np.float32))
    return tiles[0], tiles[1]


def plain(size: tuple[int, int]) -> Image:
    """An even grey picture."""
    return np.full((size[1], size[0], 3), 128, dtype=np.uint8)


def sky_and_ground(view: View, ground_mm: float, scale_mm: float, seed: int) -> Image:
    """The background of a view.

    Args:
        view: the camera.
        ground_mm: the ground's height (object frame, Y down).
        scale_mm: a typical length of the object, for the ground's pattern.
        seed: of clouds and ground.
    """
    import cv2

    w, h = view.size
    u, v = np.meshgrid(
        np.linspace(-0.5, w - 0.5, w // _COARSE + 1), np.linspace(-0.5, h - 0.5, h // _COARSE + 1), indexing="xy"
    )
    rays = view.internals.undistort(np.stack([u, v], axis=-1))
    direction = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) @ view.rotation
    level = np.hypot(direction[..., 0], direction[..., 2])
    slope = direction[..., 1] / level
    clouds, soil = _tiles(seed)
    azimuth = np.arctan2(direction[..., 0], direction[..., 2]) / (2 * np.pi) * 4 * _TILE
    cloud = _look_up(clouds, azimuth, slope * 1.5 * _TILE)
    sky = np.array([236.0, 222.0, 208.0]) + np.clip(slope, -0.6, 0)[..., None] * (10.0, 50.0, 90.0)
    sky += cloud[..., None] * (4.0, 7.0, 9.0)
    drop = max(ground_mm - float(view.centre_mm[1]), 1e-3)
    reach = drop / np.maximum(slope, 1e-4) / level
    x = view.centre_mm[0] + reach * direction[..., 0]
    z = view.centre_mm[2] + reach * direction[..., 2]
    spots = _look_up(soil, x / scale_mm * 60, z / scale_mm * 60)
    haze = np.clip(reach / (60 * scale_mm), 0, 1)[..., None]
    ground = np.array([118.0, 128.0, 134.0]) + spots[..., None] * (7.0, 8.0, 8.0) * (1 - haze) + 50.0 * haze
    below = np.clip(slope * 80 + 0.5, 0, 1)[..., None]
    mixed = np.clip(sky * (1 - below) + ground * below, 0, 255).astype(np.uint8)
    return np.asarray(cv2.resize(mixed, (w, h), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _look_up(tile: npt.NDArray[np.float32], x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(tile[np.floor(y).astype(int) % _TILE, np.floor(x).astype(int) % _TILE], dtype=np.float64)
