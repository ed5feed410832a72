"""Procedural wall textures: plaster, brick and stone at low contrast, with a pyramid for distant views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rig.hal import Image
from sim_backends.appearance import Appearance
from sim_backends.coverage import Coverage
from sim_backends.projection import Internals, View
from sim_backends.walls import Wall

Field = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]

_MAX_PIXELS = 2.0e6
_LEVELS = 6


@dataclass(frozen=True)
class WallTexture:
    """A wall's picture, seen head-on: ``levels[k]`` has ``px_per_mm / 2^k`` pixels a millimetre."""

    levels: tuple[Image, ...]
    px_per_mm: float


def fractal_noise(
    rng: np.random.Generator, shape: tuple[int, int], coarsest_px: float, finest_px: float = 1.0
) -> Field:
    """Noise ``(h, w)`` of zero mean and unit variance with details from ``finest_px`` to ``coarsest_px``."""
    import cv2

    h, w = shape
    total = np.zeros(shape, dtype=np.float32)
    size = finest_px
    while size <= max(coarsest_px, finest_px):
        small = rng.standard_normal((max(2, int(h / size) + 2), max(2, int(w / size) + 2)), dtype=np.float32)
        total += cv2.resize(small, (w, h), interpolation=cv2.INTER_CUBIC)
        size *= 3.0
    total -= total.mean()
    return np.asarray(total / max(float(total.std()), 1e-6), dtype=np.float32)


def _courses(rng: np.random.Generator, shape: tuple[int, int], height: float, width: float, joint: float) -> Field:
    """Courses of bricks or blocks ``(h, w)``: each of its own tone, with lighter joints. Sizes in pixels."""
    h, w = shape
    y = np.arange(h, dtype=np.float32) / height
    row = y.astype(int)
    x = np.arange(w, dtype=np.float32)[None, :] / width + 0.5 * (row % 2)[:, None]
    column = x.astype(int)
    tones = rng.standard_normal((row.max() + 1, int(column.max()) + 1), dtype=np.float32)
    field = tones[row[:, None], column]
    # Joints fade out where they are thinner than a pixel.
    soft = max(joint, 0.7)
    across_y = np.minimum(y - row, 1 - (y - row)) * height
    across_x = np.minimum(x - column, 1 - (x - column)) * width
    nearest = np.minimum(across_y[:, None], across_x)
    mortar = np.clip(1.0 - nearest / soft, 0.0, 1.0) * min(1.0, joint / 0.7)
    return np.asarray(field * (1 - mortar) + 1.6 * mortar, dtype=np.float32)


def _material(rng: np.random.Generator, shape: tuple[int, int], material: str, course_px: float) -> Field:
    fine = fractal_noise(rng, shape, 4.0 * course_px)
    if material == "brick":
        return 0.45 * fine + 0.75 * _courses(rng, shape, course_px, 3.1 * course_px, 0.13 * course_px)
    if material == "stone":
        return 0.5 * fine + 0.7 * _courses(rng, shape, 3.4 * course_px, 6.3 * course_px, 0.16 * course_px)
    return fine


def wall_texture(
    rng: np.random.Generator, width_mm: float, height_mm: float, course_mm: float, light: float, look: Appearance
) -> WallTexture:
    """The texture of one wall.

    Args:
        rng: draws the pattern.
        width_mm, height_mm: of the wall.
        course_mm: height of one course of bricks; sets the scale of every material.
        light: the wall's brightness under the scene's light, 0..1.
        look: material, colour and contrast.
    """
    import cv2

    px_per_mm = min(10.0 / course_mm, float(np.sqrt(_MAX_PIXELS / (width_mm * height_mm))))
    shape = (max(4, round(height_mm * px_per_mm)), max(4, round(width_mm * px_per_mm)))
    colour = np.asarray(look.wall_bgr, dtype=np.float32) * light
    if look.texture <= 0:
        flat = np.broadcast_to(np.rint(colour).astype(np.uint8), (4, 4, 3)).copy()
        return WallTexture((flat,), 4 / max(width_mm, height_mm))
    field = _material(rng, shape, look.material, course_mm * px_per_mm)
    stains = fractal_noise(rng, shape, max(shape) / 2, max(shape) / 12)
    relative = 1.0 + look.texture * (0.85 * field + 0.5 * stains)
    hue = fractal_noise(rng, shape, max(shape) / 6, max(shape) / 30)[..., None] * np.float32(look.texture / 3)
    tint = 1.0 + hue * np.array([1.0, 0.0, -1.0], dtype=np.float32)
    level = np.clip(relative[..., None] * tint * colour, 0, 255).astype(np.uint8)
    levels = [level]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) > 16:
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), dtype=np.uint8))
    return WallTexture(tuple(levels), px_per_mm)


