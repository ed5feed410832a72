"""The command that lets a person move a live bench by hand, looking at the live picture."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example

if TYPE_CHECKING:
    from rig.jog.jogger import Jogger
    from rig.jog.looking import Looker

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
    from rig.jog.looking import Looker
    from rig.jog.marks import Marks, marks_file

    config = load_bench(bench)
    marks = Marks(marks_file(config.key))
    folder = out or Path("grids") / f"{datetime.now():%Y%m%d-%H%M%S}_by-hand"
    # Asks the terminal what it can show, which must be over before anything reads keys from it.
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
            from rig.jog.preview import Preview

            page = stack.enter_context(Preview(guard.latest, lambda: _told(jogger, looker), port=preview_port or 0))
            url = page.url
        JogApp(jogger, looker, bench.name, url).run()
    if grid.count:
        typer.echo(f"{folder}: {grid.count} pictures")


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
    import sys

    from rig.errors import InputError

    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError(
            "`rig jog` needs a terminal for its screen and keys",
            remedy="In scripts use `rig move --by`, `rig capture` and `rig status`",
        )


def _told(jogger: Jogger, looker: Looker) -> dict[str, Any]:
    """What the preview page shows beside the picture."""
    from rig.jog.places import shown

    status, look = jogger.glance(), looker.look
    old_s = 0.0 if look is None else jogger.clock.now_s() - look.exposed_at_s
    measures = "no picture has come"
    if look is not None:
        measures = (
            f"sharpness {look.sharpness:.1f} %   light {100 * look.exposure.mean:.0f} % ({look.exposure.verdict})"
        )
    return {
        "state": status.state.value,
        "pose": "where it stands is not known" if status.pose is None else shown(status.pose),
        "measures": measures,
        "trouble": "; ".join(status.troubles),
        "old": old_s > 2.0 or look is None,
    }
