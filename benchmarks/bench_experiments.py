"""Prints the paper's Experiments 1 to 5, rebuilt on rendered pictures, beside the paper's own numbers.

Run from the repository: ``python -m benchmarks.bench_experiments [--starts 5] [--policy information]``. The
rule that picks the starts is told in ``rig.evaluate.experiments``.
"""

from __future__ import annotations

import argparse

from calibration_free_tests.paper.experiments import EXPERIMENTS, Run, run
from recognition.modelbase import ModelBase
from recognition.modelbase_io import load_model_base
from rig.evaluate.experiments import starts
from rig.evaluate.plan_file import ExperimentEntry

_HEAD = (
    "exp  object  seed  left after each view          bits   views (paper)  hypotheses (paper)  answer   error mm  deg"
)


def line(experiment: ExperimentEntry, one: Run) -> str:
    left = " ".join(str(n) for n in one.left)
    paper = str(experiment.paper_hypotheses or "-")
    said = "right" if one.right else "WRONG" if one.answer.object_id else str(one.answer.outcome)
    text = (
        f"{experiment.number:3d}  {one.start.object:6s}  {one.start.seed:4d}  {left:28s} {one.entropy_bits:5.2f}  "
        f"{len(one.left):6d} ({experiment.paper_views})    {one.left[0]:9d} ({paper:>3s})   {said:9s} "
        f"{one.error_mm:7.2f} {one.error_deg:6.3f}"
    )
    if len(one.same_view) > 1:
        text += f"   apart at {len(one.same_view)} zooms: {one.spread[0]:.2f} mm, {one.spread[1]:.3f} deg"
    return text


def report(base: ModelBase, numbers: list[int], wanted: int, policy: str) -> bool:
    """Print all runs; False if one was wrong or took more views than the paper."""
    good = True
    print(_HEAD)
    for experiment in EXPERIMENTS:
        if numbers and experiment.number not in numbers:
            continue
        runs = []
        for start in starts(experiment, base, range(20 * wanted)):
            runs.append(run(experiment, base, start, policy=policy))
            print(line(experiment, runs[-1]), flush=True)
            if len(runs) == wanted:
                break
        within = sum(r.right and len(r.left) <= experiment.paper_views for r in runs)
        good &= bool(runs) and within == len(runs)
        views = experiment.paper_views
        print(f"     {experiment.title}: {within} of {len(runs)} right within the paper's {views} views\n")
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=5, help="runs of each experiment")
    parser.add_argument("--policy", default="information")
    parser.add_argument("--experiment", type=int, nargs="*", default=[], help="only these")
    args = parser.parse_args()
    raise SystemExit(0 if report(load_model_base("architecture"), args.experiment, args.starts, args.policy) else 1)


if __name__ == "__main__":
    main()
