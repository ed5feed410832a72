"""Prints how recognition ends from every start of the castle photographs: right, wrong or undecided, views and errors.

Run: python -m benchmarks.bench_castle [--starts 1] [--others] [--jobs 2] [--keep FILE] [--failures DIR]
Each start is recognised as ``rig recognise examples/castle.yaml --grid CASTLE --models CASTLE/modelbase.yaml --start F
--json`` does it; nothing is cached. Right means: object ``castle``, and the pose within 300 mm and 2 degrees of the
truth at the last view. ``--starts N`` takes every n-th start; ``--others`` begins from the grid's other photographs
that show at least one whole window: no run was tuned from there, though the detector was tuned on all photographs.
With ``--keep`` a run that was cut off goes on.
"""

from __future__ import annotations

import argparse
import json
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.trials import keep, kept_trials, spread_out, table
from rig.evaluate.trial import RIGHT, Trial, run, scored

if TYPE_CHECKING:
    from recognition.modelbase import ModelBase

BENCH = Path(__file__).parents[1] / "examples" / "castle.yaml"
OBJECT, WITHIN_MM, WITHIN_DEG = "castle", 300.0, 2.0
WIDE_BELOW = 0.5
"""Zoom settings below this are called wide."""


@cache
def truth(castle: Path) -> dict[str, dict[str, Any]]:
    """``truth.jsonl``, by file; for scoring only."""
    return {line["file"]: line for line in map(json.loads, (castle / "truth.jsonl").read_text().splitlines())}


@cache
def models(castle: Path) -> ModelBase:
    from recognition.modelbase_io import load_model_base

    return load_model_base(castle / "modelbase.yaml")


def starts(castle: Path, others: bool) -> list[str]:
    """Files to begin from."""
    listed = (castle / "starts.txt").read_text().split()
    if not others:
        return listed
    return [file for file, line in truth(castle).items() if file not in listed and any(map(countable, line["parts"]))]


def countable(part: dict[str, Any]) -> bool:
    """Whether a part of the truth is whole, clear and confirmed."""
    return bool(part["edges_confirmed"] == 4 and part["fully_in_frame"] and part["state"] != "near_vehicle")


def recognise_from(start: str, castle: Path, failures: Path | None, options: dict[str, Any]) -> Trial:
    """One recognition, as the command line does it."""
    import numpy as np

    from recognition.geometry import CameraPose
    from recognition.recogniser import recognise
    from recognition.settings import RecogniserSettings
    from rig.bench import load_bench, open_rig
    from rig.cli.recognising import on_bench, start_pose

    bench = load_bench(BENCH)
    settings = on_bench(RecogniserSettings(**options), bench)
    with open_rig(bench, castle, rng=np.random.default_rng([settings.seed, 5])) as rig:
        rig.move_to(start_pose(start, rig))
        answer, steps = run(recognise(rig, models(castle), settings))
    last = truth(castle)[steps[-1].frame.name]["camera_in_object"]
    trial = scored(start, answer, steps, OBJECT, CameraPose(**last), WITHIN_MM, WITHIN_DEG)
    if failures is not None and trial.kind != RIGHT:
        from benchmarks.failure_strips import write_failure

        true_px = [[np.array(p["corners_px"]) for p in truth(castle)[s.frame.name]["parts"]] for s in steps]
        write_failure(failures, trial, steps, true_px)
    return trial


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=1, metavar="N", help="take every n-th start")
    parser.add_argument("--first", type=int, default=0, metavar="K", help="skip the first k")
    parser.add_argument("--others", action="store_true", help="begin from the photographs that are not in starts.txt")
    parser.add_argument("--policy", default="information")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--max-views", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep each trial here, and skip those kept already")
    parser.add_argument("--failures", type=Path, metavar="DIR", help="draw the failures here, without photographs")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    given = parser.parse_args()
    castle = (given.data / "castle").resolve()
    options = {"policy": given.policy, "seed": given.seed, "max_views": given.max_views}
    files = starts(castle, given.others)[given.first :: given.starts]
    known = kept_trials(given.keep)
    trials = [known[file] for file in files if file in known]
    work = partial(recognise_from, castle=castle, failures=given.failures, options=options)
    for trial in spread_out(work, [file for file in files if file not in known], given.jobs):
        print(trial.line, flush=True)
        if trial.kind != RIGHT:
            print("\n".join(f"    {line}" for line in trial.log), flush=True)
        keep(given.keep, trial)
        trials.append(trial)
    print()
    wide = {file: line["zoom"] < WIDE_BELOW for file, line in truth(castle).items()}
    print(table("all starts", trials))
    print(table("wide starts", [trial for trial in trials if wide[trial.name]]))
    print(table("tele starts", [trial for trial in trials if not wide[trial.name]]))


if __name__ == "__main__":
    main()
