"""What each hypothesis would see from each candidate pose: the one predictor that all policies share.

Shape legend: K candidates, M hypotheses (a weighted sample), F features of a picture (class and place in it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.expected import cameras_at, in_view_of_all
from recognition.geometry import Mount
from recognition.hypotheses import Hypotheses
from recognition.seen import Seen
from recognition.tracking import World
from recognition.varpro import refine_batch
from recognition.visibility import LEAST_COSINE, Pairs, bounding_box
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CELLS_ACROSS = 20
"""A picture is divided into so many cells across; parts this near look alike to a planner."""
_POSE_CANDIDATES, _POSE_MATTERS = 40, 0.3
_BORDER_SHARE, _SHIFT_SHARE = 0.04, 0.25
_CENTRE_SD = 0.03
"""How far the principal point of a view may be off, in widths (`Priors.principal_point_sd`)."""


@dataclass(frozen=True, slots=True)
class Pictures:
    """What M hypotheses would see from one candidate; F features: how much of a part of a class stands in each cell.

    Attributes:
        cells: ``(M, F)`` with parts where they are expected.
        about_middle: ``(M, F')`` with parts as they lie about the picture's middle: all that a view tells whose
            internals are unknown, but for the shift. ``None`` where they are known.
        middle_px: ``(M, 2)`` the middle of the parts in each picture.
    """

    cells: FloatArray
    about_middle: FloatArray | None
    middle_px: FloatArray


@dataclass(frozen=True)
class Prediction:
    """Predicted pictures of a sample of hypotheses.

    Attributes:
        weight: ``(M,)`` probabilities of the sample and, last, of "none of these", which expects no parts.
        rows: ``(M - 1,)`` the sample's rows in the belief.
        pictures: what they would see from each candidate.
        expected: ``(K, M)`` number of parts expected; those that may as well be just out of sight count less.
        pose_bits: ``(K,)`` expected information about the leading hypothesis's pose, bits.
    """

    weight: FloatArray
    rows: IntArray
    pictures: list[Pictures] = field(repr=False)
    expected: FloatArray = field(repr=False)
    pose_bits: FloatArray = field(repr=False)


def sample(belief: Belief, most: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """A weighted sample of hypotheses: the most probable half, the rest drawn; with their probabilities."""
    p = belief.probability
    if len(p) <= most:
        return np.arange(len(p)), p
    head = np.arange(most // 2)
    rest = np.arange(most // 2, len(p))
    mass = p[rest].sum()
    if mass <= 0:
        return head, p[head]
    drawn = rng.choice(rest, size=most - len(head), p=p[rest] / mass)
    rows, counts = np.unique(drawn, return_counts=True)
    weight = np.concatenate([p[head], mass * counts / counts.sum()])
    return np.concatenate([head, rows]), weight


def predict(
    world: World,
    belief: Belief,
    views: list[Seen],
    candidates: Sequence[RigPose],
    groups: Sequence[int | None],
    mount: Mount,
    *,
    most: int,
    rng: np.random.Generator,
) -> Prediction:
    """Predict what a sample of the belief would see from every candidate.

    Args:
        world: what stays the same.
        belief: after the last view.
        views: all views.
        candidates: K poses.
        groups: the internals group of each candidate, ``None`` for one that has not been seen.
        mount: the camera's lever arm.
        most: size of the sample.
        rng: draws the sample.
    """
    rows, weight = sample(belief, most, rng)
    hypotheses = belief.hypotheses.take(rows)
    size = views[-1].image_size
    k, m = len(candidates), len(rows)
    cameras, internals = cameras_at(world, hypotheses, views, candidates, groups, mount)
    pairs = in_view_of_all(world, hypotheses, cameras, internals, size)
    candidate, which = np.divmod(pairs.hypothesis, m)
    middle = pairs.corners_px.mean(axis=1)
    look = world.layout.part_class[pairs.part]
    chance = _chance(pairs, size)
    pictures = []
    for c, group in enumerate(groups):
        mine = np.flatnonzero(candidate == c)
        pictures.append(_pictures(which[mine], middle[mine], look[mine], chance[mine], m, size, shifts=group is None))
    expected = np.zeros((k, m + 1))
    np.add.at(expected, (candidate, which), chance)
    bits = np.zeros(k)
    if len(weight) and weight[0] > _POSE_MATTERS:
        bits = _pose_bits(world, hypotheses, views, cameras, pairs, candidate, which)
    return Prediction(np.append(weight, belief.none), rows, pictures, expected, bits)


def _chance(pairs: Pairs, size: tuple[int, int]) -> FloatArray:
    """How surely each part ``(n,)`` is seen, 0..1: less near the frame's border, or so obliquely that it soon is not.

    Poses are known to some millimetres only; a part that a nudge hides must not tell one hypothesis from another.
    """
    low, high = bounding_box(pairs.corners_px)
    inside = np.minimum(low, np.array(size) - 1 - high).min(axis=1) / (_BORDER_SHARE * size[0])
    squarely = (pairs.cosine - LEAST_COSINE) / LEAST_COSINE
    return np.asarray(np.clip(inside, 0.0, 1.0) * np.clip(squarely, 0.0, 1.0))


def _pictures(
    which: IntArray,
    middle: FloatArray,
    look: IntArray,
    chance: FloatArray,
    m: int,
    size: tuple[int, int],
    *,
    shifts: bool,
) -> Pictures:
    """Pictures of one candidate; ``shifts``: its internals are unknown, so a picture may lie elsewhere as a whole."""
    total = np.zeros((m + 1, 2))
    np.add.at(total, which, chance[:, None] * middle)
    amount = np.bincount(which, weights=chance, minlength=m + 1)
    centre = total / np.maximum(amount, 1e-9)[:, None]
    cells = _cells(which, middle, look, chance, m, size)
    if not shifts:
        return Pictures(cells, None, centre)
    return Pictures(cells, _cells(which, middle - centre[which] + np.array(size), look, chance, m, size), centre)


def _cells(
    which: IntArray, middle: FloatArray, look: IntArray, chance: FloatArray, m: int, size: tuple[int, int]
) -> FloatArray:
    """Feature matrix ``(m + 1, F)``: bilinear in the cells, parts a cell apart do not overlap; last row empty."""
    cell = size[0] / CELLS_ACROSS
    place = middle / cell
    low = np.floor(place).astype(np.int64)
    part = place - low
    keys, rows, values = [], [], []
    for du in (0, 1):
        for dv in (0, 1):
            weight = np.abs(1 - du - part[:, 0]) * np.abs(1 - dv - part[:, 1])
            keys.append((look * 1000 + low[:, 1] + dv) * 1000 + low[:, 0] + du)
            rows.append(which)
            values.append(chance * weight)
    unique, column = np.unique(np.concatenate(keys), return_inverse=True)
    features = np.zeros((m + 1, len(unique)))
    np.add.at(features, (np.concatenate(rows), column), np.concatenate(values))
    return features


def distances(pictures: Pictures, world: World, width: int) -> FloatArray:
    """``(M, M)`` expected log odds, nats, by which one predicted picture is told from another.

    Where the internals are unknown, a picture that is like another but for a shift is told from it only by how unlikely
    such a principal point is.
    """
    apart = _apart(pictures.cells)
    rates = world.rates
    each = 0.5 * rates.found * min(rates.part_cap, 6.0)
    nats = each * apart
    if pictures.about_middle is not None:
        off = (pictures.middle_px[:, None] - pictures.middle_px[None]) / (_CENTRE_SD * width)
        nats = np.minimum(nats, each * _apart(pictures.about_middle) + 0.5 * np.log1p(off**2).sum(axis=2))
    return np.asarray(np.minimum(nats, rates.view_cap))


def _apart(features: FloatArray) -> FloatArray:
    """``(M, M)`` by how many parts pictures ``(M, F)`` differ."""
    count = features.sum(axis=1)
    both = np.minimum(features[:, None], features[None]).sum(axis=2)
    total = count[:, None] + count[None]
    # Shifts of a part of a cell are no evidence: unknown internals and uncertain poses move a picture as much.
    return np.asarray(np.maximum(total - 2.0 * both - _SHIFT_SHARE * total, 0.0) / (1.0 - _SHIFT_SHARE))


def information_bits(weight: FloatArray, distance: FloatArray) -> float:
    """Expected information, bits, of an observation that tells i from j by ``distance[i, j]``.

    The pairwise-distance estimate of a mixture's entropy (Kolchinsky & Tracey 2017): 0 where all pictures agree, the
    whole entropy where all differ.
    """
    p = weight / weight.sum()
    mixed = np.exp(-distance) @ p
    return max(0.0, float(-(p * np.log2(np.maximum(mixed, 1e-300))).sum()))


def _pose_bits(
    world: World,
    hypotheses: Hypotheses,
    views: list[Seen],
    cameras: FloatArray,
    pairs: Pairs,
    candidate: IntArray,
    which: IntArray,
) -> FloatArray:
    """Bits by which each candidate would sharpen the leading hypothesis's camera position."""
    k = len(cameras)
    bits = np.zeros(k)
    if len(hypotheses) == 0:
        return bits
    corners = world.layout.corners_mm.shape[1]
    old_points, old_px, old_weight, old_view = [], [], [], []
    for n, found in enumerate(hypotheses.matches):
        part = found.part[0]
        used = part >= 0
        old_points.append(world.layout.corners_mm[part[used]].reshape(-1, 3))
        old_px.append(found.corners_px[0][used].reshape(-1, 2))
        old_weight.append(np.repeat(found.weight[0][used], corners))
        old_view.append(np.full(used.sum() * corners, n))
    base = [np.concatenate(a) for a in (old_points, old_px, old_weight, old_view)]
    mine = np.flatnonzero(which == 0)
    counts = np.bincount(candidate[mine], minlength=k)
    # The fits are costly, so only the candidates that show the most parts are tried.
    counts[np.argsort(-counts, kind="stable")[_POSE_CANDIDATES:]] = 0
    room = min(int(counts.max(initial=0)), 12)
    if room == 0 or len(base[0]) == 0:
        return bits
    extra = room * corners
    n_old = len(base[0])
    points = np.zeros((k, n_old + extra, 3))
    pixels = np.zeros((k, n_old + extra, 2))
    weight = np.zeros((k, n_old + extra))
    view = np.full((k, n_old + extra), len(views))
    points[:, :n_old], pixels[:, :n_old], weight[:, :n_old], view[:, :n_old] = base
    points[:, n_old:] = base[0][0]
    for c in range(k):
        rows = mine[candidate[mine] == c][:room]
        span = slice(n_old, n_old + len(rows) * corners)
        points[c, span] = world.layout.corners_mm[pairs.part[rows]].reshape(-1, 3)
        pixels[c, span] = pairs.corners_px[rows].reshape(-1, 2)
        weight[c, span] = world.rates.found / max(1.0, world.rates.corner_sd_px)
    # The new view's internals: its own, for lack of better knowledge (a locked zoom would only add to the gain).
    group = np.array([v.group for v in views] + [max(v.group for v in views) + 1])
    cams = np.array([v.camera_row for v in views])
    priors = world.priors(views[-1].image_size)
    start = hypotheses.placement[:1]
    before = refine_batch(
        start, base[0][None], base[1][None], base[2][None], base[3][None], cams, group[:-1], priors, iterations=0
    )
    for c in range(k):
        if counts[c] == 0:
            continue
        one = slice(c, c + 1)
        both = np.concatenate([cams, cameras[one]])
        after = refine_batch(start, points[one], pixels[one], weight[one], view[one], both, group, priors, iterations=0)
        bits[c] = _position_bits(before.covariance[0], after.covariance[0])
    return bits


def _position_bits(before: FloatArray, after: FloatArray) -> float:
    """Halvings of the volume of position and pan."""
    scale = np.sqrt(np.maximum(np.diag(before), 1e-30))
    a = np.linalg.slogdet(before / np.outer(scale, scale) + 1e-12 * np.eye(4))[1]
    b = np.linalg.slogdet(after / np.outer(scale, scale) + 1e-12 * np.eye(4))[1]
    value = 0.5 * (a - b) / np.log(2.0)
    return float(np.clip(value, 0.0, 40.0)) if np.isfinite(value) else 0.0


def only(prediction: Prediction, keep: IntArray) -> Prediction:
    """The prediction for some of the candidates."""
    return replace(
        prediction,
        pictures=[prediction.pictures[int(c)] for c in keep],
        expected=prediction.expected[keep],
        pose_bits=prediction.pose_bits[keep],
    )
