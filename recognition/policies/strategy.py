"""Strategy trees: which view to take next, and after each thing that it may show, which then.

Views show equivalence classes of hypotheses without error, so the hypotheses left are all that a node must know, and
the best tree under each set of them need be found once only (dynamic programming).

Shape legend: K candidates, M hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.policies.outlook import entropy_bits

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Node:
    """Where a set of hypotheses is left.

    Attributes:
        members: the hypotheses.
        views: expected number of further views; below the bounded depth, a lower bound of it.
        candidate: the view to take; -1 if none separates them or the tree ends here.
        branches: by what the view may show.
    """

    members: tuple[int, ...]
    views: float
    candidate: int = -1
    branches: tuple[Node, ...] = field(default=(), repr=False)


class Planner:
    """Finds the strategy of the fewest expected views: exactly, or to a bounded depth with few views tried at a node.

    Of views that are equally good the first is taken, so candidates are best given in order of their cost.
    """

    def __init__(
        self, classes: IntArray, weight: FloatArray, *, depth: int | None = None, beam: tuple[int, ...] = ()
    ) -> None:
        """``classes`` ``(K, M)``: what each view shows of each hypothesis.

        ``depth``: views along a path at most; ``None``: as many as it takes. ``beam``: how many views are tried at the
        nodes of each level, those that leave least entropy; the last number holds for all further levels; empty: all.
        """
        self._weight, self._depth, self._beam = weight, depth, beam
        _, merged = np.unique(classes.T, axis=0, return_inverse=True)
        self._same = merged.reshape(-1)
        self._classes = np.array([np.unique(row, return_inverse=True)[1].reshape(-1) for row in classes])
        self._outcomes = max((int(row.max()) + 1 for row in self._classes), default=1)
        self._known: dict[tuple[tuple[int, ...], int], Node] = {}

    def best(self, members: tuple[int, ...], level: int = 0) -> Node:
        """The best strategy for these hypotheses."""
        key = (members, level if self._depth is not None or self._beam else 0)
        if key not in self._known:
            self._known[key] = self._search(members, level)
        return self._known[key]

    def after(self, members: tuple[int, ...], candidate: int, level: int = 0) -> Node:
        """The best strategy that begins with a view."""
        shown = self._classes[candidate, list(members)]
        groups = [tuple(m for m, s in zip(members, shown, strict=True) if s == one) for one in np.unique(shown)]
        branches = tuple(self.best(group, level + 1) for group in groups)
        mass = self._weight[list(members)].sum()
        left = sum(self._weight[list(node.members)].sum() * node.views for node in branches) / mass
        return Node(members, 1.0 + float(left), candidate, branches)

    def separating(self, members: tuple[int, ...]) -> IntArray:
        """Candidates that tell any of these hypotheses apart, one of those that tell the same, the first first."""
        rows = self._classes[:, list(members)]
        able = np.flatnonzero((rows != rows[:, :1]).any(axis=1))
        partitions = {self._partition(rows[k]): int(k) for k in able[::-1]}
        return np.array(sorted(partitions.values()), dtype=np.int64)

    def _search(self, members: tuple[int, ...], level: int) -> Node:
        if len({int(self._same[m]) for m in members}) < 2:
            return Node(members, 0.0)
        if self._depth is not None and level >= self._depth:
            return Node(members, self._least_views(members))
        tried = self._promising(members, self.separating(members), level)
        nodes = [self.after(members, int(k), level) for k in tried]
        return min(nodes, key=lambda node: round(node.views, 9))

    def _promising(self, members: tuple[int, ...], candidates: IntArray, level: int) -> IntArray:
        if not self._beam:
            return candidates
        rows = self._classes[candidates][:, list(members)]
        weight = self._weight[list(members)] / self._weight[list(members)].sum()
        at = np.arange(len(candidates))[:, None] * self._outcomes + rows
        mass = np.zeros(len(candidates) * self._outcomes)
        np.add.at(mass, at.ravel(), np.tile(weight, len(candidates)))
        told = entropy_bits(mass.reshape(len(candidates), self._outcomes))
        width = self._beam[min(level, len(self._beam) - 1)]
        return np.asarray(candidates[np.argsort(-np.round(told, 9), kind="stable")[:width]])

    def _least_views(self, members: tuple[int, ...]) -> float:
        """At least so many views, as each tells at most the logarithm of what it may show."""
        mass = np.bincount(self._same[list(members)], self._weight[list(members)])
        bits = float(entropy_bits(np.asarray(mass / mass.sum(), dtype=np.float64)))
        return max(1.0, bits / float(np.log2(self._outcomes)))

    @staticmethod
    def _partition(row: IntArray) -> bytes:
        """Equal for rows that group alike, however they number the groups."""
        _, first, number = np.unique(row, return_index=True, return_inverse=True)
        return first[number].tobytes()
