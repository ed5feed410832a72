"""Dempster-Shafer ambiguity: the view expected to leave the least of it, pictures agreeing or not by a gate.

After Hutchinson & Kak, "Planning sensing strategies in a robot work cell with multi-sensor capabilities" (IEEE
Transactions on Robotics and Automation 5, 1989). A view's evidence is a mass on the set of hypotheses that agree with
what is seen, and the rest on all of them; Dempster's rule joins it with the belief, and ambiguity is entropy.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import choose_by
from recognition.policies.outlook import SAME_NATS, Outlook
from recognition.steps import Move

FloatArray = npt.NDArray[np.float64]

SUPPORT = 0.98
"""Mass that a view puts on the hypotheses that agree with it; the rest, on all of them, is for what may mislead it."""


def ambiguity_bits(outlook: Outlook, support: float = SUPPORT) -> FloatArray:
    """``(K,)`` entropy of the belief joined with a view's mass, expected over what may be seen.

    The belief's masses are on single hypotheses, so Dempster's rule leaves them there: each is multiplied by the
    plausibility that the view leaves it, 1 if it agrees and else ``1 - support``.
    """
    agree = outlook.apart < SAME_NATS
    return outlook.entropy_left(np.where(agree, 1.0, 1.0 - support))


class DempsterShaferPolicy:
    """Least expected ambiguity; no cost."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate expected to leave the least ambiguity; ``None`` if none tells anything."""
        return choose_by(
            situation,
            lambda ahead: -ambiguity_bits(ahead.outlook),
            lambda left: f"the least ambiguity left ({-left:.2f} bits)",
        )
