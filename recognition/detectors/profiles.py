"""Samples grey and colour across polygon edges, fits sub-pixel lines to what is found there and intersects them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rig.hal import Image

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_EPS = 1e-9
_PEAK_SHARE = 0.35  # a peak of an edge's mean profile is an edge from this share of the strongest one
_MARGIN = 0.08  # share of an edge left out at either end, where the neighbouring edges disturb
_ROBUST_PX = 0.6  # scale of the Cauchy weights of the line fits
_ON_LINE_PX = 0.8  # a sample supports its line within this distance
_WEAK = 0.3  # and with this share of the edge's mean contrast
_MAX_MAP = 30_000  # OpenCV's remap takes maps of fewer than 32,768 rows


def planes_of(image: Image) -> Float32Array:
    """The planes in which edges are looked for, ``(h, w, c)``: grey, and for colour red-blue, green-magenta."""
    import cv2

    if image.ndim == 2 or image.shape[2] == 1:
        grey = cv2.GaussianBlur(np.ascontiguousarray(image.reshape(image.shape[:2])), (3, 3), 0.7)
        return grey.astype(np.float32)[..., None]
    # Rows: grey, (R - B) / 2 and (2 G - R - B) / 4 of a BGR picture; halved, so that no plane is noisier than grey.
    mix = np.array([[0.114, 0.587, 0.299], [-0.5, 0.0, 0.5], [-0.25, 0.5, -0.25]], dtype=np.float32)
    smooth = cv2.GaussianBlur(image[..., :3], (3, 3), 0.7).astype(np.float32)
    return np.asarray(cv2.transform(smooth, mix), dtype=np.float32)


@dataclass(frozen=True, slots=True)
class EdgeFit:
    """Lines fitted to the edges of ``K`` polygons of ``n`` corners; edge i runs from corner i to corner i + 1.

    Attributes:
        corners_px: ``(K, n, 2)`` intersections of neighbouring lines; NaN where they are nearly parallel.
        offset_px: ``(K, n)`` shift of each edge's middle along its outward normal.
        support: ``(K, n)`` share of samples that lie on the line with the edge's polarity and contrast.
        contrast: ``(K, n)`` median step across the line, grey (or colour) levels per pixel.
    """

    corners_px: FloatArray
    offset_px: FloatArray
    support: FloatArray
    contrast: FloatArray

    def take(self, index: npt.NDArray[Any]) -> EdgeFit:
        """Those polygons that an index, or a mask ``(K,)``, selects."""
        return EdgeFit(self.corners_px[index], self.offset_px[index], self.support[index], self.contrast[index])

    def joined(self, other: EdgeFit) -> EdgeFit:
        """These polygons and those of another fit."""
        names = ("corners_px", "offset_px", "support", "contrast")
        return EdgeFit(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


@dataclass(frozen=True, slots=True)
class _Frames:
    """Edges of polygons: where their samples lie."""

    start: FloatArray  # (K, n, 2)
    along: FloatArray  # (K, n, 2) to the next corner
    normal: FloatArray  # (K, n, 2) outward
    share: FloatArray  # (s,) places of the samples along the edge, 0..1

    @staticmethod
    def of(polygons: FloatArray, samples: int) -> _Frames:
        along = np.roll(polygons, -1, axis=1) - polygons
        unit = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), _EPS)
        # Corners run clockwise as seen (y down), so the outside lies to the left of the way.
        normal = np.stack([unit[..., 1], -unit[..., 0]], axis=-1)
        return _Frames(polygons, along, normal, np.linspace(_MARGIN, 1 - _MARGIN, samples))


def fit_edges(planes: Float32Array, polygons: FloatArray, radius_px: float = 3.5, samples: int = 16) -> EdgeFit:
    """Fit a line to each edge of polygons ``(K, n, 2)``, clockwise as seen, from ``radius_px`` to either side of it.

    Each profile is projected on the colour direction in which its edge is strongest; the edge taken is the one nearest
    to the given polygon among the strong ones, so that of two concentric outlines the wanted one is kept.
    """
    if len(polygons) == 0:
        none = np.zeros(polygons.shape[:2])
        return EdgeFit(polygons.copy(), none, none, none)
    frames = _Frames.of(np.asarray(polygons, dtype=np.float64), samples)
    reach = np.arange(-np.ceil(radius_px) - 1, np.ceil(radius_px) + 2)
    steps = np.diff(_profiles(planes, frames, reach), axis=-2)  # (K, n, s, o, c)
    at = (reach[1:] + reach[:-1]) / 2
    signed = _signed_steps(steps, np.abs(at) <= radius_px)
    middle = _nearest_peak(signed.mean(axis=2), at, radius_px)
    slope = np.zeros_like(middle)
    for window in (2.0, 1.5):
        expected = middle[..., None] + slope[..., None] * (frames.share - 0.5)
        found, strength = _peaks(signed, at, expected, window)
        middle, slope = _robust_line(frames.share - 0.5, found, strength, expected)
    line = middle[..., None] + slope[..., None] * (frames.share - 0.5)
    contrast = np.median(strength, axis=2)
    good = (np.abs(found - line) < _ON_LINE_PX) & (strength > _WEAK * contrast[..., None]) & (strength > 0)
    return EdgeFit(_corners(frames, middle, slope), middle, good.mean(axis=2), np.maximum(contrast, 0.0))


def _profiles(planes: Float32Array, frames: _Frames, reach: FloatArray) -> Float32Array:
    """Values ``(K, n, s, o, c)`` of the planes across the edges."""
    import cv2

    base = frames.start[:, :, None] + frames.along[:, :, None] * frames.share[:, None]
    points = base[..., None, :] + frames.normal[:, :, None, None] * reach[:, None]
    return sample(planes, points, cv2.INTER_LINEAR)


def sample(planes: Float32Array, points: FloatArray, interpolation: int) -> Float32Array:
    """Values ``(..., c)`` of planes ``(h, w, c)`` at pixels ``(..., 2)``; outside, the border is repeated."""
    import cv2

    x, y = (np.ascontiguousarray(points[..., axis], dtype=np.float32).reshape(-1, points.shape[-2]) for axis in (0, 1))
    parts = [
        cv2.remap(planes, x[i : i + _MAX_MAP], y[i : i + _MAX_MAP], interpolation, borderMode=cv2.BORDER_REPLICATE)
        for i in range(0, len(x), _MAX_MAP)
    ]
    values = np.concatenate(parts) if parts else np.zeros(0)
    return np.asarray(values, dtype=np.float32).reshape(*points.shape[:-1], planes.shape[2])


def _signed_steps(steps: Float32Array, inside: npt.NDArray[np.bool_]) -> Float32Array:
    """Steps ``(K, n, s, o)`` along the direction in the planes in which each edge's mean profile is strongest."""
    mean = steps.mean(axis=2)
    size = np.where(inside, np.linalg.norm(mean, axis=-1), -1.0)
    best = np.take_along_axis(mean, size.argmax(axis=-1)[..., None, None], axis=2)[..., 0, :]
    direction = best / np.maximum(np.linalg.norm(best, axis=-1, keepdims=True), _EPS)
    return np.asarray(np.matmul(steps, direction[:, :, None, :, None])[..., 0])


