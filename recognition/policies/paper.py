"""The paper's policy: a search tree over expected parts, and three filters that pick its best leaf.

A node of the tree is a set of competing interpretations (object and part) that expect the same; moving on, it falls
apart into those that still agree with the one taken to be true and those that do not. Filter 1 keeps the leaves of the
most probable interpretations, filter 2 those of least path weight, the sum of s^level over the path with s
interpretations left in a node, and filter 3 the one of least total rotation.

Shape legend: K candidates, M hypotheses, I interpretations.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.expected import Expected, cameras_at, expect, within_gates
from recognition.geometry import wrap_deg
from recognition.policies import Situation
from recognition.steps import Move
from recognition.summary import places

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MAXLEVELS = 3
CENTRAL = 0.3
"""A move counts if it brings an expected part this near to the image centre, as a fraction of the image's width."""
_MOST, _MOST_TIED, _BRANCHES = 800, 8, 24


@dataclass(frozen=True, slots=True)
class Leaf:
    """A path through the tree, as candidates in order, and what the filters compare.

    ``left``: interpretations left in each of its nodes; ``weight``: their sum of s^level; ``rotation_deg``: total pan.
    """

    weight: float
    rotation_deg: float
    path: tuple[int, ...]
    left: tuple[int, ...]


class PaperPolicy:
    """The paper's next view planning, on interpretations of whichever belief there is."""

    def __init__(self, max_levels: int = MAXLEVELS) -> None:
        self.max_levels = max_levels

    def choose(self, situation: Situation) -> Move | None:
        """First move of the best leaf; ``None`` if no candidate shows an expected part, or all have been visited."""
        if not situation.candidates:
            return None
        if len(situation.belief.hypotheses) == 0:
            return _least_rotation(situation)
        situation = situation.fewer()
        forest = Forest.of(situation)
        best = forest.best(self.max_levels)
        if best is None:
            return None
        k = best.path[0]
        return Move(
            situation.candidates[k],
            _why(forest, best),
            gain_bits=float(np.log2(forest.interpretations / best.left[0])),
            cost_s=float(situation.cost_s[k]),
        )


@dataclass(frozen=True)
class Forest:
    """The trees of the most probable interpretations, as tables.

    Attributes:
        pans_deg: ``(K,)`` of the candidates; here_deg: where the rig stands.
        tops: rows of the most probable interpretations.
        agree: for each top ``(K, M)`` which hypotheses could not be told from it in the view.
        shows: for each top ``(K,)`` whether the view brings another part that it expects near the centre.
        start: ``(I,)`` first hypothesis of each interpretation (hypotheses are sorted by interpretation).
        name: of each top, for people.
    """

    pans_deg: FloatArray
    here_deg: float
    tops: IntArray
    agree: dict[int, BoolArray] = field(repr=False)
    shows: dict[int, BoolArray] = field(repr=False)
    start: IntArray
    name: dict[int, str]

    @property
    def interpretations(self) -> int:
        """How many compete."""
        return len(self.start)

    @staticmethod
    def of(situation: Situation) -> Forest:
        """Predict what each hypothesis expects from each candidate, and compare it with what the leaders expect."""
        world, views = situation.world, situation.views
        label = _labels(situation)
        rows = np.argsort(label[:_MOST], kind="stable")
        label, weight = label[rows], situation.belief.probability[rows]
        hypotheses = situation.belief.hypotheses.take(rows)
        candidates, groups, mount = situation.candidates, situation.groups, situation.mount
        cameras, internals = cameras_at(world, hypotheses, views, candidates, groups, mount)
        expected = expect(world, hypotheses, cameras, internals, views[-1].image_size)
        _, start, member = np.unique(label, return_index=True, return_inverse=True)
        tops = most_probable(weight, member)
        near = CENTRAL * views[-1].image_size[0]
        total = len(world.layout.part_ids)
        look = world.layout.part_class
        objects = world.layout.base.objects
        return Forest(
            pans_deg=np.array([pose.theta_deg for pose in situation.candidates]),
            here_deg=situation.pose.theta_deg,
            tops=tops,
            agree={int(t): _agreement(expected, look, int(t)) for t in tops},
            shows={int(t): _shows(expected, int(t), int(label[t]) if label[t] < total else -1, near) for t in tops},
            start=start,
            name={int(t): objects[int(hypotheses.object_of[t])].id for t in tops},
        )

    def left(self, kept: BoolArray) -> IntArray:
        """Interpretations left ``(...,)`` where hypotheses ``(..., M)`` are kept."""
        return np.asarray(np.logical_or.reduceat(kept, self.start, axis=-1).sum(axis=-1))

    def best(self, max_levels: int) -> Leaf | None:
        """The best of the best leaves of all trees."""
        leaves = [leaf for top in self.tops if (leaf := self.best_leaf(int(top), max_levels)) is not None]
        return min(leaves, key=lambda leaf: (leaf.weight, leaf.rotation_deg), default=None)

    def best_leaf(self, top: int, max_levels: int) -> Leaf | None:
        """The leaf of least weight, then least rotation, in the tree of one interpretation; uniform-cost search."""
        everything = np.ones(self.agree[top].shape[1], dtype=bool)
        queue: list[tuple[float, float, int, tuple[int, ...], tuple[int, ...], BoolArray]] = [
            (0.0, 0.0, 0, (), (), everything)
        ]
        born = 1
        while queue:
            weight, turned, _, path, left, kept = heapq.heappop(queue)
            children = self._children(top, path, kept, left) if len(path) < max_levels else []
            if path and (left[-1] == 1 or not children):
                return Leaf(weight, turned, path, left)
            at = self.pans_deg[path[-1]] if path else self.here_deg
            for k, s, kept_k in children:
                turn = abs(wrap_deg(float(self.pans_deg[k] - at)))
                level = len(path) + 1
                heapq.heappush(queue, (weight + float(s) ** level, turned + turn, born, (*path, k), (*left, s), kept_k))
                born += 1
        return None

    def _children(
        self, top: int, path: tuple[int, ...], kept: BoolArray, left: tuple[int, ...]
    ) -> list[tuple[int, int, BoolArray]]:
        """Expand a node: moves that bring another expected part near the centre, and the interpretations left there."""
        usable = self.shows[top].copy()
        usable[list(path)] = False
        ks = np.flatnonzero(usable)
        if ks.size == 0:
            return []
        masks = self.agree[top][ks] & kept
        s = self.left(masks)
        before = left[-1] if left else self.interpretations
        # A view that rules nothing out only delays one that does; without any such the tree still has its leaves.
        if (s < before).any():
            ks, masks, s = ks[s < before], masks[s < before], s[s < before]
        at = self.pans_deg[path[-1]] if path else self.here_deg
        turn = np.abs((self.pans_deg[ks] - at + 180.0) % 360.0 - 180.0)
        order = np.lexsort((turn, s))[:_BRANCHES]
        return [(int(ks[i]), int(s[i]), masks[i]) for i in order]


