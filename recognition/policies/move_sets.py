"""Sets of moves under a cost limit, by greedy selection, and the policy that goes to the best of such a set.

Views that tell the same are not worth taking together, and a set is chosen for what its views tell between them. The
better of two greedy sets, by gain and by gain per second, has at least (1 - 1/e) / 2 of the best set's worth where
worth is monotone and submodular (Leskovec et al., "Cost-effective outbreak detection in networks", KDD 2007): so it is
for pairs told apart in general, and for bits where observations are certain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.policies.outlook import Outlook
from recognition.predict import information_bits
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]

Worth = Callable[[FloatArray, FloatArray], FloatArray]
"""What it is worth ``(...)`` to tell hypotheses of weights ``(M,)`` apart by ``(..., M, M)`` nats."""
LIMIT_VIEWS = 3.0
"""The policy's limit, in views of median cost."""


def pairs_told(weight: FloatArray, apart: FloatArray) -> FloatArray:
    """``(...)`` weight of the pairs of hypotheses that are told from each other; submodular over sets of views."""
    p = weight / weight.sum()
    return np.asarray(0.5 * ((-np.expm1(-apart)) @ p) @ p)


def moves_within(outlook: Outlook, limit_s: float, worth: Worth = information_bits) -> tuple[int, ...]:
    """Candidates, in the order of their choice, that together cost no more than ``limit_s`` and tell much.

    A set's cost is the sum of its views' from where the rig stands, which a round trip seldom exceeds.
    """
    sets = [_greedy(outlook, limit_s, worth, cost) for cost in (outlook.cost_s, np.ones_like(outlook.cost_s))]
    return max(sets, key=lambda chosen: _worth_of(outlook, chosen, worth))


def _worth_of(outlook: Outlook, chosen: tuple[int, ...], worth: Worth) -> float:
    return float(worth(outlook.weight, outlook.apart[list(chosen)].sum(axis=0)))


def _greedy(outlook: Outlook, limit_s: float, worth: Worth, cost: FloatArray) -> tuple[int, ...]:
    """Add what adds most by ``cost`` ``(K,)`` while the limit allows."""
    chosen: list[int] = []
    so_far, value, left_s = np.zeros_like(outlook.apart[0]), 0.0, limit_s
    open_to = np.ones(len(cost), dtype=bool)
    while (open_to := open_to & (outlook.cost_s <= left_s + 1e-9)).any():
        gain = np.where(open_to, worth(outlook.weight, so_far + outlook.apart) - value, 0.0) / cost
        pick = int(gain.argmax())
        if gain[pick] <= 1e-12:
            break
        chosen.append(pick)
        open_to[pick] = False
        so_far, left_s = so_far + outlook.apart[pick], left_s - outlook.cost_s[pick]
        value = float(worth(outlook.weight, so_far))
    return tuple(chosen)


class MoveSetPolicy:
    """Information of a set of moves that together cost no more than a few typical ones."""

    def choose(self, situation: Situation) -> Move | None:
        """Of the best set within the limit, the move of most bits per second; ``None`` if none tells anything."""
        return choose_by(
            situation, _rule, lambda rate: f"the first of a set of moves within a limit ({rate:.2f} bits a second)"
        )


def _rule(ahead: Ahead) -> FloatArray:
    outlook = ahead.outlook
    chosen = list(moves_within(outlook, LIMIT_VIEWS * float(np.median(outlook.cost_s))))
    rate = np.full(len(outlook.cost_s), -np.inf)
    rate[chosen] = outlook.bits[chosen] / outlook.cost_s[chosen]
    return rate
