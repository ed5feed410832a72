"""Pose volume: the view expected to leave the smallest uncertainty of the pose, averaged over the hypotheses.

After Callari & Ferrie, "Active object recognition: looking for differences" (International Journal of Computer Vision
43, 2001), who look for the view that lowers the uncertainty of each model's parameters most.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.pose_gain import pose_bits
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]

MOST_HYPOTHESES = 6
"""So many of the most probable are averaged over; each needs a fit for each candidate."""


def mean_pose_bits(weight: FloatArray, bits: FloatArray) -> FloatArray:
    """``(K,)`` expected halvings of the pose's volume, of ``bits`` ``(K, R)`` under hypotheses of ``weight`` ``(R,)``.

    The mean of the logarithm, for one hopelessly unsure hypothesis would else drown all others.
    """
    return np.asarray(bits @ (weight / weight.sum()))


class PoseVolumePolicy:
    """Smallest expected pose uncertainty; no cost."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate that is expected to sharpen poses most; ``None`` if none tells the places apart."""
        return choose_by(
            situation, _rule, lambda bits: f"the pose most sharpened under all hypotheses ({bits:.1f} bits)"
        )


def _rule(ahead: Ahead) -> FloatArray:
    situation, prediction = ahead.situation, ahead.prediction
    lead = np.arange(min(MOST_HYPOTHESES, len(prediction.rows)))
    sample = situation.belief.hypotheses.take(prediction.rows)
    bits = pose_bits(situation.world, sample, situation.views, prediction.shown, lead)
    return mean_pose_bits(prediction.weight[lead], bits)
