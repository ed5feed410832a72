"""What all policies that score candidates share: predicting, telling when no view can tell more, and saying why.

Shape legend: K candidates, M hypotheses ("none of these" last).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.policies import Situation
from recognition.policies.outlook import Outlook
from recognition.predict import Prediction, distances
from recognition.steps import Move
from recognition.summary import places
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEAST_BITS = 0.02
"""Less expected information than this is none: the remaining hypotheses look alike from everywhere."""
LEAST_POSE_BITS = 0.5
"""While a view sharpens the pose by more than this, hypotheses that look alike now may yet come apart."""
_POSE_SHARE = 0.1
_MOST_POSE_BITS = 8.0
_TOLD = 0.5


@dataclass(frozen=True)
class Ahead:
    """The candidates and what is expected of them.

    Attributes:
        situation: with the candidates that are compared.
        offered: how many there were.
        prediction: of what a sample of the belief would see.
        outlook: what that tells; ``cost_s`` has a view's own cost beside the travel.
        bits: ``(K,)`` expected information about the place.
        pose: ``(K,)`` about the leading hypothesis's pose.
    """

    situation: Situation
    offered: int
    prediction: Prediction = field(repr=False)
    outlook: Outlook = field(repr=False)
    bits: FloatArray
    pose: FloatArray

    @staticmethod
    def of(situation: Situation) -> Ahead:
        """Predict and compare; K >= 1."""
        fewer = situation.fewer()
        prediction = fewer.predict()
        width = fewer.views[-1].image_size[0]
        apart = np.array([distances(pictures, fewer.world, width) for pictures in prediction.pictures])
        place, object_of = _meaning(fewer, prediction)
        cost_s = fewer.cost_s + view_cost_s(fewer)
        outlook = Outlook(np.maximum(prediction.weight, 1e-12), apart, cost_s, place, object_of)
        pose = np.minimum(prediction.pose_bits, _MOST_POSE_BITS)
        return Ahead(fewer, len(situation.candidates), prediction, outlook, outlook.bits, pose)

    @property
    def gain_bits(self) -> FloatArray:
        """``(K,)`` bits about the place, and a share of those about the pose: all of them once the place is settled."""
        return self.bits + self.pose_share * self.pose

    @property
    def pose_share(self) -> float:
        """How much a bit about the pose counts beside one about the place."""
        return 1.0 if self.situation.sure else _POSE_SHARE * float(self.prediction.weight[0])

    @property
    def quickest(self) -> int:
        """The candidate with the most bits per second."""
        return int((self.gain_bits / self.outlook.cost_s).argmax())

    @property
    def hopeless(self) -> bool:
        """Whether the hypotheses left expect parts but look alike from everywhere, and no view makes them surer."""
        if self.situation.sure or self.bits.max() >= LEAST_BITS or self.situation.belief.entropy_bits <= 0.1:
            return False
        seen_by_all = self.prediction.expected[:, :-1] @ self.prediction.weight[:-1]
        return bool(seen_by_all.max(initial=0.0) > 0 and self.pose.max() < LEAST_POSE_BITS)

    def move(self, pick: int, said: str) -> Move:
        """The move to a candidate, and in the policy's own words why it is the best."""
        seconds = float(self.situation.cost_s[pick])
        why = reason(float(self.bits[pick]), seconds, self._tells(pick), said)
        return Move(self.situation.candidates[pick], why, gain_bits=float(self.gain_bits[pick]), cost_s=seconds)

    def name(self, hypothesis: int) -> str:
        """A hypothesis's object and place, for people."""
        layout, place = self.situation.world.layout, int(self.outlook.place[hypothesis])
        if hypothesis == len(self.outlook.place) - 1:
            return "none of these"
        thing = layout.base.objects[int(self.outlook.object_of[hypothesis])].id
        return f"{thing} {layout.part_ids[place]}" if 0 <= place < len(layout.part_ids) else f"{thing} out of view"

    def _tells(self, pick: int) -> str:
        """Which hypotheses a view separates: the weightiest pair, and from how many more places the first of it."""
        outlook = self.outlook
        told = np.where(outlook.place[:, None] != outlook.place, 1.0 - np.exp(-outlook.apart[pick]), 0.0)
        worth = np.outer(outlook.weight, outlook.weight) * told
        one, other = (int(i) for i in np.unravel_index(int(worth.argmax()), worth.shape))
        if told[one, other] < _TOLD:
            return "tells no two places apart by itself"
        more = len(np.unique(outlook.place[told[one] >= _TOLD])) - 1
        return told_apart(self.name(one), self.name(other), more)


