"""Policies: how the next view is chosen. Entry-point group ``rig.policies``; all use one predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import entry_points
from typing import Protocol

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.geometry import Mount
from recognition.predict import Prediction, predict
from recognition.seen import Seen
from recognition.steps import Move
from recognition.tracking import World
from rig.errors import InputError
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Situation:
    """All that a policy may know when it chooses.

    Attributes:
        world: model base, bounds, rates.
        belief: after the last view.
        views: all views so far.
        pose: where the rig stands.
        visited: rig poses of all views so far.
        candidates: K reachable poses that have not been visited.
        groups: internals group of each candidate, ``None`` if not seen yet.
        cost_s: ``(K,)`` seconds to each candidate, settling and exposure included.
        sure: True when the object and the place are settled and only the pose is to be sharpened.
        mount: the camera's lever arm.
        most: candidates that a policy should compare at most, to keep its time.
        rng: for policies that draw.
    """

    world: World
    belief: Belief
    views: list[Seen]
    pose: RigPose
    visited: tuple[RigPose, ...]
    candidates: Sequence[RigPose]
    groups: Sequence[int | None]
    cost_s: FloatArray
    sure: bool
    mount: Mount
    most: int
    rng: np.random.Generator = field(repr=False)

    def fewer(self) -> Situation:
        """The situation with at most ``most`` candidates: half the nearest in time, half drawn from the others."""
        if len(self.candidates) <= self.most:
            return self
        order = np.argsort(self.cost_s, kind="stable")
        half = self.most // 2
        drawn = self.rng.choice(order[half:], size=self.most - half, replace=False)
        keep = [int(i) for i in np.concatenate([order[:half], drawn])]
        return replace(
            self,
            candidates=[self.candidates[i] for i in keep],
            groups=[self.groups[i] for i in keep],
            cost_s=self.cost_s[keep],
        )

    def predict(self, most: int = 40) -> Prediction:
        """What a sample of the belief would see from each candidate."""
        return predict(
            self.world, self.belief, self.views, self.candidates, self.groups, self.mount, most=most, rng=self.rng
        )


class Policy(Protocol):
    """Chooses the next view."""

    def choose(self, situation: Situation) -> Move | None:
        """The next view; ``None`` if no candidate can tell anything more, which ends the run."""
        ...


def load_policy(name: str) -> Policy:
    """Make the policy of that name.

    Raises:
        InputError: there is none; lists those that exist.
    """
    known = {point.name: point for point in entry_points(group="rig.policies")}
    if name not in known:
        raise InputError(
            f"unknown policy {name!r}", where="--policy", remedy=f"Choose one of: {', '.join(sorted(known))}"
        )
    policy: Policy = known[name].load()()
    return policy