def _nearest_peak(mean: FloatArray | Float32Array, at: FloatArray, radius_px: float) -> FloatArray:
    """``(K, n)`` place of the strong peak of a mean profile ``(K, n, o)`` that is nearest to zero."""
    mean = np.where(np.abs(at) <= radius_px, mean, -np.inf)
    left, right = mean[..., :-2], mean[..., 2:]
    strong = mean[..., 1:-1] >= _PEAK_SHARE * mean.max(axis=-1, keepdims=True)
    peak = (mean[..., 1:-1] >= left) & (mean[..., 1:-1] >= right) & strong & np.isfinite(mean[..., 1:-1])
    distance = np.where(peak, np.abs(at[1:-1]), np.inf)
    return np.asarray(at[1:-1][distance.argmin(axis=-1)])


def _peaks(signed: Float32Array, at: FloatArray, expected: FloatArray, window: float) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel place and height ``(K, n, s)`` of the highest step within ``window`` of where it is expected."""
    inside = np.abs(at - expected[..., None]) <= window
    inside[..., [0, -1]] = False
    k = np.where(inside, signed, -np.inf).argmax(axis=-1)[..., None]
    k = np.clip(k, 1, len(at) - 2)
    low, mid, high = (np.take_along_axis(signed, k + d, axis=-1)[..., 0].astype(np.float64) for d in (-1, 0, 1))
    bend = low - 2 * mid + high
    shift = np.where(bend < -_EPS, 0.5 * (low - high) / np.minimum(bend, -_EPS), 0.0)
    return at[k[..., 0]] + np.clip(shift, -0.75, 0.75), mid


def _robust_line(
    x: FloatArray, y: FloatArray, weight: FloatArray, start: FloatArray, rounds: int = 4
) -> tuple[FloatArray, FloatArray]:
    """Middle and slope ``(K, n)`` of y ``(K, n, s)`` over x ``(s,)``: weighted least squares with Cauchy weights."""
    weight = np.maximum(weight, 0.0) + 1e-6
    # The first residuals are taken from the median line, which a minority of bad samples cannot tilt.
    residual = y - start - np.median(y - start, axis=-1, keepdims=True)
    for _ in range(rounds):
        w = weight / (1.0 + (residual / _ROBUST_PX) ** 2)
        total = w.sum(axis=-1)
        mx, my = (w * x).sum(axis=-1) / total, (w * y).sum(axis=-1) / total
        dx, dy = x - mx[..., None], y - my[..., None]
        slope = (w * dx * dy).sum(axis=-1) / ((w * dx * dx).sum(axis=-1) + _EPS)
        middle = my - slope * mx
        residual = y - (middle[..., None] + slope[..., None] * x)
    return middle, slope


def _corners(frames: _Frames, middle: FloatArray, slope: FloatArray) -> FloatArray:
    """Corners ``(K, n, 2)``: corner i where the lines of edges i - 1 and i meet."""
    a = frames.start + frames.normal * (middle - 0.5 * slope)[..., None]
    d = frames.along + frames.normal * slope[..., None]
    before_a, before_d = np.roll(a, 1, axis=1), np.roll(d, 1, axis=1)
    det = before_d[..., 0] * d[..., 1] - before_d[..., 1] * d[..., 0]
    size = np.linalg.norm(d, axis=-1) * np.linalg.norm(before_d, axis=-1)
    det = np.where(np.abs(det) < 0.05 * size, np.nan, det)
    gap = a - before_a
    t = (gap[..., 0] * d[..., 1] - gap[..., 1] * d[..., 0]) / det
    return np.asarray(before_a + t[..., None] * before_d)
