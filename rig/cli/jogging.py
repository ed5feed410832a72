"""The command that lets a person move a live bench by hand, looking at the live picture."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.help import example

NEEDS = ("textual", "textual_image")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(epilog=example("rig jog bench.yaml", "rig jog bench.yaml --out grids/by-hand --preview"))(jog)


def jog(
    bench: Annotated[Path, typer.Argument(metavar="BENCH", help="The bench file of a live bench.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="The image grid for pictures; may exist. [default: a new one under grids/]"
        ),
    ] = None,
    preview: Annotated[
        bool, typer.Option("--preview", help="Show the live picture on a page for a browser on this computer, too.")
    ] = False,
    preview_port: Annotated[
        int | None,
        typer.Option("--preview-port", metavar="PORT", min=0, max=65535, help="The page's port. [default: a free one]"),
    ] = None,
) -> None:
    """Move a live bench by hand, step by step, and take pictures, in a full-screen terminal with the live picture.

    Space is STOP, Ctrl-C holds the motion, Q quits. All keys are shown.
    """
    _refuse_without_textual()
    _refuse_without_terminal()
    from rig.bench import load_bench, open_live
    from rig.jog.jogger import Jogger
    from rig.jog.keeping import HandGrid
    from rig.jog.leaving import leaves_in_order
    from rig.jog.looking import Looker
    from rig.jog.marks import Marks, marks_file

    config = load_bench(bench)
    marks = Marks(marks_file(config.key))
    folder = out or Path("grids") / f"{datetime.now():%Y%m%d-%H%M%S}_by-hand"
    # Importing it asks the terminal what it can show: before anything else reads keys. No answer is no news.
    logging.getLogger("textual_image").setLevel(logging.ERROR)
    from rig.jog.app import JogApp

    with ExitStack() as stack:
        guard = open_live(config)
        grid = stack.enter_context(HandGrid(folder, bench.name, fixed_by_zoom=guard.internals_fixed_by_zoom))
        if out is not None:
            # What is wrong with a grid that is there is told before anything can move.
            grid.open()
        stack.enter_context(guard)
        jogger = stack.enter_context(Jogger(guard, grid, marks))
        looker = stack.enter_context(Looker(guard.latest))
        url = ""
        if preview or preview_port is not None:
            from rig.jog.preview import Preview, told

            def status() -> dict[str, str | bool]:
                return told(guard.glance(), looker.look, guard.clock.now_s())

            url = stack.enter_context(Preview(guard.latest, status, port=preview_port or 0)).url
        with leaves_in_order(stack.close) as leave:
            screen = JogApp(jogger, looker, bench.name, url, leave)
            screen.run()
    if grid.count:
        typer.echo(f"{folder}: {grid.count} pictures")
    raise typer.Exit(screen.return_code or 0)


def _refuse_without_textual() -> None:
    from importlib.util import find_spec

    from rig.errors import InputError

    missing = [name.replace("_", "-") for name in NEEDS if find_spec(name) is None]
    if missing:
        raise InputError(
            f"`rig jog` needs {' and '.join(missing)}, not installed here",
            remedy="Install it: pip install 'calibration-free-rig[jog]'",
        )


def _refuse_without_terminal() -> None:
    import os
    import sys

    from rig.errors import InputError

    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError(
            "`rig jog` needs a terminal for its screen and keys",
            remedy="In scripts use `rig move --by`, `rig capture` and `rig status`",
        )
    columns, rows = os.get_terminal_size(sys.stdout.fileno())
    if not (columns and rows):
        raise InputError("the terminal does not tell its size", remedy="Tell it: stty columns 80 rows 24")
