"""Watches a recognition for a person or a script: live table, result, report, exit code."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path

from recognition.steps import Answer, Outcome
from rig.cli.interrupt import ends_gently
from rig.cli.showing import print_json
from rig.report import write_report
from rig.run import RunRecorder, Steps, watch
from rig.table import LiveTable, summary

DONE, NOT_RECOGNISED, INTERRUPTED = 0, 1, 130


def watch_run(steps: Steps, keeper: RunRecorder, as_json: bool, rig: object = None) -> tuple[int, Answer]:
    """Run to the end and return the exit code and the answer.

    With ``as_json`` stdout gets the result object and nothing else, in every case in which the run began; what is for
    people goes to stderr. Ctrl-C also holds the rig, if it is one that moves.
    """
    stream = sys.stderr if as_json else sys.stdout
    try:
        with ends_gently(rig) as stop, LiveTable(stream) as table:
            answer = watch(keeper.record(steps, stop), table.show)
        print(summary(answer), file=stream)
    finally:
        if keeper.answer is not None:
            _tell(keeper, as_json)
    if keeper.interrupted:
        return INTERRUPTED, answer
    return DONE if answer.outcome is Outcome.RECOGNISED else NOT_RECOGNISED, answer


def _tell(keeper: RunRecorder, as_json: bool) -> None:
    """Write the report, print the result: a reader who closes the pipe loses no report, a full disk no result."""
    try:
        if keeper.folder is not None:
            print(f"report: {write_report(keeper.folder)}", file=sys.stderr if as_json else sys.stdout)
    finally:
        if as_json:
            print_json(keeper.result())


def new_run_folder(out: Path | None, as_json: bool, label: str, now: datetime) -> Path | None:
    """Where to keep a run: ``--out``, or else a new folder under ``runs``; nowhere for a script that asks for none."""
    if out is not None:
        return out
    if as_json:
        return None
    safe = "".join(character if character.isalnum() or character in "-." else "_" for character in label)[:40]
    first = Path("runs") / f"{now:%Y%m%d-%H%M%S}_{safe}"
    folder, number = first, 1
    while folder.exists():
        number += 1
        folder = first.with_name(f"{first.name}-{number}")
    return folder
