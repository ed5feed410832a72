"""What the benchmarks of whole recognitions share: spreading them over processes, keeping them, and the table."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from rig.evaluate.trial import RIGHT, UNDECIDED, WRONG, Trial
from rig.evaluate.workers import ONE_THREAD, one_thread

PHASES = ("detect", "update", "plan")

Task = TypeVar("Task")


def spread_out(work: Callable[[Task], Trial], tasks: Sequence[Task], jobs: int) -> Iterator[Trial]:
    """Do the tasks, in ``jobs`` processes of one thread each; in this process, with all its threads, if it is one."""
    if jobs <= 1:
        yield from map(work, tasks)
        return
    # Spawned processes read these before they import numpy; forked ones would come too late.
    os.environ.update(ONE_THREAD)
    with multiprocessing.get_context("spawn").Pool(jobs, one_thread) as pool:
        yield from pool.imap(work, tasks, chunksize=1)


def kept_trials(path: Path | None) -> dict[str, Trial]:
    """Trials that an earlier run kept, by name."""
    if path is None or not path.is_file():
        return {}
    lines = path.read_text().splitlines()
    return {trial.name: trial for trial in (Trial(**json.loads(line)) for line in lines if line.strip())}


def keep(path: Path | None, trial: Trial) -> None:
    """Add a trial to the file, so that a run that was cut off can go on."""
    if path is not None:
        with path.open("a") as file:
            file.write(json.dumps(asdict(trial)) + "\n")


def table(title: str, trials: Sequence[Trial]) -> str:
    """The figures of many trials, a row each with their spread."""
    import numpy as np

    if not trials:
        return f"{title}: no trials"
    counts = Counter(trial.kind for trial in trials)
    total = len(trials)
    shares = ", ".join(f"{kind} {counts[kind]} ({counts[kind] / total:.1%})" for kind in (RIGHT, WRONG, UNDECIDED))
    views = [trial.views for trial in trials]
    lines = [
        f"{title}: {total} runs: {shares}",
        f"  views               mean {np.mean(views):.2f}, {spread(views, '.0f')}",
        f"  left after view 1   {spread([t.first_left for t in trials], '.0f')}",
    ]
    good = [trial for trial in trials if trial.kind == RIGHT]
    if good:
        lines.append(f"  pose in tolerance   {sum(t.near for t in good)} of the {len(good)} right ones")
        lines.append(f"  pose error, mm      {spread([t.error_mm for t in good], '.1f')}  (right ones)")
        lines.append(f"  pose error, °       {spread([t.error_deg for t in good], '.3f')}")
        lines.append(f"  error / told sd     {spread([t.error_mm / t.sd_mm for t in good], '.2f')}  (mm, largest axis)")
    seconds = np.array([row for trial in trials for row in trial.seconds])
    for name, column in zip((*PHASES, "step"), (*seconds.T, seconds.sum(axis=1)), strict=True):
        lines.append(f"  {name + ', s':19s} {spread(column, '.3f')}")
    lines.append(f"  peak memory, MiB    {max(trial.rss_mib for trial in trials):.0f} (largest process)")
    return "\n".join(lines)


def spread(values: Iterable[float], form: str) -> str:
    """Median, 90th percentile and greatest."""
    import numpy as np

    values = np.array(list(values), dtype=float)
    parts = (("median", np.median(values)), ("p90", np.quantile(values, 0.9)), ("most", values.max()))
    return ", ".join(f"{name} {value:{form}}" for name, value in parts)
