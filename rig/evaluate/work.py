"""Does one trial and says how it went, as a line for the record; a trial that fails says so and why."""

from __future__ import annotations

import traceback
from dataclasses import asdict, replace
from math import hypot
from pathlib import Path
from typing import Any

from rig.evaluate.plan import Task
from rig.evaluate.plan_file import RowEntry
from rig.evaluate.trial import RIGHT, UNDECIDED, WRONG, Trial, run, scored

WITHIN_MM, WITHIN_DEG = 60.0, 1.0
"""A pose so near the true one is right. The truth is where the rig really stands, which may not be where it reads."""
_MOTION_SDS = 3.0
_WORST_FIRST = (WRONG, UNDECIDED, RIGHT)

Record = dict[str, Any]
"""One line of ``trials.jsonl``: ``row``, ``number``, ``seed`` and either a `Trial`'s fields or ``error``."""


def record_of(task: Task) -> Record:
    """Do a trial. Whatever goes wrong in it becomes its record: one trial must not cost the others."""
    from rig.run.events import finite

    head = {"row": task.row.key, "number": task.number, "seed": task.seed}
    try:
        trial = trial_of(task)
    except Exception as error:
        return {**head, "error": _told(error)}
    record: Record = finite({**head, **asdict(trial)})
    return record


def trial_of(task: Task) -> Trial:
    """Do a trial: of several runs, as an experiment may ask for, the one that went worst."""
    from rig.evaluate.experiments import stages
    from rig.evaluate.staging import staged

    found = [staged(task)] if task.row.conditions.experiment is None else stages(task)
    name, within = f"{task.row.key} | {task.seed}", tolerance(task.row.conditions)
    return min((_recognised(name, stage, *within) for stage in found), key=lambda trial: _WORST_FIRST.index(trial.kind))


def tolerance(conditions: RowEntry) -> tuple[float, float]:
    """How far, mm and degrees, the camera may be told from where it is: no view tells the last motion error apart."""
    noise = conditions.noise
    if noise is None:
        return WITHIN_MM, WITHIN_DEG
    off_mm, off_deg = _MOTION_SDS * noise.motion_sd_mm, _MOTION_SDS * noise.motion_theta_sd_deg
    return hypot(WITHIN_MM, off_mm), hypot(WITHIN_DEG, off_deg)


def _recognised(name: str, stage: Any, within_mm: float, within_deg: float) -> Trial:
    from recognition.recogniser import recognise
    from rig.evaluate.places import place_right

    answer, steps = run(recognise(stage.rig, stage.base, stage.settings, detector=stage.detector))
    true = stage.rig.truth(steps[-1].frame.rig_pose).camera_in_object
    placed = place_right(stage.rig, stage.base.classes, steps)
    trial = scored(name, answer, steps, stage.true_object, true, within_mm, within_deg, placed)
    travel_s = steps[-1].frame.exposed_at_s - steps[0].frame.exposed_at_s
    trial = replace(trial, travel_s=travel_s, log=[] if trial.kind == RIGHT else trial.log)
    return trial if stage.in_base else _of_stranger(trial)


def _of_stranger(trial: Trial) -> Trial:
    """Of an object that the base does not hold, whatever names none is right."""
    return replace(trial, kind=WRONG if trial.named is not None else RIGHT)


def _told(error: Exception) -> str:
    """The error, and the line that raised it."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = "/".join(Path(last.filename).parts[-3:])
    return f"{type(error).__name__}: {error} ({where}:{last.lineno} in {last.name}: {last.line})"
