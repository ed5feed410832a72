"""EC2, equivalence class edge cutting: the view that cuts most weight of edges between places for its cost.

After Golovin, Krause & Ray, "Near-optimal Bayesian active learning with noisy observations" (NIPS 2010). Edges join
hypotheses of different places and weigh the product of theirs; an observation cuts the edges of what it contradicts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import choose_by
from recognition.policies.outlook import Outlook
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]


def cut_weight(outlook: Outlook) -> FloatArray:
    """``(K,)`` expected weight of edges cut, where ``outlook.weight`` is what observations so far have left."""
    weight = outlook.weight
    _, number = np.unique(outlook.place, return_inverse=True)
    member = np.eye(int(number.max()) + 1)[number]
    left = outlook.alike * weight
    after = 0.5 * (left.sum(axis=2) ** 2 - ((left @ member) ** 2).sum(axis=2))
    before = 0.5 * (weight.sum() ** 2 - float(((weight @ member) ** 2).sum()))
    return np.asarray(before - after @ outlook.probability)


class Ec2Policy:
    """Weight of edges cut per second of travel."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate that cuts most weight per second; ``None`` if none tells anything."""
        return choose_by(
            situation,
            lambda ahead: cut_weight(ahead.outlook) / ahead.outlook.cost_s,
            lambda cut: f"the most edges between places cut a second (weight {cut:.3f})",
        )
