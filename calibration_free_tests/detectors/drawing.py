"""Draw polygons with exactly known corners: coverage by supersampling, pixel (0, 0) being a pixel's centre."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_FACTOR = 8


def draw_polygon(image: FloatArray, corners_px: FloatArray, colour: float | tuple[float, float, float]) -> None:
    """Paint one polygon into a float picture ``(h, w)`` or ``(h, w, 3)``, in place, area-sampled."""
    low = np.maximum(np.floor(corners_px.min(0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(corners_px.max(0)).astype(int) + 3, [image.shape[1], image.shape[0]])
    width, height = high - low
    mask = np.zeros((height * _FACTOR, width * _FACTOR), np.uint8)
    # Fine pixel k covers [k, k + 1) / factor - 1/2 of the coarse axis, so its centre is (k + 1/2) / factor - 1/2.
    fine = (corners_px - low + 0.5) * _FACTOR - 0.5
    cv2.fillPoly(mask, [np.round(fine * 256).astype(np.int32)], 255, lineType=cv2.LINE_8, shift=8)
    coverage = cv2.resize(mask, (int(width), int(height)), interpolation=cv2.INTER_AREA).astype(np.float64) / 255
    region = image[low[1] : high[1], low[0] : high[0]]
    shape = coverage if image.ndim == 2 else coverage[..., None]
    region += shape * (np.asarray(colour) - region)


def as_photo(
    image: FloatArray, rng: np.random.Generator, noise: float = 2.0, blur: float = 0.7
) -> npt.NDArray[np.uint8]:
    """Blur slightly, add sensor noise, and round to 8 bits."""
    blurred = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
    return np.clip(np.round(blurred + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
