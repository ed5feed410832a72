"""Commands on runs that were kept: replay and report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.help import example

RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="The run folder.", show_default=False)]
AllowPartial = Annotated[
    bool, typer.Option("--allow-partial", help="Go on where the record was cut short, with the views before that.")
]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(epilog=example("rig replay runs/20260102-101500_castle"))(replay)
    app.command(epilog=example("rig report runs/20260102-101500_castle --out castle.html"))(report)


def replay(
    run: RunFolder,
    allow_partial: AllowPartial = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result object instead of the table.")] = False,
) -> None:
    """Show the table of a run again, from its events alone."""
    import json
    import sys

    from recognition.steps import Step
    from rig import run as runs
    from rig.table import LiveTable, summary

    steps = runs.replay(run, allow_partial)
    if as_json:
        seen: list[Step] = []
        answer = runs.watch(steps, seen.append)
        print(json.dumps(runs.result_object(seen, answer), ensure_ascii=False, allow_nan=False))
        return
    with LiveTable(sys.stdout) as table:
        answer = runs.watch(steps, table.show)
    print(summary(answer))


def report(
    run: RunFolder,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Where to write it; report.html in the run folder.")
    ] = None,
    allow_partial: AllowPartial = False,
) -> None:
    """Write the report of a run again: one self-contained HTML file."""
    from rig.report import write_report

    typer.echo(write_report(run, out, allow_partial))
