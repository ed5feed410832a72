"""Command that finds out how the camera hangs: align."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.help import example


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        epilog=example("rig align scans/wall", "rig align scans/wall --bench bench.yaml --out bench-aligned.yaml")
    )(align)


def align(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="An image grid of any fixed, well-textured target.")],
    bench: Annotated[
        Path | None, typer.Option("--bench", metavar="BENCH", help="The bench file: axes, and how far to trust moves.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write a copy of BENCH with the mount found to FILE.")
    ] = None,
    zoom: Annotated[
        float | None,
        typer.Option("--zoom", min=0.0, max=1.0, help="Use the pictures of this zoom. [default: that with the most]"),
    ] = None,
    views: Annotated[int, typer.Option("--views", min=3, help="Use at most so many pictures.")] = 80,
    allow_partial: Annotated[
        bool, typer.Option("--allow-partial", help="Go on with a scan that lacks pictures.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Estimate how the camera hangs on the rig: lever arm, pan zero, roll and pitch, each with its standard deviation.

    The scan shows any fixed, textured target from many known x, y, z and pans at one zoom. Nothing is calibrated: the
    camera's internals are unknown, and of the target nothing is known. What the scan does not determine is named,
    with what to scan instead. Prints the line for the bench file; no file is changed. Exit code 1: nothing was found.
    """
    import json

    from rig import align as work
    from rig.bench import default_bench_for_grid, load_bench
    from rig.cli.progress import shown
    from rig.errors import InputError
    from rig.imagegrid import read_grid
    from rig.table import plain

    if out is not None and bench is None:
        raise InputError("there is no bench file to copy", where="--out", remedy="Name it with --bench")
    config = default_bench_for_grid(scan) if bench is None else load_bench(bench)
    grid = read_grid(scan, allow_partial=allow_partial)
    for message in grid.left_out:
        typer.echo(f"left out: {plain(message)}", err=True)
    found = work.align(
        grid, config, zoom=zoom, most_views=views, progress=lambda frames: shown(frames, "finding features")
    )
    typer.echo(json.dumps(work.as_json(found), ensure_ascii=False) if as_json else work.report(found))
    if not found.found_anything:
        raise typer.Exit(1)
    if out is not None and bench is not None:
        work.write_bench(bench, found.mount, out)
        typer.echo(f"written: {out}", err=True)
