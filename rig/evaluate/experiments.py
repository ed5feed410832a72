"""Stages the paper's experiments, as a plan describes them, on rendered pictures.

A start is chosen before its run, by one rule: of the first few random views that show what the experiment is about, the
one that comes nearest to the paper's first view in the number of hypotheses that it leaves, and leaves no fewer.
Hypotheses left are those that hold 99.9 % of the probability. They need not be equal, as the paper's are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from recognition.modelbase import ModelBase, ObjectModel
from recognition.rates import DetectionRates
from recognition.recogniser import recognise
from recognition.settings import BenchBounds, RecogniserSettings
from rig.errors import RigError
from rig.evaluate.plan import Task
from rig.evaluate.plan_file import ExperimentEntry, FirstViewEntry, StartEntry
from rig.evaluate.staging import Stage, model_base
from sim_backends.internals_policy import FixedByZoom
from sim_backends.renderer import PartTruth
from sim_backends.simulate import draw_scene
from sim_backends.staged_rig import HalfBlindDetector, StagedRig, whole
from sim_backends.viewpoints import limits_around, viewing_poses

STAND_OFFS_MM = (200.0, 350.0)
SETTINGS = RecogniserSettings(
    bounds=BenchBounds(60, 2000, 15, 70),
    rates=DetectionRates(found=0.97, clutter=0.2, corner_sd_px=0.5),
)
_MOST_DRAWN, _TRIED, _MOST_SEEDS = 200, 8, 20


def stages(task: Task) -> list[Stage]:
    """The runs of a trial: one, or one for each zoom of the third view.

    Raises:
        RigError: no start was found.
    """
    conditions, base = task.row.conditions, model_base(task.row.source)
    assert conditions.experiment is not None
    experiment = conditions.experiment
    start = _start(task, experiment, base)
    asked = conditions.recogniser.model_dump()
    settings = replace(SETTINGS, **asked, seed=task.seed, policy=task.row.policy)
    if experiment.third_zooms:
        settings = at_third_views(settings)
    found = []
    for zoom in experiment.third_zooms or (None,):
        rig = staged_rig(experiment, base, start, cluttered=conditions.clutter, third_zoom=zoom)
        detector = HalfBlindDetector(rig, base) if experiment.half_blind else None
        found.append(Stage(rig, base, start.object, True, settings, detector))
    return found


def at_third_views(settings: RecogniserSettings) -> RecogniserSettings:
    """The settings so that a third view is taken even where two tell the place: no pose is ever that sure."""
    return replace(settings, max_views=3, pose_sd_mm=1e-6)


def staged_rig(
    experiment: ExperimentEntry,
    base: ModelBase,
    start: StartEntry,
    *,
    cluttered: bool = False,
    third_zoom: float | None = None,
) -> StagedRig:
    """The rig of an experiment, at its first view."""
    scene = draw_scene(base, start.object, start.seed, cluttered=cluttered)
    poses = viewing_poses(scene.object_model, scene.object_in_rig, STAND_OFFS_MM, zooms=(0.0, 1.0))
    # The paper counts views, not seconds: beside a view, the way to it costs next to nothing here.
    limits = replace(limits_around(poses), settle_s=100.0)
    inner = FixedByZoom(**{str(key): value for key, value in experiment.camera.items()})
    rig = StagedRig(scene, limits, poses, internals=inner, seed=start.seed)
    rig.tree_in = frozenset(experiment.trees_before)
    rig.zoom_of = {} if third_zoom is None else {3: third_zoom}
    rig.begin(poses[start.pose])
    return rig


def starts(
    experiment: ExperimentEntry, base: ModelBase, seeds: Sequence[int], *, cluttered: bool = False
) -> Iterator[StartEntry]:
    """The start of each seed, by the rule above; a seed without any among 200 views is left out."""
    for seed in seeds:
        thing = base.objects[seed % len(base.objects)]
        rig = staged_rig(experiment, base, StartEntry(object=thing.id, seed=seed, pose=0), cluttered=cluttered)
        poses = rig.reachable()
        fit: dict[int, int] = {}
        for k in np.random.default_rng([seed, experiment.number]).permutation(len(poses))[:_MOST_DRAWN]:
            start = StartEntry(object=thing.id, seed=seed, pose=int(k))
            if shows(experiment.first_view, thing, rig.parts(poses[k])):
                left = left_by_first_view(experiment, base, start, cluttered=cluttered)
                if left >= experiment.hypotheses:
                    fit[int(k)] = left
            if len(fit) == _TRIED:
                break
        if fit:
            yield StartEntry(object=thing.id, seed=seed, pose=min(fit, key=lambda k: fit[k]))


def left_by_first_view(
    experiment: ExperimentEntry, base: ModelBase, start: StartEntry, *, cluttered: bool = False
) -> int:
    """Hypotheses that the first view leaves."""
    rig = staged_rig(experiment, base, start, cluttered=cluttered)
    return next(recognise(rig, base, replace(SETTINGS, seed=start.seed))).belief.hypotheses_left


def shows(wanted: FirstViewEntry, thing: ObjectModel, shown: Sequence[PartTruth]) -> bool:
    """Whether a view shows what an experiment is about."""
    seen = whole(shown)
    if wanted.parts is not None and len(seen) != wanted.parts:
        return False
    if wanted.classes is not None and not all(part.part_class.startswith(wanted.classes) for part in seen):
        return False
    if wanted.two_faces:
        normal = {part.id: part.normal for part in thing.parts}
        return any(abs(normal[a.id] @ normal[b.id]) < 0.1 for a, b in combinations(seen, 2))
    return bool(seen)


def _start(task: Task, experiment: ExperimentEntry, base: ModelBase) -> StartEntry:
    """Of the trial's number: one found beforehand, or else by the rule, from seeds that no other trial begins from."""
    if task.number < len(experiment.starts):
        return experiment.starts[task.number]
    seeds = [task.seed + 100_000 * k for k in range(_MOST_SEEDS)]
    found = next(starts(experiment, base, seeds, cluttered=task.row.conditions.clutter), None)
    if found is None:
        raise RigError(
            f"experiment {experiment.number}: none of {_MOST_SEEDS} scenes has a view that shows its beginning"
        )
    return found
