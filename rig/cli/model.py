"""Commands on model bases: check, show and prior."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli.help import example

if TYPE_CHECKING:
    from recognition.settings import BenchBounds

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
    group.command(epilog=example("rig model prior campus --views 20000 --distance-mm 150,300 --out campus.prior.json"))(
        prior
    )
    epilog = example("rig model check architecture")
    app.add_typer(group, name="model", help="Check and show model bases, and sample priors over places.", epilog=epilog)


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


def prior(
    models: Models,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Where to write it. [default: NAME.prior.json]")
    ] = None,
    bench: Annotated[
        Path | None,
        typer.Option("--bench", metavar="BENCH", help="Draw distances and lenses as this bench bounds them."),
    ] = None,
    distance_mm: Annotated[
        str | None, typer.Option("--distance-mm", metavar="LEAST,MOST", help="Draw distances to walls between these.")
    ] = None,
    view_angle_deg: Annotated[
        str | None,
        typer.Option("--view-angle-deg", metavar="LEAST,MOST", help="Draw horizontal angles of view between these."),
    ] = None,
    views: Annotated[int, typer.Option("--views", metavar="N", min=1, help="How many views to draw.")] = 20_000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the random generator.")] = 0,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", min=1, help="Processes.")] = 1,
) -> None:
    """Sample how likely a first view shows each place, over views and lenses, for `rig recognise --prior`.

    Distances and angles of view are those of the bench, or as given; one or the other is needed.
    """
    from recognition.layout import compile_layout
    from recognition.modelbase_io import load_model_base
    from recognition.place_prior import sample_in_parallel, write_prior
    from rig.table import plain

    base = load_model_base(models)
    layout = compile_layout(base)
    seen = sample_in_parallel(base, _bounds(bench, distance_mm, view_angle_deg), views, seed, jobs)
    path = out or Path(f"{base.name}.prior.json")
    write_prior(path, layout, seen)
    never = int((seen == 0).sum())
    typer.echo(
        f"{plain(str(path))}: {views:,} views of {len(seen):,} places, of which {never:,} were never in the middle"
    )


def _bounds(bench: Path | None, distance_mm: str | None, view_angle_deg: str | None) -> BenchBounds:
    from recognition.settings import BenchBounds
    from rig.bench import load_bench
    from rig.errors import InputError

    if bench is None and (distance_mm is None or view_angle_deg is None):
        raise InputError(
            "nothing says how near and with which lenses views are taken",
            remedy="Name a bench with --bench, or give --distance-mm and --view-angle-deg",
        )
    known = BenchBounds() if bench is None else load_bench(bench).bounds()
    near, far = _range("--distance-mm", distance_mm, (known.distance_min_mm, known.distance_max_mm))
    narrow, wide = _range("--view-angle-deg", view_angle_deg, (known.view_angle_min_deg, known.view_angle_max_deg))
    return BenchBounds(near, far, narrow, wide)


def _range(option: str, text: str | None, otherwise: tuple[float, float]) -> tuple[float, float]:
    from rig.errors import InputError

    if text is None:
        return otherwise
    try:
        low, high = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(f"{text!r} is no range", where=option, remedy="Give two numbers: 150,300") from None
    return low, high
