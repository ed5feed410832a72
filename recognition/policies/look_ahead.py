"""Information two or three steps ahead: the view that begins the best plan, where one view alone tells little.

A plan's later views depend on what its earlier ones show. It is worth its expected bits by its expected seconds.

Shape legend: K candidates, B of them that are tried (the beam), M hypotheses, O outcomes, N beliefs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.policies.information import bits_per_second
from recognition.policies.outlook import Outlook
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

BEAM = 6
"""Views that are tried, at every step: those that tell most a second and those that tell most."""
MOST_OUTCOMES = {2: 48, 3: 8}
"""What a view may show is represented by so many hypotheses at most, by the number of steps."""
_NOTHING = 1e-6


@dataclass(frozen=True)
class _Tried:
    """The beam ``alike`` ``(B, M, M)``, and hypotheses ``outcome`` ``(O,)`` that stand for what its views may show.

    ``odds`` ``(O,)``: how much weight each stands for, by its own; ``view_s``: seconds of a later view; ``rate``: bits
    per second that any view must be worth.
    """

    alike: FloatArray = field(repr=False)
    outcome: IntArray
    odds: FloatArray
    view_s: float
    rate: float

    def bits(self, belief: FloatArray) -> FloatArray:
        """``(N, B)`` expected information of each view under beliefs ``(N, M)``."""
        mixed = np.log2(np.maximum(np.matmul(belief, self.alike), 1e-300))
        return np.asarray(np.maximum(-np.einsum("nm,bnm->nb", belief, mixed), 0.0))

    def rest(self, belief: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
        """Bits and seconds ``(N,)`` of the best further ``steps`` views; 0 of both where no view tells anything."""
        bits = self.bits(belief)
        seconds = np.full(bits.shape, self.view_s)
        for view in range(len(self.alike)) if steps > 1 else ():
            more_bits, more_s = self.follow(belief, view, steps - 1)
            bits[:, view] += more_bits
            seconds[:, view] += more_s
        pick = (bits - self.rate * seconds).argmax(axis=1)[:, None]
        best = np.take_along_axis(bits, pick, axis=1)[:, 0]
        worth = best > _NOTHING
        return best * worth, np.take_along_axis(seconds, pick, axis=1)[:, 0] * worth

    def follow(self, belief: FloatArray, view: int, steps: int) -> tuple[FloatArray, FloatArray]:
        """Expected bits and seconds ``(N,)`` of the best ``steps`` views after a view."""
        after = _normalised(belief[:, None] * self.alike[view][self.outcome])
        chance = _normalised(belief[:, self.outcome] * self.odds)
        bits, seconds = self.rest(after.reshape(-1, belief.shape[1]), steps)
        return (chance * bits.reshape(chance.shape)).sum(axis=1), (chance * seconds.reshape(chance.shape)).sum(axis=1)


def _normalised(mass: FloatArray) -> FloatArray:
    return np.asarray(mass / np.maximum(mass.sum(axis=-1, keepdims=True), 1e-300))


def plan_rate(outlook: Outlook, steps: int) -> FloatArray:
    """``(K,)`` bits per second of the best plan that begins with each candidate; ``-inf`` for those not in the beam.

    Views after the first cost the median: how far it is from one candidate to another, policies are not told.
    """
    beam = _beam(outlook)
    p = outlook.probability
    outcome, share = _representatives(p, MOST_OUTCOMES[steps])
    later_s, at_once = float(np.median(outlook.cost_s)), float(bits_per_second(outlook).max())
    tried = _Tried(outlook.alike[beam], outcome, share / p[outcome], later_s, at_once)
    bits = tried.bits(p[None])[0]
    rate = np.full(len(outlook.cost_s), -np.inf)
    for b, k in enumerate(beam):
        more_bits, more_s = tried.follow(p[None], b, steps - 1)
        rate[k] = (bits[b] + more_bits[0]) / (outlook.cost_s[k] + more_s[0])
    return rate


def _beam(outlook: Outlook) -> IntArray:
    """Candidates by turns: the next that tells most a second, the next that tells most."""
    orders = [np.argsort(-score, kind="stable") for score in (bits_per_second(outlook), outlook.bits)]
    by_turns = np.stack(orders, axis=1).ravel()
    _, first = np.unique(by_turns, return_index=True)
    return np.asarray(by_turns[np.sort(first)][:BEAM])


def _representatives(p: FloatArray, most: int) -> tuple[IntArray, FloatArray]:
    """Hypotheses that stand for all, drawn evenly by weight, and how much of ``p`` ``(M,)`` each stands for."""
    if len(p) <= most:
        return np.arange(len(p)), p
    at = np.searchsorted(np.cumsum(p), (np.arange(most) + 0.5) / most)
    rows, count = np.unique(np.minimum(at, len(p) - 1), return_counts=True)
    return rows, count / most


class TwoStepPolicy:
    """Information per second over this view and the next."""

    steps = 2

    def choose(self, situation: Situation) -> Move | None:
        """The first view of the best plan; ``None`` if no view tells anything."""
        return choose_by(
            situation, self._rule, lambda rate: f"begins the best {self.steps} views ({rate:.2f} bits a second)"
        )

    def _rule(self, ahead: Ahead) -> FloatArray:
        return plan_rate(ahead.outlook, self.steps)


class ThreeStepPolicy(TwoStepPolicy):
    """Information per second over this view and the next two."""

    steps = 3
