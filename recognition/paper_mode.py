"""The paper to the letter (its Fig. 5): 0/1 likelihood, elimination for good, and backtracking from empty views."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.detectors import load_detector
from recognition.journey import Journey
from recognition.levelling import levelled
from recognition.modelbase import ModelBase
from recognition.paper_belief import Interpretations, carry, central, eliminate, interpret
from recognition.parts import DetectedPart, Detector
from recognition.policies import Policy, load_policy
from recognition.seen import Seen
from recognition.settings import RecogniserSettings
from recognition.steps import Answer, BeliefSummary, Move, Outcome, Step, StepSeconds
from recognition.summary import Verdict, answer, summarise, views_taken, wanted_of_pose
from recognition.tracking import World, make_world
from rig.hal import Frame, Rig

IntArray = npt.NDArray[np.int64]

_CLEAR, _LEAST_CLEAR = 0.85, 0.5
"""The paper knows no doubtful detections: a view has parts, and a part in its middle, by those of nearly the best
confidence. Where a part is expected, a doubtful detection will do: the gates judge it."""


def recognise_as_paper(
    rig: Rig, model_base: ModelBase, settings: RecogniserSettings, *, detector: Detector | None = None
) -> Generator[Step, None, Answer]:
    """Recognise as the paper does, from where the rig stands.

    Interpretations are the (object, part) pairs for the part nearest to the centre of the first view. A later view
    keeps those whose expected part is found with the right class and a pose within 5 degrees and 20 mm. A view without
    any part is undone, and the next-best leaf is tried from where the rig was before. The run ends when one
    interpretation holds the threshold (1.0 in the paper), when none is left (``not_found``), or when no view is left.
    It never goes on for a surer pose; the answer tells whether the pose is as sure as the settings ask.

    Fig. 5 calls get_best_leaf in its step 13 before it sets previous := new_node; the leaf sought here is new_node's.

    Args:
        rig: at its first view; moved by the loop.
        model_base: the objects that can be told.
        settings: policy, threshold, most views; bounds and rates serve the soft priors of single-part poses.
        detector: in place of the one that the settings name.
    """
    finder = detector if detector is not None else load_detector(settings.detector, model_base.classes)
    policy = load_policy(settings.policy)
    state = _State(rig, make_world(model_base, settings.bounds, settings.rates), settings)
    while True:
        frame = levelled(rig.capture(), settings.mount)
        t0 = time.perf_counter()
        parts = tuple(finder.detect(frame.image))
        t1 = time.perf_counter()
        state.absorb(frame, parts)
        t2 = time.perf_counter()
        verdict = state.verdict()
        move = state.choose(policy) if verdict is None else None
        t3 = time.perf_counter()
        yield Step(
            len(state.views) - 1, frame, parts, state.summary(frame), move, StepSeconds(t1 - t0, t2 - t1, t3 - t2)
        )
        if move is None:
            return answer(state.world, state.belief, state.views, verdict or state.give_up(), state.journey.path)
        if state.empty and state.previous != frame.rig_pose:
            rig.move_to(state.previous)
            state.journey.came_back(state.previous)
        rig.move_to(move.target)


class _State:
    """What a run carries from view to view. ``previous``: where the last view with parts was taken (Fig. 5)."""

    def __init__(self, rig: Rig, world: World, settings: RecogniserSettings) -> None:
        self.rig, self.world, self.settings = rig, world, settings
        self.journey = Journey(rig, world, settings)
        self.left: Interpretations | None = None
        self.belief = Belief.empty()
        self.previous = rig.pose
        self.empty = True

    @property
    def views(self) -> list[Seen]:
        """All views so far."""
        return self.journey.views

    def absorb(self, frame: Frame, parts: Sequence[DetectedPart]) -> None:
        """Interpret the first view that shows parts; let each later one eliminate."""
        clear = _clear(self.journey.add(frame, parts), parts)
        self.empty = clear.size == 0
        if not self.empty:
            self.previous = frame.rig_pose
        if self.left is not None:
            look = carry if self.empty else eliminate
            self.left = look(self.world, self.left, self.views)
        elif not self.empty:
            self.left = interpret(self.world, self.views, central(self.views[-1], clear))
        if self.left is not None:
            self.belief = self.left.belief()

    def verdict(self) -> Verdict | None:
        """Whether the run ends after this view, and as what."""
        if self.left is None:
            return self.give_up() if self.journey.at_its_end else None
        count = self.left.count
        if count == 0:
            return Verdict(
                Outcome.NOT_FOUND,
                "no interpretation has its expected part in this view within 5 degrees and 20 mm, and what the paper's "
                "0/1 likelihood has eliminated it does not take back",
            )
        mass = self.left.most_probable
        if count == 1 or mass >= self.settings.threshold:
            wanted = wanted_of_pose(self.world, self.belief, self.views, self.settings)
            verdict = Verdict(Outcome.RECOGNISED, f"one of {count} interpretations left holds {mass:.4f}", wanted)
            return verdict.without("the paper takes no view for the pose's sake") if wanted else verdict
        return self.give_up() if self.journey.at_its_end else None

    def give_up(self) -> Verdict:
        """What to say when no view is left to take."""
        if self.left is None or self.left.count == 0:
            return Verdict(Outcome.NOT_FOUND, f"{views_taken(len(self.views))}, and none shows a part to begin with")
        ended = (
            f"{views_taken(len(self.views))}, which is the most"
            if self.journey.at_its_end
            else "no view is left that shows an expected part"
        )
        return Verdict(Outcome.AMBIGUOUS, f"{ended}, and {self.left.count} interpretations are left")

    def choose(self, policy: Policy) -> Move | None:
        """The next view, sought from where the last part was seen; an empty view is undone first."""
        here = self.previous
        # Only the nearest in time: the search tree branches at each.
        fresh = sorted(self.journey.fresh(here), key=lambda p: self.rig.travel_s(here, p))
        candidates = fresh[: self.settings.effort.candidates]
        move = policy.choose(self.journey.situation(self.belief, here, candidates, sure=False))
        if move is None or not self.empty or self.left is None:
            return move
        return replace(
            move, why=f"the view is empty, so the move is undone and the next-best leaf is taken: {move.why}"
        )

    def summary(self, frame: Frame) -> BeliefSummary:
        """The belief as shown to a person; interpretations are counted, not weighed."""
        shown = summarise(self.world, self.belief, self.views, frame)
        return replace(shown, hypotheses_left=0 if self.left is None else self.left.count)


def _clear(seen: Seen, parts: Sequence[DetectedPart]) -> IntArray:
    """Detections that count as parts."""
    confidence = np.array([parts[i].confidence for i in seen.source])
    return np.flatnonzero(confidence >= max(_CLEAR * confidence.max(initial=0.0), _LEAST_CLEAR))
