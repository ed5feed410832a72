"""Transinformation: the view whose observation and the object have most information in common, whatever it costs.

After Schiele & Crowley, "Transinformation for active object recognition" (ICCV 1998), where places do not matter; ours
turns to the place once no view tells more of the object.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import LEAST_BITS, choose_by
from recognition.policies.outlook import Outlook
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]


def transinformation_bits(outlook: Outlook) -> FloatArray:
    """``(K,)`` mutual information of object and observation: that of the hypotheses, less that within each object."""
    p, alike = outlook.probability, outlook.alike
    same = outlook.object_of[:, None] == outlook.object_of
    own = (alike * same) @ p / (same @ p)
    return np.asarray(np.maximum((np.log2(own) - np.log2(alike @ p)) @ p, 0.0))


def _rule(outlook: Outlook) -> FloatArray:
    of_object = transinformation_bits(outlook)
    return of_object if of_object.max() >= LEAST_BITS else outlook.bits


class TransinformationPolicy:
    """Mutual information of object and observation; no cost."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate that tells most of the object, or else of the place; ``None`` if none tells anything."""
        return choose_by(
            situation, lambda ahead: _rule(ahead.outlook), lambda bits: f"the most transinformation ({bits:.2f} bits)"
        )
