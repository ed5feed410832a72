"""Optimal: the view that begins a strategy of the fewest expected views, exactly, on small instances.

What hypotheses would show is taken for certain, as equivalence classes of pictures; then the hypotheses left are the
whole state, and dynamic programming over their sets is exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.policies.outlook import Outlook, classes
from recognition.policies.strategy import Planner
from recognition.steps import Move
from rig.errors import InputError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_HYPOTHESES, MOST_CANDIDATES = 12, 12
_NEGLIGIBLE = 1e-3


def views_of_each(outlook: Outlook) -> FloatArray:
    """``(K,)`` fewest expected views by strategies that begin with each candidate; ``inf`` where it separates nothing.

    Hypotheses that look the same from everywhere count as one, and so do candidates that separate the same.

    Raises:
        InputError: more than ``MOST_HYPOTHESES`` or ``MOST_CANDIDATES`` are left after that.
    """
    table = classes(outlook)
    cheap = np.argsort(outlook.cost_s, kind="stable")
    _, first, same = np.unique(table.T, axis=0, return_index=True, return_inverse=True)
    weight = np.bincount(same.reshape(-1), outlook.weight)
    planner = Planner(table[cheap][:, first], np.asarray(weight, dtype=np.float64))
    everything = tuple(range(len(first)))
    able = planner.separating(everything)
    _refuse_beyond("hypotheses", len(first), MOST_HYPOTHESES)
    _refuse_beyond("views that separate them", len(able), MOST_CANDIDATES)
    views = np.full(len(cheap), np.inf)
    for k in able:
        views[cheap[k]] = planner.after(everything, int(k)).views
    return views


class OptimalPolicy:
    """The exact optimum in expected views; of equal ones the quickest."""

    def choose(self, situation: Situation) -> Move | None:
        """The first view of an optimal strategy; ``None`` if none tells the places apart.

        Raises:
            InputError: the instance is too large to be planned exactly; says what it has and what may be.
        """
        return choose_by(situation, _rule, lambda views: f"the fewest views to come ({-views:.2f} on average)")


def _rule(ahead: Ahead) -> FloatArray:
    _refuse_beyond("reachable views", ahead.offered, ahead.situation.most)
    kept = np.flatnonzero(ahead.outlook.probability > _NEGLIGIBLE)
    return -views_of_each(ahead.outlook.among(kept.tolist()))


def _refuse_beyond(what: str, count: int, most: int) -> None:
    if count > most:
        raise InputError(
            f"optimal plans exactly, and {count} {what} are left to plan over, {most} at most can be",
            where="--policy",
            remedy="Choose information, which needs few views more, or a smaller model base and fewer reachable views",
        )