def _labels(situation: Situation) -> IntArray:
    """``(M,)`` one number for each interpretation: the part at the image centre under it, else its object."""
    place = places(situation.world, situation.belief, situation.views)
    total = len(situation.world.layout.part_ids)
    return np.asarray(np.where(place >= 0, place, total + situation.belief.hypotheses.object_of))


def most_probable(weight: FloatArray, member: IntArray) -> IntArray:
    """Filter 1: a hypothesis of each of the most probable interpretations; area priors tie many of them."""
    mass = np.bincount(member, weights=weight)
    tied = np.flatnonzero(mass >= mass.max() * (1.0 - 1e-6))[:_MOST_TIED]
    return np.array([int(np.flatnonzero(member == i)[np.argmax(weight[member == i])]) for i in tied])


def _agreement(expected: Expected, look: IntArray, top: int) -> BoolArray:
    """``(K, M)`` whether the part a hypothesis expects would be found if ``top`` were true: eq. 6 on predictions."""
    cameras, hypotheses = expected.first.shape
    agree = np.zeros((cameras, hypotheses), dtype=bool)
    mine = np.flatnonzero(expected.hypothesis == top)
    for k in range(cameras):
        seen = mine[expected.camera[mine] == k]
        rows = expected.first[k]
        if seen.size == 0:
            agree[k] = rows < 0
            continue
        has = np.flatnonzero(rows >= 0)
        at = rows[has]
        same = within_gates(expected.pose[at][:, None], expected.pose[seen][None])
        same &= look[expected.part[at]][:, None] == look[expected.part[seen]][None]
        agree[k, has] = same.any(axis=1)
    return agree


def _shows(expected: Expected, top: int, place: int, near_px: float) -> BoolArray:
    """``(K,)`` whether a view brings a part near its centre under ``top``, other than the one that it stands before."""
    rows = expected.first[:, top]
    good = (rows >= 0) & (expected.away_px[rows] < near_px)
    other = good & (expected.part[rows] != place)
    return other if other.any() else good


def _least_rotation(situation: Situation) -> Move:
    turn = np.array([abs(wrap_deg(pose.theta_deg - situation.pose.theta_deg)) for pose in situation.candidates])
    pick = int(np.lexsort((situation.cost_s, turn))[0])
    return Move(
        situation.candidates[pick],
        "there is no interpretation yet, so the nearest view with the least rotation is tried",
        cost_s=float(situation.cost_s[pick]),
    )


def _why(forest: Forest, leaf: Leaf) -> str:
    """One sentence."""
    nodes = ", then ".join(str(s) for s in leaf.left)
    what = (
        f"leaves {nodes} of {forest.interpretations} places"
        if leaf.left[-1] < forest.interpretations
        else f"separates none of {forest.interpretations} places, as no view within {len(leaf.path)} moves does"
    )
    return (
        f"best leaf of {len(forest.tops)} most probable interpretation{'s' if len(forest.tops) > 1 else ''}: it {what} "
        f"(path weight {leaf.weight:.0f}, rotation {leaf.rotation_deg:.0f} degrees)"
    )
