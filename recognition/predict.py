"""What each hypothesis would see from each candidate pose: the one predictor that all policies share.

Shape legend: K candidates, M hypotheses (a weighted sample), F features of a picture (class and place in it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.expected import cameras_at, in_view_of_all
from recognition.geometry import Mount
from recognition.kernels.pictures import in_cells, in_common, middles
from recognition.pose_gain import Shown, pose_bits
from recognition.seen import Seen
from recognition.tracking import World
from recognition.visibility import LEAST_COSINE, LEAST_PART_PX, Pairs, bounding_box
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CELLS_ACROSS = 20
"""A picture is divided into so many cells across; parts this near look alike to a planner."""
_POSE_MATTERS = 0.3
_BORDER_SHARE, _SHIFT_SHARE = 0.04, 0.25
_RESOLVED_PX = 20.0
"""A part whose lesser side is as long as this is surely resolved; one of ``LEAST_PART_PX`` not at all (the likelihood's
doubts begin half-way)."""
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
        shown: the parts behind the pictures.
    """

    weight: FloatArray
    rows: IntArray
    pictures: list[Pictures] = field(repr=False)
    expected: FloatArray = field(repr=False)
    pose_bits: FloatArray = field(repr=False)
    shown: Shown = field(repr=False)


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
    pairs = in_view_of_all(world, hypotheses, cameras, internals, size, least_px=LEAST_PART_PX)
    candidate, which = np.divmod(pairs.hypothesis, max(m, 1))
    chance = _chance(pairs, size)
    shown = Shown(cameras, pairs, candidate, which, chance)
    middle = pairs.corners_px.mean(axis=1)
    look = world.layout.part_class[pairs.part]
    first = np.searchsorted(candidate, np.arange(k + 1))
    pictures = []
    for c, group in enumerate(groups):
        mine = slice(first[c], first[c + 1])
        pictures.append(_pictures(which[mine], middle[mine], look[mine], chance[mine], m, size, shifts=group is None))
    expected = np.zeros((k, m + 1))
    np.add.at(expected, (candidate, which), chance)
    bits = np.zeros(k)
    if len(weight) and weight[0] > _POSE_MATTERS:
        bits = pose_bits(world, hypotheses, views, shown, np.array([0]))[:, 0]
    return Prediction(np.append(weight, belief.none), rows, pictures, expected, bits, shown)


def _chance(pairs: Pairs, size: tuple[int, int]) -> FloatArray:
    """How surely each part ``(n,)`` is seen, 0..1: less near the frame's border, obliquely, or hardly resolved.

    Poses and lens are known roughly only; a part that a nudge hides must not tell one hypothesis from another.
    """
    low, high = bounding_box(pairs.corners_px)
    resolved = ((high - low).min(axis=1) - LEAST_PART_PX) / (_RESOLVED_PX - LEAST_PART_PX)
    inside = np.minimum(low, np.array(size) - 1 - high).min(axis=1) / (_BORDER_SHARE * size[0])
    squarely = (pairs.cosine - LEAST_COSINE) / LEAST_COSINE
    return np.asarray(np.clip([inside, squarely, resolved], 0.0, 1.0).prod(axis=0))


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
    centre = middles(which, middle, chance, m + 1)
    cell = size[0] / CELLS_ACROSS
    # Centred in a frame of twice the size, no part is lost wherever the middle is.
    across, down = 2 * CELLS_ACROSS + 2, int(2 * size[1] / cell) + 2

    def spread(shift: FloatArray) -> FloatArray:
        return in_cells(which, middle, shift, look, chance, m + 1, cell, across, down)

    cells = spread(np.zeros_like(centre))
    return Pictures(cells, spread(np.array(size) - centre) if shifts else None, centre)


def distances(pictures: Pictures, world: World, width: int) -> FloatArray:
    """``(M, M)`` expected log odds, nats, by which one predicted picture is told from another.

    Where the internals are unknown, a picture that is like another but for a shift is told from it only by how unlikely
    such a principal point is.
    """
    apart = _apart(pictures.cells)
    rates = world.rates
    each = -0.5 * float(np.log1p(-rates.found))
    nats = each * apart
    if pictures.about_middle is not None:
        off = (pictures.middle_px[:, None] - pictures.middle_px[None]) / (_CENTRE_SD * width)
        nats = np.minimum(nats, each * _apart(pictures.about_middle) + 0.5 * np.log1p(off**2).sum(axis=2))
    return np.asarray(np.minimum(nats, rates.view_cap))


def _apart(features: FloatArray) -> FloatArray:
    """``(M, M)`` by how many parts pictures ``(M, F)`` differ."""
    count = features.sum(axis=1)
    both = in_common(features)
    total = count[:, None] + count[None]
    # Shifts of a part of a cell are no evidence: unknown internals and uncertain poses move a picture as much.
    return np.asarray(np.maximum(total - 2.0 * both - _SHIFT_SHARE * total, 0.0) / (1.0 - _SHIFT_SHARE))


def information_bits(weight: FloatArray, distance: FloatArray) -> FloatArray:
    """Expected information ``(...)``, bits, of observations that tell i from j by ``distance[..., i, j]``.

    The pairwise-distance estimate of a mixture's entropy (Kolchinsky & Tracey 2017): 0 where all pictures agree, the
    whole entropy where all differ.
    """
    p = weight / weight.sum()
    mixed = np.exp(-distance) @ p
    return np.asarray(np.maximum(0.0, -np.log2(np.maximum(mixed, 1e-300)) @ p))