def reason(bits: float, seconds: float, tells: str, said: str) -> str:
    """Why a move was chosen, in one sentence."""
    return f"expects {bits:.2f} bits for {seconds:.1f} s and {tells}: {said}"


def told_apart(one: str, other: str, more: int) -> str:
    """What a view separates: one hypothesis from another, and from more of them."""
    rest = f" and {more} more place{'s' if more > 1 else ''}" if more else ""
    return f"tells {one} from {other}{rest}"


Rule = Callable[[Ahead], FloatArray]
"""Scores the candidates ``(K,)``, the best highest; ``-inf``: out of the question."""


def choose_by(situation: Situation, rule: Rule, say: Callable[[float], str]) -> Move | None:
    """The candidate that a rule scores best; ``say`` puts its score into words.

    ``None`` if there is no candidate or none can tell the rest apart. Once the place is settled, or while only a surer
    pose can bring hypotheses apart, the pose is sharpened; where nothing is expected anywhere, something new is tried.
    """
    if not situation.candidates:
        return None
    ahead = Ahead.of(situation)
    if ahead.hopeless:
        return None
    if situation.sure or ahead.bits.max() < LEAST_BITS:
        return _sharpen(ahead) if ahead.gain_bits.max() > _least(situation) else explore(ahead.situation)
    score = rule(ahead)
    if not np.isfinite(score).any():
        return ahead.move(ahead.quickest, "its rule prefers none, and this one brings the most bits a second")
    pick = int(score.argmax())
    return ahead.move(pick, say(float(score[pick])))


def view_cost_s(situation: Situation) -> float:
    """What a view costs beside its travel: a typical move's time, lest a string of cheap, useless views be taken."""
    return max(float(np.median(situation.cost_s)), 1e-3)


def explore(situation: Situation) -> Move:
    """No view is expected to tell anything: look at what is farthest from all that was seen, wide first."""
    far = np.array([min(_apart(pose, old) for old in situation.visited) for pose in situation.candidates])
    wide = np.array([pose.zoom for pose in situation.candidates])
    pick = int((far / (1.0 + 4.0 * wide) / (situation.cost_s + view_cost_s(situation))).argmax())
    return Move(
        situation.candidates[pick],
        "no view is expected to tell anything, so a part of the scene not seen yet is tried "
        f"for {situation.cost_s[pick]:.1f} s",
        cost_s=float(situation.cost_s[pick]),
    )


def _least(situation: Situation) -> float:
    return 0.0 if situation.sure else LEAST_BITS


def _sharpen(ahead: Ahead) -> Move:
    """The most bits about the pose per second."""
    pick = ahead.quickest
    seconds, pose = float(ahead.situation.cost_s[pick]), float(ahead.pose[pick])
    reason = "the place is settled" if ahead.situation.sure else "only a surer pose can bring apart what is left"
    why = f"{reason}; this view sharpens the pose by {pose:.1f} bits for {seconds:.1f} s"
    return Move(ahead.situation.candidates[pick], why, gain_bits=float(ahead.gain_bits[pick]), cost_s=seconds)


def _apart(a: RigPose, b: RigPose) -> float:
    """How different two views are: degrees of pan, plus zoom; position is left to the cost."""
    turn = abs((a.theta_deg - b.theta_deg + 180.0) % 360.0 - 180.0)
    return float(turn + 20.0 * abs(a.zoom - b.zoom) + 1.0)


def _meaning(situation: Situation, prediction: Prediction) -> tuple[IntArray, IntArray]:
    """Place (the part in the middle of the last view) and object ``(M,)`` of the sample; "none" has its own."""
    hypotheses = situation.belief.hypotheses.take(prediction.rows)
    middle = places(situation.world, replace(situation.belief, hypotheses=hypotheses), situation.views)
    # Those that show nothing there are not one place for that.
    unseen = len(situation.world.layout.part_ids) + np.arange(len(middle))
    return np.append(np.where(middle >= 0, middle, unseen), -1), np.append(hypotheses.object_of, -1)
