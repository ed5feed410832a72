"""Places that a single view suggests: every detection is tried as every part, and scored by its neighbours on the wall.

With one vertical wall and unknown internals the place is found through the wall's image alone (``wallfit``); scale,
focal length and principal point come in afterwards, as a few starts within the bench's weak bounds (design §4).

Shape legend: D detections, S shapes, A pairs (detection, shape), B pairs (detection, part), N neighbours on the wall.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from recognition.kernels.support import support
from recognition.layout import Layout
from recognition.seen import LEAST_CLASS_PROBABILITY, Seen
from recognition.settings import BenchBounds
from recognition.wallfit import fit_wall

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

NEIGHBOURS = 24
ASPECT_TOLERANCE = 0.05
_SAME_PLACE = 0.18
"""A neighbour is found where a detection lies within this fraction of its size, and has its size to this factor."""
_HIT, _MISS = 3.0, -0.7


@dataclass(frozen=True)
class Surroundings:
    """Neighbours of each part on its own wall.

    ``index`` ``(P, N)``, -1 padded, nearest first; ``middle_mm``, ``size_mm`` ``(P, N, 2)`` in the part's wall frame.
    """

    index: IntArray = field(repr=False)
    middle_mm: FloatArray = field(repr=False)
    size_mm: FloatArray = field(repr=False)


def surroundings(layout: Layout) -> Surroundings:
    """The nearest parts on the same wall (normals within 5 degrees, nearly in the part's plane)."""
    total = len(layout.part_ids)
    index = np.full((total, NEIGHBOURS), -1)
    middle, size = np.zeros((total, NEIGHBOURS, 2)), np.ones((total, NEIGHBOURS, 2))
    for start, end in pairwise(layout.first):
        centre, normal = layout.centre_mm[start:end], layout.normal[start:end]
        gap = centre[None] - centre[:, None]
        distance = np.linalg.norm(gap, axis=-1)
        off = np.abs(np.einsum("pqk,pk->pq", gap, normal))
        scale = layout.size_mm[start:end].max(axis=1)
        same = (normal @ normal.T > 0.996) & (off < 0.5 * scale[:, None]) & (distance > 0)
        order = np.argsort(np.where(same, distance, np.inf), axis=1)[:, :NEIGHBOURS]
        found = np.take_along_axis(same, order, axis=1)
        n = order.shape[1]
        index[start:end, :n] = np.where(found, order + start, -1)
        away = np.take_along_axis(gap, order[..., None], axis=1)
        along = np.einsum("pnk,pk->pn", away, layout.along[start:end])
        middle[start:end, :n] = np.stack([along, away[..., 1]], axis=-1)
        size[start:end, :n] = layout.size_mm[start:end][order]
    return Surroundings(index, middle, size)


@dataclass(frozen=True)
class Proposals:
    """Starts for hypotheses, best first: part tried, detection taken for it, placement, internals, and the score.

    ``placement`` ``(H, 4)`` phi (radians), d (mm); ``internals`` ``(H, 4)`` fx, fy, u0, v0.
    """

    part: IntArray
    detection: IntArray
    placement: FloatArray = field(repr=False)
    internals: FloatArray = field(repr=False)
    score: FloatArray = field(repr=False)


def focal_range(bounds: BenchBounds, width: int) -> tuple[float, float]:
    """Shortest and longest focal length, px, that the lens's range of view angles allows."""
    half = width / 2.0
    low = half / np.tan(np.radians(bounds.view_angle_max_deg) / 2)
    high = half / np.tan(np.radians(bounds.view_angle_min_deg) / 2)
    return float(low), float(high)


def propose(
    layout: Layout,
    around: Surroundings,
    seen: Seen,
    bounds: BenchBounds,
    *,
    anchors: int,
    most: int,
    per_part: int = 4,
    focals: int = 3,
) -> Proposals:
    """Try detections as parts, and keep the ``most`` best supported starts.

    Args:
        layout: the model base.
        around: its surroundings.
        seen: the view.
        bounds: distance and lens bounds of the bench.
        anchors: at most so many detections are tried, the detector's best.
        most: at most so many (detection, part) pairs are kept.
        per_part: detections that one part is proposed for, at most.
        focals: focal lengths tried for each, where the view leaves the focal length open.
    """
    chosen = np.arange(min(anchors, seen.count))
    if chosen.size == 0:
        return _none()
    detection, shape, numbers, low, high = _pairs(layout, seen, chosen, bounds)
    by_shape = [np.flatnonzero(layout.shape == s) for s in range(len(layout.shape_example))]
    lengths = np.array([len(by_shape[s]) for s in shape], dtype=np.int64)
    pair = np.repeat(np.arange(len(shape)), lengths)
    part = np.concatenate([by_shape[s] for s in shape]) if len(shape) else np.empty(0, dtype=np.int64)
    score = _support(around, seen, numbers[pair], part)
    keep = _best(score, part, most, per_part)
    pair, part, score = pair[keep], part[keep], score[keep]
    return _starts(layout, seen, part, detection[pair], numbers[pair], low[pair], high[pair], score, focals)


def _none() -> Proposals:
    nothing = np.empty(0, dtype=np.int64)
    return Proposals(nothing, nothing, np.empty((0, 4)), np.empty((0, 4)), np.empty(0))


def _pairs(
    layout: Layout, seen: Seen, chosen: IntArray, bounds: BenchBounds
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """(detection, shape) pairs that a camera within the bounds could see, their wall numbers and focal ranges."""
    example = layout.shape_example
    likely = seen.class_score[chosen][:, layout.part_class[example]] >= LEAST_CLASS_PROBABILITY
    likely &= seen.corner_count[chosen][:, None] == layout.corner_count[example][None]
    which, shape = np.nonzero(likely)
    detection = chosen[which]
    fit = fit_wall(layout.local_mm[example[shape]], seen.corners_px[detection], seen.sigma_px[detection])
    a, _, c, _, e, _ = np.moveaxis(fit.numbers, -1, 0)
    width = seen.image_size[0]
    cosine = (a - (width - 1) / 2.0 * c) / np.where(np.abs(e) > 1e-12, e, 1e-12)
    slack = ASPECT_TOLERANCE + 2.0 * seen.sigma_px[detection] / seen.size_px[detection].min(axis=1)
    f_low, f_high = focal_range(bounds, width)
    low = np.maximum(f_low, bounds.distance_min_mm * e)
    high = np.minimum(f_high, bounds.distance_max_mm * e)
    sine_least = np.sqrt(np.clip(1.0 - (cosine + slack) ** 2, 0.0, None))
    sine_most = np.sqrt(np.clip(1.0 - np.clip(cosine - slack, 0.0, None) ** 2, 0.0, None))
    steep = np.abs(c)
    low = np.maximum(low, sine_least * e / (steep + 3 * fit.c_sd))
    high = np.minimum(high, sine_most * e / np.maximum(steep - 3 * fit.c_sd, 1e-12))
    sound = (e > 0) & (cosine > 0.12) & (cosine < 1.0 + slack) & (low <= high)
    size = seen.size_px[detection].max(axis=1)
    sound &= fit.rms_px < 3.0 * seen.sigma_px[detection] + 0.02 * size
    return detection[sound], shape[sound], fit.numbers[sound], low[sound], high[sound]


def _support(around: Surroundings, seen: Seen, numbers: FloatArray, part: IntArray) -> FloatArray:
    """Score ``(B,)``: neighbours found where the wall's image predicts them, less those expected and not found."""
    width, height = seen.image_size
    return support(
        numbers,
        part,
        around.index,
        around.middle_mm,
        around.size_mm,
        seen.centre_px,
        seen.size_px,
        float(width),
        float(height),
        _SAME_PLACE,
        _HIT,
        _MISS,
    )


def _best(score: FloatArray, part: IntArray, most: int, per_part: int) -> IntArray:
    """The best pairs, at most a few for each part, so that one lucky lattice does not crowd out all other places."""
    order = np.argsort(-score, kind="stable")
    by_part = np.argsort(part[order], kind="stable")
    grouped = part[order][by_part]
    rank = np.empty(len(order), dtype=np.int64)
    rank[by_part] = np.arange(len(order)) - np.searchsorted(grouped, grouped)
    return order[rank < per_part][:most]


def _starts(
    layout: Layout,
    seen: Seen,
    part: IntArray,
    detection: IntArray,
    numbers: FloatArray,
    low: FloatArray,
    high: FloatArray,
    score: FloatArray,
    focals: int,
) -> Proposals:
    """Placements for each pair at a few focal lengths within its range."""
    steps = (np.arange(focals) + 0.5) / focals
    wide = np.log(high / low) > np.log(1.15)
    focal = np.where(wide[:, None], low[:, None] * (high / low)[:, None] ** steps, np.sqrt(low * high)[:, None])
    keep = wide[:, None] | (np.arange(focals) == 0)
    row, col = np.nonzero(keep)
    f = focal[row, col]
    a, b, c, d, e, g = np.moveaxis(numbers[row], -1, 0)
    width, height = seen.image_size
    u0, v_mid = (width - 1) / 2.0, (height - 1) / 2.0
    z0 = f / e
    alpha = np.arctan2(c * z0, (a - u0 * c) / e)
    # The horizon d / c tells v0 where the wall is seen obliquely; head-on the image centre has to do.
    tell = (c * height) ** 2 / ((c * height) ** 2 + 1e-4)
    v0 = tell * np.clip(np.divide(d, c, out=np.zeros_like(d), where=np.abs(c) > 1e-15), -height, 2 * height)
    v0 = v0 + (1 - tell) * v_mid
    at = np.stack([(b - u0) * z0 / f, (g - v0) * z0 / f, z0], axis=1)
    along = layout.along[part[row]]
    theta = np.arctan2(along[:, 2], along[:, 0]) - np.arctan2(np.sin(alpha), np.cos(alpha))
    phi, shift = place_from_camera(theta, at, layout.centre_mm[part[row]], seen)
    return Proposals(
        part=part[row],
        detection=detection[row],
        placement=np.concatenate([phi[:, None], shift], axis=1),
        internals=np.stack([f, f, np.full_like(f, u0), v0], axis=1),
        score=score[row],
    )


def place_from_camera(
    theta: FloatArray, at_cam: FloatArray, point_mm: FloatArray, seen: Seen
) -> tuple[FloatArray, FloatArray]:
    """Placement (phi ``(H,)``, d ``(H, 3)``) of an object turned by theta in the camera, with a point at ``at_cam``."""
    pan = np.radians(seen.camera.theta_deg)
    phi = theta - pan
    in_rig = _turn(-pan * np.ones_like(theta), at_cam) + seen.camera.centre_mm
    return phi, in_rig - _turn(phi, point_mm)


def _turn(angle: FloatArray, points: FloatArray) -> FloatArray:
    """Ry(angle) applied to points ``(H, 3)``."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([c * x + s * z, y, -s * x + c * z], axis=-1)
