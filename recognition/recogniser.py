"""The loop: look, update the belief, decide whether to stop, choose the next view, move. A generator of steps."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief, rivals, thin, update, weigh
from recognition.detectors import load_detector
from recognition.geometry import camera_in_rig, wrap_deg
from recognition.hypotheses import Hypotheses, forget_contradicted, join
from recognition.levelling import levelled
from recognition.modelbase import ModelBase
from recognition.parts import DetectedPart, Detector
from recognition.policies import Policy, Situation, load_policy
from recognition.second_look import look_again
from recognition.seen import Seen, see
from recognition.settings import RecogniserSettings
from recognition.steps import Answer, Move, Outcome, Step, StepSeconds
from recognition.summary import Verdict, answer, judge, leading_group, summarise
from recognition.tracking import World, make_world
from rig.hal import Frame, Rig, RigPose

FloatArray = npt.NDArray[np.float64]

_ABOUT_TO_WIN, _AHEAD = 0.9, 0.5


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
    state = _State.begin(rig, make_world(model_base, settings.bounds, settings.rates), settings)
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
        if verdict is None or not verdict.final:
            move = state.choose(policy, sure=verdict is not None)
        t3 = time.perf_counter()
        if verdict is None and move is None:
            verdict = state.give_up()
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
            return answer(state.world, state.belief, state.views, verdict, state.path)
        rig.move_to(move.target)


@dataclass
class _State:
    """What a run carries from view to view."""

    rig: Rig
    world: World
    settings: RecogniserSettings
    rng: np.random.Generator
    views: list[Seen]
    path: list[RigPose]
    visited: list[RigPose]
    groups: dict[float, int]
    hypotheses: Hypotheses | None
    belief: Belief

    @staticmethod
    def begin(rig: Rig, world: World, settings: RecogniserSettings) -> _State:
        rng = np.random.default_rng(settings.seed)
        return _State(rig, world, settings, rng, [], [], [], {}, None, Belief.empty())

    def absorb(self, frame: Frame, parts: Sequence[DetectedPart]) -> None:
        """Update the belief with one view."""
        self.views.append(self._seen(frame, parts))
        self.path.append(frame.rig_pose)
        self.visited.append(frame.commanded)
        hypotheses = update(self.world, self.hypotheses, self.views, self.settings.effort)
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
        self.hypotheses = forget_contradicted(hypotheses)
        self.belief = weigh(self.world, hypotheses)

    def _try_rivals(self) -> None:
        """When a place is about to win, let all places alike compete with it on all views."""
        belief = self.belief
        if len(belief.hypotheses) == 0 or len(self.views) < 2:
            return
        group = leading_group(self.world, belief, self.views)
        if belief.probability[group].sum() < (_ABOUT_TO_WIN if len(self.views) < 4 else _AHEAD):
            return
        challengers = rivals(self.world, belief.hypotheses, self.views, 0)
        if len(challengers) == 0:
            return
        best = thin(challengers, self.views[-1], max(self.settings.effort.second_looks, 40))
        self._believe(
            thin(join(belief.hypotheses, self._look_again(best)), self.views[-1], len(belief.hypotheses) + 40)
        )

    def _seen(self, frame: Frame, parts: Sequence[DetectedPart]) -> Seen:
        height, width = frame.image.shape[:2]
        edges = None
        if self.settings.effort.second_looks:
            from recognition.detectors.edges import EdgeField

            edges = EdgeField(frame.image)
        return see(
            parts[: self.settings.effort.detections],
            camera_in_rig(frame.rig_pose, self.settings.mount),
            (width, height),
            self._group(frame.rig_pose),
            frame.rig_pose.zoom,
            self.world.layout.class_names,
            self.world.layout.corners_mm.shape[1],
            edges,
        )

    def _group(self, pose: RigPose) -> int:
        """Views of one zoom setting share internals if the rig vouches for it; else each view has its own."""
        if not self.rig.internals_fixed_by_zoom:
            return len(self.views)
        return self.groups.setdefault(round(pose.zoom, 6), len(self.groups))

    def verdict(self) -> Verdict | None:
        """Whether the run may end, and as what; one that is not final still wants a surer pose."""
        return judge(self.world, self.belief, self.views, self.settings)

    def give_up(self) -> Verdict:
        """What to say when no view can tell more."""
        if self.belief.probability.sum() > self.belief.none:
            return Verdict(Outcome.AMBIGUOUS, "no reachable view separates what is left")
        return Verdict(Outcome.NOT_FOUND, "no reachable view shows a part that would tell an object")

    def choose(self, policy: Policy, *, sure: bool) -> Move | None:
        """Ask the policy for the next view, among those not visited."""
        if len(self.views) >= self.settings.max_views:
            return None
        here = self.path[-1]
        candidates = [p for p in self.rig.reachable(here) if not any(_same(p, old) for old in self.visited)]
        situation = Situation(
            world=self.world,
            belief=self.belief,
            views=self.views,
            pose=here,
            visited=tuple(self.path),
            candidates=candidates,
            groups=[
                self.groups.get(round(p.zoom, 6)) if self.rig.internals_fixed_by_zoom else None for p in candidates
            ],
            cost_s=np.array([self.rig.travel_s(here, p) for p in candidates]),
            sure=sure,
            mount=self.settings.mount,
            most=self.settings.effort.candidates,
            rng=self.rng,
        )
        return policy.choose(situation)


def _same(a: RigPose, b: RigPose) -> bool:
    near = max(abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm), abs(a.z_mm - b.z_mm)) < 0.5
    return near and abs(wrap_deg(a.theta_deg - b.theta_deg)) < 0.1 and abs(a.zoom - b.zoom) < 1e-3
