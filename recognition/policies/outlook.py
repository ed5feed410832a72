"""What candidates would tell of hypotheses, as plain numbers: all that a policy's rule looks at.

A rule scores it, and need not know whether the hypotheses are places on a building or rows of a made-up table.

Shape legend: K candidates, M hypotheses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.predict import information_bits

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SURELY_NATS = 40.0
"""Observations this far apart are never taken for each other."""
SAME_NATS = 1.5
"""Pictures nearer to each other than this count as one where a rule knows only same and different."""


@dataclass(frozen=True)
class Outlook:
    """What would be told, and for what.

    Attributes:
        weight: ``(M,)`` of the hypotheses, above 0; "none of these" is one of them.
        apart: ``(K, M, M)`` nats by which a view tells one hypothesis, the row, from another; symmetric.
        cost_s: ``(K,)`` seconds of each view, travel included, above 0.
        place: ``(M,)`` number of the object and place that a hypothesis stands for.
        object_of: ``(M,)`` number of its object.
    """

    weight: FloatArray
    apart: FloatArray = field(repr=False)
    cost_s: FloatArray
    place: IntArray
    object_of: IntArray

    @staticmethod
    def of_table(observation: IntArray, weight: FloatArray, cost_s: FloatArray | None = None) -> Outlook:
        """Of hypotheses of which each shows one thing ``(K, M)`` from each candidate, as numbers, without any error."""
        views, many = observation.shape
        apart = np.where(observation[:, :, None] == observation[:, None, :], 0.0, SURELY_NATS)
        each = np.arange(many)
        return Outlook(weight, apart, np.ones(views) if cost_s is None else cost_s, each, each)

    def among(self, members: Sequence[int]) -> Outlook:
        """Where only these hypotheses are left."""
        rows = np.asarray(members)
        apart = self.apart[:, rows[:, None], rows]
        return Outlook(self.weight[rows], apart, self.cost_s, self.place[rows], self.object_of[rows])

    @property
    def probability(self) -> FloatArray:
        """``(M,)`` weights that sum to 1."""
        return np.asarray(self.weight / self.weight.sum())

    @property
    def alike(self) -> FloatArray:
        """``(K, M, M)`` how likely a view that shows one hypothesis is under another, beside its own likelihood."""
        return np.asarray(np.exp(-self.apart))

    @property
    def bits(self) -> FloatArray:
        """``(K,)`` expected information about the hypotheses."""
        return information_bits(self.weight, self.apart)

    def entropy_left(self, likelihood: FloatArray) -> FloatArray:
        """``(K,)`` bits expected to be left where the row's picture has ``likelihood`` ``(K, M, M)`` under columns."""
        after = likelihood * self.probability
        after = after / after.sum(axis=2, keepdims=True)
        return entropy_bits(after) @ self.probability


def entropy_bits(probability: FloatArray) -> FloatArray:
    """``(...)`` of distributions ``(..., M)``."""
    return np.asarray(-(probability * np.log2(np.maximum(probability, 1e-300))).sum(axis=-1))


def classes(outlook: Outlook, same_nats: float = SAME_NATS) -> IntArray:
    """``(K, M)`` observation-equivalence class of each hypothesis in each view, by number of its heaviest member.

    In order of weight, each joins the nearest head of a class if that looks the same, or else heads one of its own.
    """
    views, many = outlook.apart.shape[:2]
    member, every = np.empty((views, many), dtype=np.int64), np.arange(views)
    to_head = np.full((views, many), np.inf)
    heads = np.zeros((views, many), dtype=bool)
    for m in np.argsort(-outlook.weight, kind="stable"):
        to_head[:] = np.where(heads, outlook.apart[:, m], np.inf)
        nearest = to_head.argmin(axis=1)
        new = to_head[every, nearest] >= same_nats
        member[:, m] = np.where(new, m, nearest)
        heads[new, m] = True
    return member
