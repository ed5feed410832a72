"""The default policy: most information per second, about the place first, then about the pose."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.policies.outlook import Outlook
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]


def bits_per_second(outlook: Outlook) -> FloatArray:
    """``(K,)`` expected information about the place by cost."""
    return np.asarray(outlook.bits / outlook.cost_s)


class InformationPolicy:
    """Expected reduction of uncertainty per second of travel, over a weighted sample of all hypotheses."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate with the most expected bits per second; ``None`` if none tells anything."""
        return choose_by(situation, _rule, lambda rate: f"the most bits a second ({rate:.2f})")


def _rule(ahead: Ahead) -> FloatArray:
    pose_per_second = ahead.pose_share * ahead.pose / ahead.outlook.cost_s
    return np.asarray(bits_per_second(ahead.outlook) + pose_per_second)
