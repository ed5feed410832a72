"""Off-line strategy tree: planned once from what is believed after the first view, and followed while it holds.

After Gremban & Ikeuchi, "Planning multiple observations for object recognition" (International Journal of Computer
Vision 12, 1994): views group hypotheses into classes that look the same (aspects), and a tree of moves resolves them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.geometry import camera_in_rig
from recognition.hypotheses import Hypotheses
from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by, reason, told_apart
from recognition.policies.outlook import Outlook, classes, entropy_bits
from recognition.policies.strategy import Node, Planner
from recognition.steps import Move
from recognition.visibility import camera_in_objects
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

DEPTH, BEAM = 3, (6, 2, 1)
"""Views along a path of the tree at most, and how many are tried at the nodes of each level."""
_BELIEVED = 0.5
"""A branch whose hypotheses hold less of the belief than this is contradicted."""
_NEAR_SHARE, _NEAR_DEG = 0.12, 4.0
"""A hypothesis is one of the tree's if it places the camera so near, as a share of its distance from the object."""


def strategy(outlook: Outlook) -> tuple[Node, IntArray]:
    """A tree to a bounded depth, and the candidates ``(K,)`` that its numbers stand for, the quickest first."""
    cheap = np.argsort(outlook.cost_s, kind="stable")
    planner = Planner(classes(outlook)[cheap], outlook.weight, depth=DEPTH, beam=BEAM)
    return planner.best(tuple(range(len(outlook.weight)))), cheap


@dataclass(frozen=True)
class _Tree:
    """A tree that is being followed: the node whose view was taken, and what its numbers stand for."""

    node: Node
    poses: list[RigPose] = field(repr=False)
    hypotheses: Hypotheses = field(repr=False)
    names: tuple[str, ...] = field(repr=False)


class OfflineTreePolicy:
    """Follows a tree, and plans another one where the belief contradicts it or it ends. One run each."""

    def __init__(self) -> None:
        self._tree: _Tree | None = None

    def choose(self, situation: Situation) -> Move | None:
        """The next view of the tree; ``None`` if there is no candidate, or none tells anything."""
        move = None if situation.sure else self._follow(situation)
        if move is None:
            self._tree = None
            move = choose_by(situation, self._plan, lambda _: f"the root of a tree of {DEPTH} views, planned now")
        return move

    def _follow(self, situation: Situation) -> Move | None:
        tree = self._tree
        if tree is None:
            return None
        mass = _mass_of_tree(situation.belief, situation, tree.hypotheses)
        held = [float(mass[list(branch.members)].sum()) for branch in tree.node.branches]
        node = tree.node.branches[int(np.argmax(held))]
        if max(held) < _BELIEVED or node.candidate < 0 or tree.poses[node.candidate] not in situation.candidates:
            return None
        self._tree = _Tree(node, tree.poses, tree.hypotheses, tree.names)
        k = situation.candidates.index(tree.poses[node.candidate])
        heads = sorted((max(b.members, key=lambda m: mass[m]) for b in node.branches), key=lambda m: -mass[m])
        shares = np.array([mass[list(branch.members)].sum() for branch in node.branches])
        bits = float(entropy_bits(shares / max(shares.sum(), 1e-300)))
        seconds = float(situation.cost_s[k])
        tells = told_apart(tree.names[heads[0]], tree.names[heads[1]], len(heads) - 2)
        why = reason(bits, seconds, tells, "the next view of the tree planned before")
        return Move(situation.candidates[k], why, gain_bits=bits, cost_s=seconds)

    def _plan(self, ahead: Ahead) -> FloatArray:
        root, cheap = strategy(ahead.outlook)
        score = np.full(len(cheap), -np.inf)
        if root.candidate >= 0:
            situation = ahead.situation
            poses = [situation.candidates[int(k)] for k in cheap]
            sample = situation.belief.hypotheses.take(ahead.prediction.rows)
            names = tuple(ahead.name(m) for m in range(len(ahead.outlook.weight)))
            self._tree = _Tree(root, poses, sample, names)
            score[cheap[root.candidate]] = 0.0
        return score


def _mass_of_tree(belief: Belief, situation: Situation, sample: Hypotheses) -> FloatArray:
    """``(M,)`` probability that the belief gives now to each of the tree's hypotheses, "none of these" last."""
    mass = np.zeros(len(sample) + 1)
    mass[-1] = belief.none
    now = belief.hypotheses
    camera = camera_in_rig(situation.pose, situation.mount)
    row = np.array([np.radians(camera.theta_deg), *camera.centre_mm])
    (pan, centre), (pan_now, centre_now) = (camera_in_objects(h.placement, row) for h in (sample, now))
    turn = np.degrees(np.abs(np.remainder(pan_now[:, None] - pan + np.pi, 2 * np.pi) - np.pi))
    away = np.linalg.norm(centre_now[:, None] - centre, axis=2)
    near = away / np.maximum(_NEAR_SHARE * np.linalg.norm(centre_now, axis=1)[:, None], 1e-9)
    off = np.maximum(near, turn / _NEAR_DEG)
    off[now.object_of[:, None] != sample.object_of] = np.inf
    nearest = off.argmin(axis=1)
    same = off[np.arange(len(now)), nearest] < 1.0
    np.add.at(mass, nearest[same], belief.probability[same])
    return mass
