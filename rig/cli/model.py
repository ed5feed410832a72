"""Commands on model bases: check and show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.help import example

Models = Annotated[
    str,
    typer.Argument(
        metavar="MODELS", help="A model base: a YAML file, or the name of one that ships.", show_default=False
    ),
]


def register(app: typer.Typer) -> None:
    """Add the group ``rig model``."""
    group = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    group.command(epilog=example("rig model check mybuilding.yaml", "rig model check mybuilding.yaml --links"))(check)
    group.command(epilog=example("rig model show architecture --out architecture.png"))(show)
    epilog = example("rig model check architecture")
    app.add_typer(group, name="model", help="Check and show model bases.", epilog=epilog)


def check(
    models: Models,
    with_links: Annotated[
        bool, typer.Option("--links", help="Tell how each part stands in the frames of its neighbours, too.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the counts as one JSON object.")] = False,
) -> None:
    """Check a model base against all rules, and count its objects and parts."""
    import json
    from dataclasses import asdict

    from recognition.links import links
    from recognition.modelbase_io import describe, load_model_base
    from rig.table import plain

    base = load_model_base(models)
    counts = describe(base)
    joined = {thing.id: links(thing) for thing in base.objects} if with_links else {}
    if as_json:
        tables = {name: [link.as_numbers() for link in found] for name, found in joined.items()}
        told = asdict(counts) | ({"links": tables} if with_links else {})
        typer.echo(json.dumps(told, ensure_ascii=False))
        return
    typer.echo(f"{plain(models)} is in order: {len(counts.by_object)} objects, {counts.parts:,} parts")
    for name, parts in counts.by_object.items():
        classes = ", ".join(f"{number} {kind}" for kind, number in counts.by_object_and_class[name].items())
        typer.echo(f"  {plain(name)}: {parts:,} parts ({plain(classes)})")
        for link in joined.get(name, ()):
            x, y, z = link.translation_mm
            where = f"{x:+.1f}, {y:+.1f}, {z:+.1f} mm, turned by {link.turn_deg:.1f}°"
            typer.echo(f"    {plain(link.from_id)} to {plain(link.to_id)}: {where}")


def show(
    models: Models,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="A .png, .svg or .pdf file. [default: NAME.png]")
    ] = None,
) -> None:
    """Draw a model base: the walls of each object unfolded, parts coloured by class."""
    from recognition.modelbase_io import load_model_base
    from rig.modelshow import draw

    base = load_model_base(models)
    typer.echo(draw(base, out or Path(f"{base.name}.png")))
