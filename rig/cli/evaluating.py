"""Command that runs many recognitions by a plan and scores them: evaluate."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example

if TYPE_CHECKING:
    from collections.abc import Callable

    from rig.evaluate.plan import Plan, Task
    from rig.evaluate.store import Store
    from rig.evaluate.work import Record

DONE, FAILED, INTERRUPTED = 0, 1, 130
_SAYING = "finishing the trials in hand; press Ctrl-C again to drop them"


def register(app: typer.Typer) -> None:
    """Add the command."""
    epilog = example(
        "rig evaluate field --trials 200",
        "rig evaluate policies --jobs 8 --out runs/policies",
        "rig evaluate myplan.yaml --scheduler tcp://cluster:8786 --json > rows.json",
    )
    app.command(epilog=epilog)(evaluate)


def evaluate(
    plan: Annotated[
        str, typer.Argument(metavar="PLAN", help="A plan: a YAML file, or the name of one that ships, as field.")
    ],
    trials: Annotated[
        int | None, typer.Option("--trials", min=1, metavar="N", help="So many trials, evenly over the plan's rows.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, metavar="N", help="Processes. [default: one for each core]")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Do the trials on the Dask cluster of this scheduler."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="The evaluation's folder; one of the same plan is gone on with. [default: a new one under runs/]",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Of the first trial of each row. [default: the plan's]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows of figures as one JSON object.")] = False,
) -> None:
    """Recognise many times by a plan, and tell how often right, how sure, from how many views and how fast.

    Plans that ship: field, harsh, rendered, open_set, paper, policies, one_axis. Ctrl-C ends after the trials in hand;
    the same command with the same --out goes on. Exit code 1 if any trial failed; what was answered wrong is a result,
    and no failure.
    """
    from rig.evaluate.workers import ONE_THREAD

    # Before numpy is imported, which reads it once: trials that are done in this process keep to one thread, too.
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    from rig.cli.watching import new_run_folder
    from rig.evaluate.plan import load_plan
    from rig.evaluate.store import Store

    wanted = load_plan(plan).of(trials=trials, seed=seed)
    folder = out or new_run_folder(None, False, f"evaluate-{Path(plan).stem}", datetime.now())
    assert folder is not None
    with Store(folder, wanted) as store:
        if store.mended is not None:
            typer.echo(f"mended: {store.mended}", err=True)
        ended = _work(wanted, store, jobs or _cores(), scheduler)
        result = _write(wanted, store)
    _tell(result, folder, as_json)
    if not ended:
        go_on = ["rig", "evaluate", plan, "--out", str(folder)]
        go_on += [] if trials is None else ["--trials", str(trials)]
        go_on += [] if seed is None else ["--seed", str(seed)]
        left = wanted.trials - result["done"] - result["errors"]
        typer.echo(f"{left} of {wanted.trials} trials are left; to go on: {shlex.join(go_on)}", err=True)
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(FAILED if result["errors"] else DONE)


def _work(plan: Plan, store: Store, jobs: int, scheduler: str | None) -> bool:
    """Do what is left of the plan; False if it was interrupted."""
    from rig.cli.interrupt import ends_gently
    from rig.cli.progress import shown
    from rig.evaluate.store import failed

    left = [task for task in plan.tasks if task.key not in store.records or failed(store.records[task.key])]
    if len(left) < plan.trials:
        print(f"{plan.trials - len(left)} of {plan.trials} trials are done already", file=sys.stderr)
    with ends_gently(saying=_SAYING) as stop:
        try:
            for record in shown(_records(left, jobs, scheduler, stop), f"evaluating {plan.name}", len(left)):
                store.add(record)
                if failed(record):
                    typer.echo(f"seed {record['seed']} of {record['row']}: {record['error']}", err=True)
        except KeyboardInterrupt:
            return False
        return not stop()


def _records(tasks: list[Task], jobs: int, scheduler: str | None, stop: Callable[[], bool]) -> Iterator[Record]:
    from rig.cli.recognising import compile_first
    from rig.evaluate import workers

    if scheduler is not None:
        return workers.on_cluster(tasks, scheduler, stop)
    # Here, so that the processes find everything compiled.
    compile_first()
    if jobs == 1 or len(tasks) == 1:
        return workers.here(tasks, stop)
    return workers.in_processes(tasks, min(jobs, max(1, len(tasks))), stop)


def _write(plan: Plan, store: Store) -> dict[str, Any]:
    from rig.evaluate.bound import bounds
    from rig.evaluate.figures import summary
    from rig.evaluate.page import render
    from rig.evaluate.store import REPORT, SUMMARY

    result = summary(plan, store.records, bounds(plan), str(store.folder))
    store.write(SUMMARY, json.dumps(result, ensure_ascii=False, allow_nan=False, indent=1) + "\n")
    store.write(REPORT, render(plan, store.records, result))
    return result


def _tell(result: dict[str, Any], folder: Path, as_json: bool) -> None:
    from rig.evaluate.store import REPORT

    stream = sys.stderr if as_json else sys.stdout
    for row in result["rows"]:
        print(_line(row), file=stream)
    print(f"report: {folder / REPORT}", file=stream)
    if as_json:
        print(json.dumps(result, ensure_ascii=False, allow_nan=False))


def _line(row: dict[str, Any]) -> str:
    """A row for people."""
    head = f"{row['base']}, {row['policy']}, {row['noise']}: "
    if not row["trials"]:
        return head + "no trials"
    shares = ", ".join(
        f"{kind} {row[kind]} ({row[kind] / row['trials']:.1%})" for kind in ("right", "wrong", "undecided")
    )
    ece = "" if row["ece"] is None else f"; calibration error {row['ece']:.2%}"
    bound = "" if row["bound_views"] is None else f" (at least {row['bound_views']:.2f})"
    return (
        f"{head}{row['trials']} trials: {shares}{ece}; views {row['views_mean']:.2f}{bound}, 90 % within "
        f"{row['views_p90']:.0f}; travel {row['travel_s_mean']:.1f} s; {row['step_ms_median']:.0f} ms a view"
    )


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
