"""Measure edge evidence along predicted outlines: the model-driven look at one picture.

For each side of each outline, colour profiles across the side are averaged along it (with a few small tilts); the
strongest step that keeps its sign and colour along the side is the edge, located to a fraction of a pixel sample by
sample and fitted robustly by a line. All outlines of a call are worked on at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from recognition.detectors.lines import fit_offset_lines, intersect_sides
from rig.hal import Image

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Float32Array = npt.NDArray[np.float32]

_SMOOTHING_PX = 1.0
_NOISE_LEVELS = 0.8
"""Gradients of this size, grey levels per pixel, count as noise; also the floor where the picture is flat."""
_NEARNESS, _OUTWARD = 0.5, 1 / 6
"""Spread and place of the edge expected, as shares of the radius. On photographs with predictions 3 px off, corners
within 3 px rose from 0.57 and 0.74 (wide, tele) without an expectation to 0.87 and 0.85."""
_TILTS_PX = (-2, -1, 0, 1, 2)
_BLOCKS = 4
_MAP_COLUMNS = 4096
"""cv2.remap refuses maps wider or taller than 32767, so samples are laid out in rows."""


@dataclass(frozen=True)
class OutlineEvidence:
    """What a picture says about K outlines of n corners.

    Attributes:
        offset_px: ``(K, n)`` signed distance of the edge found from the side's middle, positive outward; 0 where no
            edge was found. Side i runs from corner i to corner i + 1.
        support: ``(K, n)`` 0..1, share of the samples inside the picture that lie on the fitted edge.
        corners_px: ``(K, n, 2)`` corners of the outline with each supported side replaced by its fitted line.
        score: ``(K,)`` 0..1, how much the outline looks like one closed contour; sides outside the
            picture are left out.
        strength: ``(K, n)`` step height across each side, grey levels per pixel.
        visible: ``(K, n)`` share of each side's samples inside the picture.
    """

    offset_px: FloatArray
    support: FloatArray
    corners_px: FloatArray = field(repr=False)
    score: FloatArray
    strength: FloatArray = field(repr=False)
    visible: FloatArray = field(repr=False)


class EdgeField:
    """One picture, prepared once for many measurements: smoothed, in opponent colours.

    Opponent colours (light, red-blue, green-magenta): a painted frame may differ from its wall in hue alone.
    """

    def __init__(self, image: Image) -> None:
        self.height, self.width = int(image.shape[0]), int(image.shape[1])
        self.planes = opponent_planes(image)

    def sample(self, x_px: Float32Array, y_px: Float32Array) -> Float32Array:
        """Bilinear samples ``(..., c)`` at pixels ``(...)``; the border is repeated outside."""
        rows = max(1, -(-x_px.size // _MAP_COLUMNS))
        maps = np.zeros((2, rows * _MAP_COLUMNS), np.float32)
        maps[0, : x_px.size] = x_px.ravel()
        maps[1, : x_px.size] = y_px.ravel()
        x, y = maps.reshape(2, rows, _MAP_COLUMNS)
        values = cv2.remap(self.planes, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        channels = self.planes.shape[2]
        return np.asarray(values.reshape(-1, channels)[: x_px.size].reshape(*x_px.shape, channels))


def opponent_planes(image: Image) -> Float32Array:
    """Smoothed ``(h, w, 3)`` light, red-blue and green-magenta (``(h, w, 1)`` for a grey picture), float32."""
    if image.ndim == 2:
        grey = image.astype(np.float32)
        return np.asarray(cv2.GaussianBlur(grey, (0, 0), _SMOOTHING_PX).reshape(*image.shape, 1))
    mixing = np.array([[1 / 3, 1 / 3, 1 / 3], [-0.7, 0.0, 0.7], [-0.35, 0.7, -0.35]], np.float32)
    opponent = cv2.transform(image.astype(np.float32), mixing)
    return np.asarray(cv2.GaussianBlur(opponent, (0, 0), _SMOOTHING_PX))


def measure_outlines(
    edge_field: EdgeField, polygons_px: FloatArray, radius_px: float = 6.0, samples: int = 16
) -> OutlineEvidence:
    """Look for the edges of predicted outlines within ``radius_px`` of each side.

    Args:
        edge_field: the prepared picture.
        polygons_px: ``(K, n, 2)`` corners of the outlines, in either sense of rotation.
        radius_px: how far from the prediction an edge may lie, along the side's normal.
        samples: profiles per side, a multiple of 4.

    Raises:
        ValueError: ``samples`` is not a multiple of 4, or the shape is wrong.
    """
    if polygons_px.ndim != 3 or polygons_px.shape[2] != 2 or samples % _BLOCKS or samples <= 0:
        raise ValueError(f"need (K, n, 2) outlines and samples a multiple of {_BLOCKS}: {polygons_px.shape}, {samples}")
    polygons = np.asarray(polygons_px, np.float64)
    reach = max(1, round(radius_px))
    frame = _side_frames(polygons, samples)
    gradients, inside = _gradients_across(edge_field, frame, reach)
    middle, tilt, colour = _strongest_step(gradients, reach)
    distance, value = _edge_per_sample(gradients, colour, middle, tilt, frame.along, reach)
    strength, on_edge = _on_edge(value, inside)
    offset, slope, support = fit_offset_lines(frame.along, distance, on_edge, inside)
    visible = inside.mean(axis=-1)
    trusted = (support >= 0.3) & (visible > 0)
    offset = np.where(trusted, offset, 0.0)
    slope = np.where(trusted, slope, 0.0)
    corners = intersect_sides(
        frame.centre + (offset[..., None] - slope[..., None]) * frame.normal - frame.half,
        frame.centre + (offset[..., None] + slope[..., None]) * frame.normal + frame.half,
        fallback=polygons,
    )
    score = _closed_contour_score(support, strength, visible)
    return OutlineEvidence(offset, support, corners, score, strength, visible)


@dataclass(frozen=True)
class _SideFrames:
    """Local frames of the sides: middle, half vector, outward unit normal (K, n, 2) each; ``along`` (S,) in -1..1."""

    centre: FloatArray
    half: FloatArray
    normal: FloatArray
    along: FloatArray


def _side_frames(polygons: FloatArray, samples: int) -> _SideFrames:
    following = np.roll(polygons, -1, axis=1)
    half = (following - polygons) / 2
    length = np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
    cross = polygons[..., 0] * following[..., 1] - polygons[..., 1] * following[..., 0]
    turn = np.where(cross.sum(axis=1) >= 0, 1.0, -1.0)[:, None, None]
    normal = turn * np.stack([half[..., 1], -half[..., 0]], axis=-1) / length
    # The ends of a side are left out: there its profile crosses the neighbouring side.
    along = 0.88 * (2 * (np.arange(samples) + 0.5) / samples - 1)
    return _SideFrames((polygons + following) / 2, half, normal, along)


def _gradients_across(edge_field: EdgeField, frame: _SideFrames, reach: int) -> tuple[Float32Array, BoolArray]:
    """Colour gradients along the outward normals ``(K, n, S, 2 reach + 1, c)``; which samples are in the picture."""
    steps = np.arange(-reach - 1, reach + 2, dtype=np.float32)
    limits = (edge_field.width - 1, edge_field.height - 1)
    inside = np.ones((*frame.centre.shape[:2], len(frame.along)), bool)
    points = []
    for axis, limit in enumerate(limits):
        base = frame.centre[..., axis, None] + frame.along * frame.half[..., axis, None]
        inside &= (base >= 0) & (base <= limit)
        across = frame.normal.astype(np.float32)[..., axis, None, None] * steps
        points.append(base.astype(np.float32)[..., None] + across)
    values = edge_field.sample(points[0], points[1])
    gradients = values[..., 2:, :] - values[..., :-2, :]
    gradients *= 0.5 * inside[..., None, None].astype(np.float32)
    return gradients, inside


def _strongest_step(gradients: Float32Array, reach: int) -> tuple[FloatArray, FloatArray, Float32Array]:
    """Offset and tilt (px) of each side's strongest consistent step, and its unit colour direction."""
    K, n, S, D, C = gradients.shape
    blocks = gradients.reshape(K, n, _BLOCKS, S // _BLOCKS, D, C).mean(axis=3)
    centres = 2 * (np.arange(_BLOCKS) + 0.5) / _BLOCKS - 1
    padded = np.pad(blocks, ((0, 0), (0, 0), (0, 0), (2, 2), (0, 0)))
    sums = []
    for tilt in _TILTS_PX:
        shift = np.round(tilt * centres).astype(int) + 2
        sums.append(sum(padded[:, :, b, shift[b] : shift[b] + D] for b in range(_BLOCKS)) / _BLOCKS)
    steps = np.stack(sums, axis=2)
    height = np.linalg.norm(steps, axis=-1)
    # Near to what was predicted, yet a little outward: a window's frame, reveal and panes lie inside its outline.
    distance = np.arange(-reach, reach + 1) / reach
    expected = np.exp(-0.5 * ((distance - _OUTWARD) / _NEARNESS) ** 2)
    height = height * expected * (1 - 0.05 * np.abs(np.array(_TILTS_PX)))[:, None]
    best = height.reshape(K, n, len(_TILTS_PX) * D).argmax(axis=-1)
    tilt_index, offset_index = np.divmod(best, D)
    colour = np.take_along_axis(steps.reshape(K, n, len(_TILTS_PX) * D, C), best[..., None, None], axis=2)[:, :, 0]
    colour = colour / np.maximum(np.linalg.norm(colour, axis=-1, keepdims=True), 1e-6)
    return (offset_index - reach).astype(np.float64), np.array(_TILTS_PX, np.float64)[tilt_index], colour


def _edge_per_sample(
    gradients: Float32Array,
    colour: Float32Array,
    middle: FloatArray,
    tilt: FloatArray,
    along: FloatArray,
    reach: int,
) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel edge position along the normal and gradient there ``(K, n, S)``, within 2 px of the rough line."""
    signed = np.einsum("knsdc,knc->knsd", gradients, colour, optimize=True)
    line = middle[..., None] + tilt[..., None] * along
    start = np.clip(np.round(line).astype(int) + reach - 2, 0, max(2 * reach - 4, 0))
    width = min(5, signed.shape[-1])
    # Only true peaks count: the flank of a stronger neighbouring edge may be higher, but is no edge.
    peaked = np.zeros_like(signed)
    centre = signed[..., 1:-1]
    crest = (centre >= signed[..., :-2]) & (centre >= signed[..., 2:])
    peaked[..., 1:-1] = np.where(crest, centre, 0.0)
    peak = np.take_along_axis(peaked, start[..., None] + np.arange(width), axis=-1).argmax(axis=-1)
    inner = np.clip(start + peak, 1, 2 * reach - 1)
    left, top, right = np.moveaxis(np.take_along_axis(signed, inner[..., None] + np.array([-1, 0, 1]), axis=-1), -1, 0)
    bend = left - 2 * top + right
    shift = np.where(bend < -1e-6, 0.5 * (left - right) / np.where(bend < -1e-6, bend, -1.0), 0.0)
    top = np.where((top >= left) & (top >= right), top, 0.0)
    return (inner - reach + np.clip(shift, -0.5, 0.5)).astype(np.float64), top.astype(np.float64)


def _on_edge(value: FloatArray, inside: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Step height of each side (median over its samples), and which samples reach a fair part of it."""
    strength = np.maximum(np.median(value, axis=-1), 0.0)
    return strength, inside & (value > np.maximum(0.35 * strength, _NOISE_LEVELS)[..., None])


def _closed_contour_score(support: FloatArray, strength: FloatArray, visible: FloatArray) -> FloatArray:
    """Mean evidence of the sides that are in the picture, the weakest side counting twice (one side may be hidden)."""
    evidence = support * strength / (strength + 2 * _NOISE_LEVELS)
    weight = (visible >= 0.5).astype(np.float64)
    weakest = np.where(weight > 0, evidence, 1.0).min(axis=1)
    total = weight.sum(axis=1)
    score = ((evidence * weight).sum(axis=1) + weakest) / (total + 1)
    return np.where(total > 0, score, 0.0)
