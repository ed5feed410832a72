"""The default policy: most information per second, about the place first, then about the pose."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.predict import Prediction, distances, information_bits
from recognition.steps import Move
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]

LEAST_BITS = 0.02
"""Less expected information than this is none: the remaining hypotheses look alike from everywhere."""
LEAST_POSE_BITS = 0.5
"""While a view sharpens the pose by more than this, hypotheses that look alike now may yet come apart."""
_POSE_SHARE = 0.1
_MOST_POSE_BITS = 8.0


class InformationPolicy:
    """Expected reduction of uncertainty per second of travel, over a weighted sample of all hypotheses."""

    def choose(self, situation: Situation) -> Move | None:
        """The candidate with the most expected bits per second; ``None`` if none tells anything."""
        if not situation.candidates:
            return None
        situation = situation.fewer()
        prediction = situation.predict()
        world, width = situation.world, situation.views[-1].image_size[0]
        apart = (distances(pictures, world, width) for pictures in prediction.pictures)
        place = np.array([information_bits(prediction.weight, one) for one in apart])
        pose = np.minimum(prediction.pose_bits, _MOST_POSE_BITS)
        if not situation.sure and place.max(initial=0.0) < LEAST_BITS and situation.belief.entropy_bits > 0.1:
            seen_by_all = prediction.expected[:, :-1] @ prediction.weight[:-1]
            if seen_by_all.max(initial=0.0) > 0 and pose.max(initial=0.0) < LEAST_POSE_BITS:
                return None
        share = 1.0 if situation.sure else _POSE_SHARE * float(prediction.weight[0])
        gain = place + share * pose
        rate = gain / (situation.cost_s + _view_cost_s(situation))
        pick = int(rate.argmax())
        if gain[pick] <= 0.0:
            return _explore(situation)
        return Move(
            situation.candidates[pick],
            _why(situation, prediction, pick, place, pose),
            gain_bits=float(gain[pick]),
            cost_s=float(situation.cost_s[pick]),
        )


def _view_cost_s(situation: Situation) -> float:
    """What a view costs beside its travel: a typical move's time, lest a string of cheap, useless views be taken."""
    return float(np.median(situation.cost_s))


def _explore(situation: Situation) -> Move:
    """No hypothesis expects to see anything anywhere: look at what is farthest from all that was seen, wide first."""
    far = np.array([min(_apart(pose, old) for old in situation.visited) for pose in situation.candidates])
    wide = np.array([pose.zoom for pose in situation.candidates])
    pick = int((far / (1.0 + 4.0 * wide) / (situation.cost_s + _view_cost_s(situation))).argmax())
    return Move(
        situation.candidates[pick],
        "no hypothesis predicts a part anywhere, so a part of the scene not seen yet is tried",
        cost_s=float(situation.cost_s[pick]),
    )


def _apart(a: RigPose, b: RigPose) -> float:
    """How different two views are: degrees of pan, plus zoom; position is left to the cost."""
    turn = abs((a.theta_deg - b.theta_deg + 180.0) % 360.0 - 180.0)
    return float(turn + 20.0 * abs(a.zoom - b.zoom) + 1.0)


def _why(situation: Situation, prediction: Prediction, pick: int, place: FloatArray, pose: FloatArray) -> str:
    seconds = situation.cost_s[pick]
    if situation.sure:
        return f"the place is settled; this view sharpens the pose by {pose[pick]:.1f} bits for {seconds:.1f} s"
    expected = prediction.expected[pick, :-1]
    names = situation.world.layout.base.objects
    lead = names[int(situation.belief.hypotheses.object_of[prediction.rows[0]])].id if len(prediction.rows) else "?"
    spread = f"{expected.min():.0f} to {expected.max():.0f}" if len(expected) else "no"
    return (
        f"tells {place[pick]:.2f} of {situation.belief.entropy_bits:.2f} bits for {seconds:.1f} s: "
        f"the hypotheses expect {spread} parts there, {lead} {expected[0] if len(expected) else 0:.0f}"
    )
