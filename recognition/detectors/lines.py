"""Robust straight-line fits to edge samples and intersections of neighbouring sides, for many polygons at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def fit_offset_lines(
    along: FloatArray, distance: FloatArray, usable: BoolArray, inside: BoolArray, tolerance_px: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit ``distance = offset + slope * along`` to the samples of each side, robustly.

    Starts from the median and reweights (Tukey's biweight, shrinking): ivy, bars or a neighbour's edge are voted down.

    Args:
        along: ``(S,)`` positions along a side, -1..1.
        distance: ``(..., S)`` edge position along the normal, pixels.
        usable: ``(..., S)`` samples at which an edge was seen.
        inside: ``(..., S)`` samples that lie in the picture.
        tolerance_px: a sample within this distance of the line supports it.

    Returns:
        offset ``(...)`` px at the middle, slope ``(...)`` px per half side, support ``(...)``: share of the samples
        inside the picture that are usable and within the tolerance.
    """
    masked = np.where(usable, distance, np.nan)
    some = usable.any(axis=-1)
    masked[~some] = 0.0
    offset = np.nanmedian(masked, axis=-1)
    slope = np.zeros_like(offset)
    for scale in (4.0, 2.5, 1.5):
        residual = distance - offset[..., None] - slope[..., None] * along
        weight = usable * np.clip(1 - (residual / scale) ** 2, 0.0, 1.0) ** 2
        offset, slope = _weighted_line(along, distance, weight, offset, slope)
    near = np.abs(distance - offset[..., None] - slope[..., None] * along) <= tolerance_px
    support = (near & usable).sum(axis=-1) / np.maximum(inside.sum(axis=-1), 1)
    return offset, slope, support


def _weighted_line(
    along: FloatArray, distance: FloatArray, weight: FloatArray, offset: FloatArray, slope: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Closed-form weighted line; where the samples do not determine one, the last line is kept."""
    s0 = weight.sum(axis=-1)
    s1 = (weight * along).sum(axis=-1)
    s2 = (weight * along**2).sum(axis=-1)
    t0 = (weight * distance).sum(axis=-1)
    t1 = (weight * along * distance).sum(axis=-1)
    determinant = s0 * s2 - s1**2
    fine = (determinant > 1e-3 * np.maximum(s0, 1e-9) ** 2) & (s0 > 1.0)
    safe = np.where(fine, determinant, 1.0)
    return (
        np.where(fine, (s2 * t0 - s1 * t1) / safe, offset),
        np.where(fine, (s0 * t1 - s1 * t0) / safe, slope),
    )


def intersect_sides(start: FloatArray, end: FloatArray, fallback: FloatArray, limit_px: float = 25.0) -> FloatArray:
    """Corners ``(K, n, 2)``: corner i is where side i - 1 meets side i.

    Args:
        start, end: ``(K, n, 2)`` two points on each side's line, in order round the polygon.
        fallback: ``(K, n, 2)`` corners used where neighbouring sides are nearly parallel, or meet further than
            ``limit_px`` from the fallback.
    """
    direction = end - start
    before, before_direction = np.roll(start, 1, axis=1), np.roll(direction, 1, axis=1)
    cross = before_direction[..., 0] * direction[..., 1] - before_direction[..., 1] * direction[..., 0]
    size = np.linalg.norm(direction, axis=-1) * np.linalg.norm(before_direction, axis=-1)
    fine = np.abs(cross) > 0.02 * np.maximum(size, 1e-12)
    gap = start - before
    share = (gap[..., 0] * direction[..., 1] - gap[..., 1] * direction[..., 0]) / np.where(fine, cross, 1.0)
    corners = before + share[..., None] * before_direction
    fine &= np.linalg.norm(corners - fallback, axis=-1) <= limit_px
    return np.asarray(np.where(fine[..., None], corners, fallback))
