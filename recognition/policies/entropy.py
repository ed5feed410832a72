"""Entropy of the fused posterior: the view expected to lower it most, views near those already taken being shunned.

After Borotschnig, Paletta, Prantl & Pinz, "Appearance-based active object recognition" (Image and Vision Computing 18,
2000): the expected loss of entropy, over sampled observations, times a mask that is low about the views taken.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.choosing import Ahead, choose_by
from recognition.policies.outlook import Outlook, entropy_bits
from recognition.steps import Move
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]

_REACH = 0.1
"""The mask has risen to 1 - 1/e so far from a view that was taken, as a share of what the candidates span."""


def entropy_loss_bits(outlook: Outlook) -> FloatArray:
    """``(K,)`` expected loss of entropy; each hypothesis's own picture is a sample of what may be observed."""
    return np.asarray(entropy_bits(outlook.probability) - outlook.entropy_left(outlook.alike))


def mask(candidates: Sequence[RigPose], visited: Sequence[RigPose]) -> FloatArray:
    """``(K,)`` 0 at a view that was taken, towards 1 away from all of them."""
    there, been = _numbers(candidates), _numbers(visited)
    away = np.abs(there[:, None] - been)
    away[..., 3] = np.minimum(away[..., 3], 360.0 - away[..., 3])
    span = np.maximum(_REACH * np.ptp(np.concatenate([there, been]), axis=0), 1e-9)
    nearest = ((away / span) ** 2).sum(axis=2).min(axis=1)
    return np.asarray(-np.expm1(-nearest))


class EntropyPolicy:
    """Largest expected loss of entropy; no cost but the mask."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate of the largest masked loss; ``None`` if none tells anything."""
        return choose_by(
            situation, _rule, lambda loss: f"the largest loss of entropy away from views taken ({loss:.2f} bits)"
        )


def _rule(ahead: Ahead) -> FloatArray:
    loss = np.maximum(entropy_loss_bits(ahead.outlook), 0.0)
    return np.asarray(loss * mask(ahead.situation.candidates, ahead.situation.visited))


def _numbers(poses: Sequence[RigPose]) -> FloatArray:
    return np.array([(p.x_mm, p.y_mm, p.z_mm, p.theta_deg % 360.0, p.zoom) for p in poses])