def wall_seen(wall: Wall, texture: WallTexture, outline: FloatArray, cover: Coverage, view: View) -> Image:
    """The wall's texture as seen in the window of ``cover``, ``(h, w, 3)``."""
    import cv2

    h, w = cover.fraction.shape
    top_left, top_right, _, foot = wall.corners_mm
    width, height = wall.size_mm
    plane = np.stack([(top_right - top_left) / width, (foot - top_left) / height, top_left], axis=1)
    # Columns: the wall's x and y axis and its corner, in the camera; its inverse takes rays to millimetres on the wall.
    to_wall = np.linalg.inv(view.rotation @ plane + np.outer(view.translation_mm, (0, 0, 1)))
    level = _level(texture, outline, to_wall, view)
    picture = texture.levels[level]
    scale = texture.px_per_mm / 2**level
    to_texture = np.array([[scale, 0, -0.5], [0, scale, -0.5], [0, 0, 1.0]]) @ to_wall
    inner = view.internals
    if not inner.k1:
        shift = (cover.x - inner.u0) / inner.fx, (cover.y - inner.v0) / inner.fy
        to_ray = np.array([[1 / inner.fx, 0, shift[0]], [0, 1 / inner.fy, shift[1]], [0, 0, 1]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(picture, to_texture @ to_ray, (w, h), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, dtype=np.uint8)
    x, y = _rays(inner, view.size)
    x, y = x[cover.window], y[cover.window]
    m = to_texture.astype(np.float32)
    depth = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
    map_x, map_y = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * depth, (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * depth
    return np.asarray(
        cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8
    )


def _level(texture: WallTexture, outline: FloatArray, to_wall: FloatArray, view: View) -> int:
    """The pyramid level whose pixels are about as large as the picture's, in the middle of what is seen of the wall."""
    middle = np.clip(outline, 0, np.array(view.size) - 1).mean(axis=0)
    probes = middle + np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
    rays = np.concatenate([view.internals.undistort(probes), np.ones((3, 1))], axis=1) @ to_wall.T
    a, b, c = rays[:, :2] / rays[:, 2:]
    area = abs(float((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])) / 4
    ratio = texture.px_per_mm * np.sqrt(max(area, 1e-12))
    return int(np.clip(np.rint(np.log2(max(ratio, 1e-6))), 0, len(texture.levels) - 1))


@lru_cache(maxsize=2)
def _rays(internals: Internals, size: tuple[int, int]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Normalised x and y ``(h, w)`` of every pixel: undistorted on every 8th, linear between (error < 0.01 px)."""
    import cv2

    w, h = size
    nx, ny = -(-w // 8), -(-h // 8)
    u, v = np.meshgrid(8 * np.arange(nx) + 3.5, 8 * np.arange(ny) + 3.5, indexing="xy")
    coarse = internals.undistort(np.stack([u, v], axis=-1)).astype(np.float32)
    fine = cv2.resize(coarse, (8 * nx, 8 * ny), interpolation=cv2.INTER_LINEAR)[:h, :w]
    return np.ascontiguousarray(fine[..., 0]), np.ascontiguousarray(fine[..., 1])
