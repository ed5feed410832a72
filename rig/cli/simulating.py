"""Command that makes image grids: simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.help import example


def register(app: typer.Typer) -> None:
    """Add the command."""
    epilog = example(
        "rig simulate architecture LH grids/lh",
        "rig simulate mybuilding.yaml annexe grids/annexe --clutter --changing-internals --seed 4",
    )
    app.command(epilog=epilog)(simulate)


def simulate(
    models: Annotated[
        str, typer.Argument(metavar="MODELS", help="A model base: a YAML file, or the name of one that ships.")
    ],
    object_id: Annotated[str, typer.Argument(metavar="OBJECT", help="Which of its objects to render.")],
    out: Annotated[Path, typer.Argument(metavar="DIR", help="The image grid's folder, new or empty.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the placement, the looks, noise and clutter.")] = 0,
    views: Annotated[int | None, typer.Option("--views", min=1, help="Take so many views, drawn at random.")] = None,
    distance_mm: Annotated[
        list[float] | None,
        typer.Option("--distance-mm", min=1.0, help="Stand-off; may be repeated. [default: 8 x a part's height]"),
    ] = None,
    zoom: Annotated[
        list[float] | None, typer.Option("--zoom", min=0.0, max=1.0, help="Zoom setting; may be repeated. [default: 0]")
    ] = None,
    clutter: Annotated[bool, typer.Option("--clutter", help="Put trees, pipes and jutting walls in front.")] = False,
    changing_internals: Annotated[
        bool, typer.Option("--changing-internals", help="Change focal length, aspect and centre from view to view.")
    ] = False,
    quality: Annotated[
        int | None, typer.Option("--jpeg", min=1, max=100, help="Write JPEG of this quality instead of PNG.")
    ] = None,
) -> None:
    """Render an object of a model base from all around into an image grid, with the truth beside it.

    truth.jsonl tells where the camera was and what it saw; the recogniser never reads it.
    """
    import numpy as np

    from recognition.modelbase_io import load_model_base
    from rig.cli.progress import shown
    from sim_backends.internals_policy import ChangingInternals, FixedByZoom
    from sim_backends.simulate import draw_scene, rendered_rig
    from sim_backends.simulate import simulate as render

    scene = draw_scene(load_model_base(models), object_id, seed, cluttered=clutter)
    internals = ChangingInternals(FixedByZoom()) if changing_internals else None
    rig = rendered_rig(scene, distances_mm=distance_mm, zooms=zoom or [0.0], internals=internals, seed=seed)
    poses = list(rig.reachable())
    if views is not None and views < len(poses):
        chosen = sorted(np.random.default_rng([seed, 7]).permutation(len(poses))[:views])
        poses = [poses[int(k)] for k in chosen]
    render(rig, shown(poses, "rendering"), out, quality=quality)
    typer.echo(f"{out}: {len(poses)} views of {object_id}")
