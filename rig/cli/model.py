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
    group.command(epilog=example("rig model check mybuilding.yaml"))(check)
    group.command(epilog=example("rig model show architecture --out architecture.png"))(show)
    epilog = example("rig model check architecture")
    app.add_typer(group, name="model", help="Check and show model bases.", epilog=epilog)


def check(
    models: Models,
    as_json: Annotated[bool, typer.Option("--json", help="Print the counts as one JSON object.")] = False,
) -> None:
    """Check a model base against all rules, and count its objects and parts."""
    import json
    from dataclasses import asdict

    from recognition.modelbase_io import describe, load_model_base
    from rig.table import plain

    counts = describe(load_model_base(models))
    if as_json:
        typer.echo(json.dumps(asdict(counts), ensure_ascii=False))
        return
    typer.echo(f"{plain(models)} is in order: {len(counts.by_object)} objects, {counts.parts:,} parts")
    for name, parts in counts.by_object.items():
        classes = ", ".join(f"{number} {kind}" for kind, number in counts.by_object_and_class[name].items())
        typer.echo(f"  {plain(name)}: {parts:,} parts ({plain(classes)})")


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
