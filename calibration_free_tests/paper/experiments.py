"""The paper's Experiments 1 to 5, as the plan ``paper`` of ``rig evaluate`` stages them, and how each run went.

`rig.evaluate.experiments` tells how a start is chosen. Hypotheses left are those that hold 99.9 % of the probability;
they need not be equal, as the paper's are: the entropy tells how open it really is.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from recognition.geometry import CameraPose, wrap_deg
from recognition.modelbase import ModelBase
from recognition.parts import Detector
from recognition.recogniser import recognise
from recognition.steps import Answer, Outcome, Step
from rig.evaluate.experiments import SETTINGS, at_third_views, staged_rig
from rig.evaluate.plan import load_plan
from rig.evaluate.plan_file import ExperimentEntry, StartEntry
from sim_backends.staged_rig import HalfBlindDetector, StagedRig

RIGHT_MM, RIGHT_DEG = 50.0, 2.0

EXPERIMENTS = tuple(
    row.conditions.experiment for row in load_plan("paper").rows if row.conditions.experiment is not None
)


@dataclass(frozen=True)
class Run:
    """How a run went.

    Attributes:
        start: where it began.
        left: hypotheses left after each view.
        entropy_bits: after the first view.
        answer: the answer; right: whether it names the object and places the camera within 50 mm and 2 degrees.
        truth: the camera in the object frame at the last view.
        error_mm: of the position; error_deg: of the pan.
        same_view: poses found at each of the third zooms (one run only: the answer's).
    """

    start: StartEntry
    left: tuple[int, ...]
    entropy_bits: float
    answer: Answer
    truth: CameraPose
    right: bool
    error_mm: float
    error_deg: float
    same_view: tuple[CameraPose, ...]

    @property
    def spread(self) -> tuple[float, float]:
        """Greatest distance, mm, and angle, degrees, between any two of ``same_view``."""
        pairs = list(combinations(self.same_view, 2))
        apart = max((float(np.linalg.norm(a.centre_mm - b.centre_mm)) for a, b in pairs), default=0.0)
        turned = max((abs(wrap_deg(a.theta_deg - b.theta_deg)) for a, b in pairs), default=0.0)
        return apart, turned


def run(experiment: ExperimentEntry, base: ModelBase, start: StartEntry, *, policy: str = "information") -> Run:
    """Run an experiment from a start: once, or once for each zoom of the third view."""
    settings = replace(SETTINGS, seed=start.seed, policy=policy)
    if experiment.third_zooms:
        settings = at_third_views(settings)
    ends = []
    for zoom in experiment.third_zooms or (None,):
        rig = staged_rig(experiment, base, start, third_zoom=zoom)
        detector: Detector | None = HalfBlindDetector(rig, base) if experiment.half_blind else None
        ends.append((rig, *_drive(recognise(rig, base, settings, detector=detector))))
    rig, steps, answer = ends[0]
    return _scored(rig, start, steps, answer, tuple(a.pose for _, _, a in ends if a.pose is not None))


def _drive(steps: Generator[Step, None, Answer]) -> tuple[list[Step], Answer]:
    taken: list[Step] = []
    while True:
        try:
            taken.append(next(steps))
        except StopIteration as end:
            return taken, end.value


def _scored(rig: StagedRig, start: StartEntry, steps: list[Step], answer: Answer, poses: tuple[CameraPose, ...]) -> Run:
    truth = rig.truth().camera_in_object
    error_mm = error_deg = float("inf")
    if answer.pose is not None:
        error_mm = float(np.linalg.norm(answer.pose.centre_mm - truth.centre_mm))
        error_deg = abs(wrap_deg(answer.pose.theta_deg - truth.theta_deg))
    named = answer.outcome is Outcome.RECOGNISED and answer.object_id == start.object
    return Run(
        start,
        tuple(step.belief.hypotheses_left for step in steps),
        steps[0].belief.entropy_bits,
        answer,
        truth,
        named and error_mm < RIGHT_MM and error_deg < RIGHT_DEG,
        error_mm,
        error_deg,
        poses,
    )
