"""Reveal: the view in which most parts come into sight that no view has shown yet.

After Maver & Bajcsy, "Occlusions as a guide for planning the next view" (IEEE Transactions on Pattern Analysis and
Machine Intelligence 15, 1993). Theirs is a range scanner that knows no model; ours expects the hidden parts by model.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.hypotheses import Hypotheses
from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.seen import Seen
from recognition.steps import Move
from recognition.tracking import World, expected_internals, expected_parts

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


def newly_shown(
    weight: FloatArray, hypothesis: IntArray, candidate: IntArray, chance: FloatArray, views: int
) -> FloatArray:
    """``(K,)`` expected number of parts, given those ``(n,)`` that hypotheses expect there and have not shown yet."""
    return np.asarray(np.bincount(candidate, weights=weight[hypothesis] * chance, minlength=views), dtype=np.float64)


class RevealPolicy:
    """Most parts newly in sight; no cost."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate that is expected to reveal most parts; ``None`` if none tells the places apart."""
        return choose_by(situation, _rule, lambda parts: f"the most parts not seen yet ({parts:.1f} expected)")


def _rule(ahead: Ahead) -> FloatArray:
    situation, prediction, shown = ahead.situation, ahead.prediction, ahead.prediction.shown
    sample = situation.belief.hypotheses.take(prediction.rows)
    new = ~_seen_before(situation.world, sample, situation.views, shown.hypothesis, shown.pairs.part)
    return newly_shown(
        prediction.weight, shown.hypothesis[new], shown.candidate[new], shown.chance[new], len(situation.candidates)
    )


def _seen_before(
    world: World, hypotheses: Hypotheses, views: list[Seen], hypothesis: IntArray, part: IntArray
) -> BoolArray:
    """``(n,)`` whether a view so far should have shown the part, were the hypothesis true."""
    many = len(world.layout.part_ids)
    before = [np.empty(0, dtype=np.int64)]
    for k in range(len(views)):
        pairs = expected_parts(world, hypotheses, views, k, expected_internals(world, hypotheses, views, k))
        before.append(pairs.hypothesis * many + pairs.part)
    return np.isin(hypothesis * many + part, np.concatenate(before))
