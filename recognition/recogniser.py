"""The loop: look, update the belief, decide whether to stop, choose the next view, move. A generator of steps."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence

import numpy as np

from recognition.belief import Belief, challengers, fit_leaders, rivals, thin, update, weigh, with_relatives
from recognition.detectors import load_detector
from recognition.hypotheses import Hypotheses, forget_contradicted, join
from recognition.journey import Journey
from recognition.levelling import levelled
from recognition.modelbase import ModelBase
from recognition.parts import DetectedPart, Detector
from recognition.policies import Policy, load_policy
from recognition.second_look import look_again
from recognition.seen import Seen
from recognition.settings import RecogniserSettings
from recognition.steps import Answer, Move, Outcome, Step, StepSeconds
from recognition.summary import Verdict, answer, judge, leading_group, summarise, views_taken
from recognition.tracking import World, make_world
from rig.hal import Frame, Rig

_ABOUT_TO_WIN = 0.99


def recognise(
    rig: Rig, model_base: ModelBase, settings: RecogniserSettings, *, detector: Detector | None = None
) -> Generator[Step, None, Answer]:
    """Recognise what stands in front of the rig, from where it stands now.

    Args:
        rig: at its first view; moved by the loop.
        model_base: the objects that can be told.
        settings: policy, thresholds, bounds.
        detector: in place of the one that the settings name.

    Yields:
        a ``Step`` for each view taken.

    Returns:
        the ``Answer``.
    """
    if settings.mode == "paper":
        from recognition.paper_mode import recognise_as_paper

        return (yield from recognise_as_paper(rig, model_base, settings, detector=detector))
    finder = detector if detector is not None else load_detector(settings.detector, model_base.classes)
    state = _State(rig, make_world(model_base, settings.bounds, settings.rates, settings.prior), settings)
    policy = load_policy(settings.policy)
    while True:
        frame = levelled(rig.capture(), settings.mount)
        t0 = time.perf_counter()
        parts = tuple(finder.detect(frame.image))
        t1 = time.perf_counter()
        state.absorb(frame, parts)
        t2 = time.perf_counter()
        verdict = state.verdict()
        move = None
        if verdict is None or verdict.wanted:
            move = state.choose(policy, sure=verdict is not None)
        t3 = time.perf_counter()
        if move is None and (verdict is None or verdict.wanted):
            verdict = state.give_up(verdict)
        step = Step(
            index=len(state.views) - 1,
            frame=frame,
            parts=parts,
            belief=summarise(state.world, state.belief, state.views, frame),
            move=move,
            seconds=StepSeconds(t1 - t0, t2 - t1, t3 - t2),
        )
        yield step
        if move is None:
            assert verdict is not None
            return answer(state.world, state.belief, state.views, verdict, state.journey.path)
        rig.move_to(move.target)


class _State:
    """What a run carries from view to view."""

    def __init__(self, rig: Rig, world: World, settings: RecogniserSettings) -> None:
        self.world, self.settings = world, settings
        self.journey = Journey(rig, world, settings)
        self.hypotheses: Hypotheses | None = None
        self.belief = Belief.empty()

    @property
    def views(self) -> list[Seen]:
        """All views so far."""
        return self.journey.views

    def absorb(self, frame: Frame, parts: Sequence[DetectedPart]) -> None:
        """Update the belief with one view."""
        effort, edges = self.settings.effort, None
        if effort.second_looks:
            from recognition.detectors.edges import EdgeField

            edges = EdgeField(frame.image)
        self.journey.add(frame, parts[: effort.detections], edges)
        hypotheses = update(self.world, self.hypotheses, self.views, effort)
        self._believe(self._look_again(hypotheses))
        self._try_rivals()

    def _look_again(self, hypotheses: Hypotheses) -> Hypotheses:
        most = self.settings.effort.second_looks
        if not most:
            return hypotheses
        order = np.argsort(-hypotheses.log_weight, kind="stable")
        ahead, rest = order[:most], order[most:]
        return join(look_again(self.world, hypotheses.take(ahead), self.views), hypotheses.take(rest))

    def _believe(self, hypotheses: Hypotheses) -> None:
        hypotheses = fit_leaders(self.world, hypotheses, self.views)
        self.hypotheses = forget_contradicted(hypotheses)
        self.belief = with_relatives(self.world, weigh(self.world, hypotheses), self.views)

    def _try_rivals(self) -> None:
        """When a place is about to win, let all places alike compete with it on all views."""
        belief = self.belief
        if len(belief.hypotheses) == 0 or len(self.views) < 2:
            return
        group = leading_group(self.world, belief, self.views)
        if belief.probability[group].sum() < min(self.settings.threshold, _ABOUT_TO_WIN):
            return
        alike = rivals(self.world, belief.hypotheses, self.views, 0)
        others = join(alike, challengers(self.world, self.views, self.settings.effort))
        if len(others) == 0:
            return
        best = thin(others, self.views[-1], max(self.settings.effort.second_looks, 40))
        self._believe(
            thin(join(belief.hypotheses, self._look_again(best)), self.views[-1], len(belief.hypotheses) + 40)
        )

    def verdict(self) -> Verdict | None:
        """Whether the run may end, and as what; it may still want a surer pose."""
        return judge(self.world, self.belief, self.views, self.settings)

    def give_up(self, settled: Verdict | None) -> Verdict:
        """What to say when no view is left that can tell more; ``settled``: of a place that is, but for its pose."""
        if settled is not None:
            return settled.without(
                f"{views_taken(len(self.views))}, which is the most"
                if self.journey.at_its_end
                else "no reachable view makes it surer"
            )
        if self.belief.probability.sum() > self.belief.none:
            return Verdict(Outcome.AMBIGUOUS, "no reachable view separates what is left")
        return Verdict(Outcome.NOT_FOUND, "no reachable view shows a part that would tell an object")

    def choose(self, policy: Policy, *, sure: bool) -> Move | None:
        """Ask the policy for the next view, among those not taken."""
        if self.journey.at_its_end:
            return None
        here = self.journey.path[-1]
        return policy.choose(self.journey.situation(self.belief, here, self.journey.fresh(here), sure=sure))
