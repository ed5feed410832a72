"""Commands that turn other people's captures into image grids."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.help import example


def register(app: typer.Typer) -> None:
    """Add the group ``rig import``."""
    group = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    epilog = example("rig import lightfield archive/chess grids/chess --step-mm 2.5")
    group.command(epilog=epilog)(lightfield)
    # Typer drops a group's only command in favour of the group itself; a callback keeps `rig import lightfield`.
    group.callback()(_nothing)
    about = "Turn other people's captures into image grids."
    app.add_typer(group, name="import", help=about, epilog=example("rig import lightfield archive/chess grids/chess"))


def _nothing() -> None:
    pass


def lightfield(
    src: Annotated[Path, typer.Argument(metavar="SRC", help="Folder with pictures called like r00_c16.jpg.")],
    dst: Annotated[Path, typer.Argument(metavar="DST", help="The image grid's folder, new or empty.")],
    step_mm: Annotated[
        float,
        typer.Option("--step-mm", help="Distance between neighbouring rows; 1 where it is not known."),
    ] = 1.0,
) -> None:
    """Turn a planar light field (rRR_cCC.jpg, one picture a camera position) into an image grid."""
    from rig.gridconvert import import_lightfield

    grid = import_lightfield(src, dst, step_mm)
    typer.echo(f"{grid.folder}: {len(grid.frames)} pictures")
