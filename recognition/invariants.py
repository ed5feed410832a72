"""Inner camera invariants: ratios of pixel differences that do not depend on fx, fy, u0, v0.

J_ijk = (u_i - u_j) / (u_i - u_k) and K_ijk = (v_i - v_j) / (v_i - v_k), as the paper defines them. A coordinate of n
points has n - 2 independent ones, so n points give 2 (n - 2): four points for 4 degrees of freedom, five for 6.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.motion import State, normalise
from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SMALL = 0.05
"""A difference below this fraction of the coordinate's span counts as small."""


def ratio_invariants(coordinate: FloatArray, triplets: IntArray) -> FloatArray:
    """J of ``u`` (or K of ``v``): ``(..., n)`` coordinates and ``(m, 3)`` triplets (i, j, k) to ``(..., m)``."""
    at_i, at_j, at_k = (coordinate[..., triplets[:, c]] for c in range(3))
    return np.asarray((at_i - at_j) / (at_i - at_k))


def ratio_gradient(coordinate: FloatArray, triplets: IntArray) -> FloatArray:
    """Derivatives ``(m, n)`` of ``ratio_invariants`` of ``(n,)`` coordinates in those coordinates."""
    i, j, k = triplets.T
    numerator, denominator = coordinate[i] - coordinate[j], coordinate[i] - coordinate[k]
    out = np.zeros((len(triplets), len(coordinate)))
    row = np.arange(len(triplets))
    out[row, i] = 1.0 / denominator - numerator / denominator**2
    out[row, j] = -1.0 / denominator
    out[row, k] = numerator / denominator**2
    return out


def triplet_quality(numerator: FloatArray, denominator: FloatArray, span: float) -> FloatArray:
    """The paper's triplet rule as a number in [0, 1]: high if both differences are comparable and neither small."""
    small, large = np.minimum(abs(numerator), abs(denominator)), np.maximum(abs(numerator), abs(denominator))
    with np.errstate(divide="ignore", invalid="ignore"):
        comparable = np.where(large > 0, small / large, 0.0)
    return np.asarray(np.where(small < SMALL * span, 0.0, comparable * small / span))


def choose_triplets(coordinate: FloatArray) -> IntArray:
    """``(n - 2, 3)`` independent triplets of ``(n,)`` pixel coordinates that keep the triplet rule.

    Starts from the best triplet and lets every further point join two points that are already in, in the best way;
    each new triplet brings in a new point, which makes them independent. A point whose differences are all small
    (it coincides with others in this coordinate) still joins, by the least bad triplet with a large denominator.

    Raises:
        DegenerateGeometryError: fewer than three points, or all at one coordinate.
    """
    n = len(coordinate)
    span = float(np.ptp(coordinate)) if n else 0.0
    if n < 3 or span <= 0 or not np.isfinite(span):
        raise DegenerateGeometryError(
            f"invariants need three points that differ in the coordinate; got {n} over a span of {span:g} px"
        )
    every = _all_triplets(n)
    i, j, k = every.T
    numerator, denominator = coordinate[i] - coordinate[j], coordinate[i] - coordinate[k]
    score = triplet_quality(numerator, denominator, span)
    # Where the rule cannot be kept, a large denominator at least keeps the ratio finite.
    score = np.where(score > 0, 1.0 + score, abs(denominator) / span)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(denominator != 0, numerator / denominator, 0.0)
    # What J says of the point in each place, dJ/du times the denominator: nothing of i where j and k coincide.
    tells = np.minimum(np.stack([abs(1.0 - ratio), np.ones(len(ratio)), abs(ratio)], axis=1), 1.0)
    best = int(np.argmax(score * (SMALL + tells.min(axis=1))))
    chosen, inside = [best], np.zeros(n, dtype=bool)
    inside[every[best]] = True
    while not inside.all():
        new = ~inside[every]
        joins = new.sum(axis=1) == 1
        best = int(np.argmax(np.where(joins, score * (tells * new).sum(axis=1), -1.0)))
        chosen.append(best)
        inside[every[best]] = True
    return every[chosen]


def _all_triplets(n: int) -> IntArray:
    grid = np.stack([a.ravel() for a in np.meshgrid(*[np.arange(n)] * 3, indexing="ij")], axis=1)
    i, j, k = grid.T
    return np.asarray(grid[(i != j) & (j != k) & (i != k)])


def invariants_of_pose(state: State, points_mm: FloatArray, triplets_u: IntArray, triplets_v: IntArray) -> FloatArray:
    """The J, then the K, ``(m_u + m_v,)``, that one camera at the origin must see under a pose (H = 1)."""
    seen = normalise(state, points_mm[None], np.zeros((1, len(points_mm)), dtype=np.int64), np.zeros((1, 4)))
    return np.concatenate([ratio_invariants(seen.x[0], triplets_u), ratio_invariants(seen.y[0], triplets_v)])


def invariants_jacobian(state: State, points_mm: FloatArray, triplets_u: IntArray, triplets_v: IntArray) -> FloatArray:
    """Derivatives ``(m_u + m_v, P)`` of ``invariants_of_pose`` in the pose (radians and mm, see ``motion``)."""
    seen = normalise(state, points_mm[None], np.zeros((1, len(points_mm)), dtype=np.int64), np.zeros((1, 4)))
    return np.concatenate(
        [
            ratio_gradient(seen.x[0], triplets_u) @ seen.dx[0].T,
            ratio_gradient(seen.y[0], triplets_v) @ seen.dy[0].T,
        ]
    )
