"""How much a view from each candidate would sharpen the pose of some hypotheses, by the estimator's own covariance.

Shape legend: K candidates, M hypotheses, R of them that are asked for, V views, N corners (padded; weight 0).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.hypotheses import Hypotheses
from recognition.seen import Seen
from recognition.tracking import World
from recognition.varpro import refine_batch
from recognition.visibility import Pairs

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_MOST_PARTS = 12
"""Parts of a view that are reckoned with; more sharpen a pose little further."""
_MOST_BITS = 40.0


@dataclass(frozen=True, slots=True)
class Shown:
    """The parts that M hypotheses expect from K candidates.

    Attributes:
        cameras: ``(K, 4)`` theta (radians) and centre (mm) in the rig frame.
        pairs: part and corners ``(n,)`` of all candidates together.
        candidate: ``(n,)`` rising; hypothesis: ``(n,)`` rising for each candidate.
        chance: ``(n,)`` how surely the part is seen, 0..1.
    """

    cameras: FloatArray = field(repr=False)
    pairs: Pairs = field(repr=False)
    candidate: IntArray = field(repr=False)
    hypothesis: IntArray = field(repr=False)
    chance: FloatArray = field(repr=False)


@dataclass(frozen=True, slots=True)
class _Corners:
    """Corners ``(R, N)`` as the estimator takes them."""

    points_mm: FloatArray
    pixels: FloatArray
    weight: FloatArray
    view: IntArray


def pose_bits(world: World, hypotheses: Hypotheses, views: list[Seen], shown: Shown, rows: IntArray) -> FloatArray:
    """``(K, R)`` halvings of the volume of position and pan that each candidate would bring to hypotheses ``rows``.

    Larger images of parts bring more, since corners are found to so many pixels; a view's internals are its own.
    """
    cameras = shown.cameras
    bits = np.zeros((len(cameras), len(rows)))
    old = _matched(world, hypotheses, views, rows)
    place = np.full(len(hypotheses), -1)
    place[rows] = np.arange(len(rows))
    mine = np.flatnonzero((place[shown.hypothesis] >= 0) & (shown.chance > 0.0))
    pair, start, which = np.unique(
        shown.candidate[mine] * len(rows) + place[shown.hypothesis[mine]], return_index=True, return_inverse=True
    )
    if len(pair) == 0 or old.view.shape[1] == 0:
        return bits
    candidate, row = np.divmod(pair, len(rows))
    new = _new_view(world, shown, mine, which, start, len(views) + candidate)
    both = _Corners(*(np.concatenate([getattr(old, f)[row], getattr(new, f)], axis=1) for f in _FIELDS))
    cams = np.concatenate([np.array([v.camera_row for v in views]), cameras])
    last = max(v.group for v in views) + 1
    group = np.array([v.group for v in views] + [last] * len(cameras))
    priors = world.priors(views[-1].image_size)
    before, after = (
        refine_batch(
            hypotheses.placement[rows[of]], c.points_mm, c.pixels, c.weight, c.view, cams, group, priors, iterations=0
        ).covariance
        for of, c in ((np.arange(len(rows)), old), (row, both))
    )
    bits[candidate, row] = _halvings(before[row], after)
    return bits


_FIELDS = ("points_mm", "pixels", "weight", "view")


def _matched(world: World, hypotheses: Hypotheses, views: list[Seen], rows: IntArray) -> _Corners:
    """All corners that hypotheses ``rows`` have matched so far."""
    layout, corners = world.layout, world.layout.corners_mm.shape[1]
    parts = np.concatenate([found.part[rows] for found in hypotheses.matches], axis=1)
    pixels = np.concatenate([found.corners_px[rows] for found in hypotheses.matches], axis=1)
    weight = np.concatenate([found.weight[rows] for found in hypotheses.matches], axis=1)
    view = np.concatenate([np.full(found.part.shape[1], n) for n, found in enumerate(hypotheses.matches)])
    # Matches first, so that as few columns as may be are carried.
    order = np.argsort(parts < 0, axis=1, kind="stable")[:, : int((parts >= 0).sum(axis=1).max(initial=0))]
    at = np.arange(len(rows))[:, None]
    used = parts[at, order] >= 0
    return _flat(
        _Corners(
            layout.corners_mm[parts[at, order]],
            pixels[at, order],
            np.repeat(np.where(used, weight[at, order], 0.0)[..., None], corners, axis=2),
            np.repeat(view[order][..., None], corners, axis=2),
        )
    )


def _new_view(world: World, shown: Shown, mine: IntArray, which: IntArray, start: IntArray, view: IntArray) -> _Corners:
    """The corners that a view would add, a row for each candidate and hypothesis that expect any."""
    number = np.arange(len(mine)) - start[which]
    few = number < _MOST_PARTS
    at, slot, rows = which[few], number[few], mine[few]
    corners = world.layout.corners_mm.shape[1]
    shape = (len(view), int(slot.max()) + 1, corners)
    # Padding has the first part's points, which lie in front of the camera, and no weight.
    points = np.repeat(world.layout.corners_mm[shown.pairs.part[mine[start]]][:, None], shape[1], axis=1)
    pixels = np.repeat(shown.pairs.corners_px[mine[start]][:, None], shape[1], axis=1)
    weight = np.zeros(shape)
    points[at, slot] = world.layout.corners_mm[shown.pairs.part[rows]]
    pixels[at, slot] = shown.pairs.corners_px[rows]
    sure = world.rates.found * np.sqrt(shown.chance[rows]) / max(1.0, world.rates.corner_sd_px)
    weight[at, slot] = sure[:, None]
    return _flat(_Corners(points, pixels, weight, np.broadcast_to(view[:, None, None], shape)))


def _flat(corners: _Corners) -> _Corners:
    """Parts and their corners in one axis."""
    rows = len(corners.view)
    return _Corners(
        np.ascontiguousarray(corners.points_mm.reshape(rows, -1, 3)),
        np.ascontiguousarray(corners.pixels.reshape(rows, -1, 2)),
        np.ascontiguousarray(corners.weight.reshape(rows, -1)),
        np.ascontiguousarray(corners.view.reshape(rows, -1)),
    )


def _halvings(before: FloatArray, after: FloatArray) -> FloatArray:
    """``(B,)`` bits by which volumes of covariances ``(B, 4, 4)`` shrink."""
    scale = np.sqrt(np.maximum(np.einsum("bii->bi", before), 1e-30))
    unit = scale[:, :, None] * scale[:, None, :]
    a, b = (np.linalg.slogdet(one / unit + 1e-12 * np.eye(4))[1] for one in (before, after))
    value = 0.5 * (a - b) / np.log(2.0)
    return np.asarray(np.where(np.isfinite(value), np.clip(value, 0.0, _MOST_BITS), 0.0))
