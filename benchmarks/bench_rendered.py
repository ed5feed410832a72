"""Prints how recognition ends on rendered views of the shipped buildings, the policies side by side on the same trials.

Run: python -m benchmarks.bench_rendered architecture [--trials 20] [--first 0] [--policies information random]
         [--internals changing] [--mode graded|paper] [--jobs 2] [--keep FILE]
In each trial everything is drawn from its number: the object, its place in the rig frame, its looks, the camera's
internals of every view, and the start among the reachable views that show at least one whole part. Right means: the
object, and the place on it: the camera within 30 mm (half the least spacing of parts) and 10 degrees of the truth at
the last view, or most parts that the answer claims to see there are the very ones that are there (from one or two views
the distance may be unsure by more than 30 mm without any doubt about the place). How many are within 30 mm and 10
degrees is told, too. The bench is the demonstration's; no more sureness is asked than by default. A run may take 12
views whatever the policy; those that end undecided count with the views that they took. ``--mode paper`` follows the
paper to the letter, with its threshold of 1.0 and, unless others are named, its policy alone.
With ``--keep`` a run that was cut off goes on; with ``--jobs 1`` the times are those of a process that has all cores.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.trials import keep, kept_trials, spread_out, table
from rig.evaluate.trial import RIGHT, Trial, run, scored

if TYPE_CHECKING:
    from recognition.modelbase import ModelBase
    from recognition.settings import Mode
    from rig.hal import RigPose
    from sim_backends.internals_policy import InternalsPolicy
    from sim_backends.rendered_rig import RenderedRig

WITHIN_MM, WITHIN_DEG = 30.0, 10.0
DISTANCES_MM = (150.0, 300.0)
WHOLE = 0.99


@dataclass(frozen=True)
class Task:
    """One trial under one policy."""

    models: str
    number: int
    policy: str
    internals: str
    max_views: int
    mode: Mode = "graded"

    @property
    def name(self) -> str:
        mode = "" if self.mode == "graded" else f"-{self.mode}-mode"
        return f"{self.models}-{self.number:04d}-{self.policy}-{self.internals}{mode}"


@cache
def models(name: str) -> ModelBase:
    from recognition.modelbase_io import load_model_base

    return load_model_base(name)


def recognise_once(task: Task) -> Trial:
    """Draw the trial, run it and score it."""
    from recognition.recogniser import recognise
    from recognition.settings import RecogniserSettings
    from rig.bench import BenchConfig, BenchFile
    from rig.cli.recognising import on_bench
    from rig.demo import CLEAN_BENCH
    from rig.evaluate.places import names_parts_right
    from rig.evaluate.staging import first_view
    from sim_backends.simulate import draw_scene, rendered_rig

    base = models(task.models)
    rng = np.random.default_rng([task.number, 7])
    thing = base.objects[int(rng.integers(len(base.objects)))]
    rig = rendered_rig(
        draw_scene(base, thing.id, task.number),
        distances_mm=DISTANCES_MM,
        internals=internals(task.internals),
        seed=task.number,
    )
    rig.move_to(first_view(rig, rng))
    bench = BenchConfig("rendered", BenchFile.model_validate(CLEAN_BENCH))
    asked = RecogniserSettings(
        mode=task.mode,
        policy=task.policy,
        threshold=1.0 if task.mode == "paper" else 0.99,
        seed=task.number,
        max_views=task.max_views,
    )
    answer, steps = run(recognise(rig, base, on_bench(asked, bench)))
    true = rig.truth(steps[-1].frame.rig_pose).camera_in_object
    notes = [f"[{whole_parts(rig, step.frame.rig_pose)} whole parts there]" for step in steps]
    return scored(task.name, answer, steps, thing.id, true, WITHIN_MM, WITHIN_DEG, names_parts_right(rig, steps), notes)


def whole_parts(rig: RenderedRig, pose: RigPose) -> int:
    """How many parts a view shows whole."""
    return sum(part.fully_in_frame and part.visible_fraction >= WHOLE for part in rig.parts(pose))


def internals(name: str) -> InternalsPolicy:
    """``changing``: all four differ from view to view; ``fixed``: only the zoom changes them, and the rig says so."""
    from sim_backends.internals_policy import ChangingInternals, FixedByZoom

    return ChangingInternals(FixedByZoom()) if name == "changing" else FixedByZoom()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", choices=("architecture", "campus"))
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first trial")
    parser.add_argument("--mode", choices=("graded", "paper"), default="graded")
    parser.add_argument("--policies", nargs="+", help="default: information and random; in paper mode paper")
    parser.add_argument("--internals", choices=("changing", "fixed"), default="changing")
    parser.add_argument("--max-views", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep each trial here, and skip those kept already")
    given = parser.parse_args()
    given.policies = given.policies or (["paper"] if given.mode == "paper" else ["information", "random"])
    numbers = range(given.first, given.first + given.trials)
    one = Task(given.models, 0, "", given.internals, given.max_views, given.mode)
    tasks = [replace(one, number=number, policy=policy) for number in numbers for policy in given.policies]
    known = kept_trials(given.keep)
    trials = {task.name: known[task.name] for task in tasks if task.name in known}
    for trial in spread_out(recognise_once, [task for task in tasks if task.name not in known], given.jobs):
        print(f"{trial.line} [{trial.true_object}]", flush=True)
        if trial.kind != RIGHT:
            print("\n".join(f"    {line}" for line in trial.log), flush=True)
        keep(given.keep, trial)
        trials[trial.name] = trial
    print()
    views = {}
    for policy in given.policies:
        mine = [trials[task.name] for task in tasks if task.policy == policy]
        views[policy] = sum(trial.views for trial in mine) / len(mine)
        print(table(f"{given.models}, {given.internals} internals, {given.mode} mode, {policy}", mine))
    if {"information", "random"} <= views.keys():
        print(f"mean views, information / random: {views['information'] / views['random']:.3f}")


if __name__ == "__main__":
    main()
