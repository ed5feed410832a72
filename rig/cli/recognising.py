"""Commands that recognise: demo and recognise."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, replace
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.homing import HomeFirst, home_first

if TYPE_CHECKING:
    from recognition.modelbase import ModelBase
    from recognition.settings import RecogniserSettings
    from recognition.steps import Answer
    from rig.bench import BenchConfig
    from rig.guard import Guard
    from rig.hal import Rig, RigPose
    from sim_backends.image_grid_rig import ImageGridRig


class Mode(StrEnum):
    """What ``--mode`` takes."""

    GRADED = "graded"
    PAPER = "paper"


Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="The run folder, new or empty. [default: a new one under runs/]"),
]
Json = Annotated[
    bool,
    typer.Option("--json", help="Print the result as one JSON object; keep no run folder without --out."),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Of the random generator; the same seed gives the same run.")]


Policy = Annotated[
    str | None,
    typer.Option(
        "--policy", metavar="P", help="How the next view is chosen. [default: information; in paper mode paper]"
    ),
]


_LONG_S = 2.0


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(epilog=example("rig demo", "rig demo --seed 3 --out /tmp/demo"))(demo)
    epilog = example(
        "rig recognise bench.yaml --models mybuilding.yaml",
        "rig recognise --grid grids/lh --models architecture --start images/00017.png",
        "rig recognise bench.yaml --models campus --start 120,-40,300,15 --mode paper --json",
    )
    app.command(epilog=epilog)(recognise)


def demo(
    seed: Seed = 0,
    policy: Policy = None,
    grid: Annotated[
        Path | None, typer.Option("--grid", metavar="DIR", help="Keep the rendered image grid here, new or empty.")
    ] = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Recognise a rendered building from a first view that tells next to nothing.

    Renders one of the three architecture models, standing at an unknown place, into an image grid, by a camera whose
    internals change from view to view. Then shows how the hypotheses melt away. Takes less than a minute.
    """
    import tempfile
    from contextlib import nullcontext

    from rig.bench import open_rig
    from rig.cli.progress import shown
    from rig.demo import MODELS, prepare

    settings = _settings(policy=policy, seed=seed)
    stream = sys.stderr if as_json else sys.stdout
    with nullcontext(grid) if grid is not None else tempfile.TemporaryDirectory(prefix="rig-demo-") as folder:
        print(f"rendering one of the {MODELS} models into an image grid ...", file=stream, flush=True)
        what = prepare(Path(folder), seed, lambda poses: shown(poses, "rendering"))
        print(what.first_view, file=stream, flush=True)
        bench = what.bench()
        with open_rig(bench) as rig:
            rig.move_to(rig.nearest(what.start))
            settings = on_bench(settings, bench)
            code, answer = _run(rig, what.models, settings, out, as_json, bench=bench.name, label="demo")
            print(what.verdict(answer, rig.pose), file=stream)
    raise typer.Exit(code)


def recognise(
    bench: Annotated[
        Path | None, typer.Argument(metavar="BENCH", help="A bench file; may be left out where --grid is given.")
    ] = None,
    models: Annotated[
        str, typer.Option("--models", metavar="M", help="A model base: a YAML file, or the name of one that ships.")
    ] = ...,  # type: ignore[assignment]  # Typer's way to say that an option is required.
    grid: Annotated[
        Path | None, typer.Option("--grid", metavar="DIR", help="Put another image grid into a mock bench.")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--start",
            metavar="FRAME|POSE",
            help="First view: a picture of the grid by name, or x,y,z,theta[,zoom] in mm and degrees, snapped to the "
            "nearest that can be reached. [default: where the rig stands]",
        ),
    ] = None,
    mode: Annotated[
        Mode, typer.Option("--mode", help="Weigh everything, or follow the paper to the letter.")
    ] = Mode.GRADED,
    policy: Policy = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            "--threshold", metavar="P", help="Stop when one configuration is this probable. [default: 0.99; paper 1.0]"
        ),
    ] = None,
    max_views: Annotated[int, typer.Option("--max-views", metavar="N", help="Stop after so many views.")] = 12,
    pose_sd_mm: Annotated[
        float | None,
        typer.Option(
            "--pose-sd-mm",
            metavar="MM",
            help="Go on until the position is this sure; not in paper mode. [default: the bench's goal]",
        ),
    ] = None,
    pose_sd_deg: Annotated[
        float | None,
        typer.Option(
            "--pose-sd-deg",
            metavar="DEG",
            help="Go on until the pan is this sure; not in paper mode. [default: the bench's goal]",
        ),
    ] = None,
    seed: Seed = 0,
    detector: Annotated[
        str, typer.Option("--detector", metavar="NAME", help="What finds the parts in a picture.")
    ] = "segmentation",
    prior: Annotated[
        Path | None,
        typer.Option(
            "--prior", metavar="FILE", help="Prior over places from `rig model prior`. [default: by area of the walls]"
        ),
    ] = None,
    allow_partial: Annotated[
        bool, typer.Option("--allow-partial", help="Go on where the image grid lacks pictures.")
    ] = False,
    home: HomeFirst = False,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Tell which object stands before the rig, and where the camera is, from as few views as it takes.

    Exit code 0 if it was recognised, be the pose as sure as asked or not; 1 if the run ended undecided.
    """
    import numpy as np

    from recognition.modelbase_io import load_model_base
    from rig.bench import default_bench_for_grid, load_bench, open_rig
    from rig.errors import InputError
    from rig.table import plain

    settings = _settings(
        mode=mode,
        policy=policy,
        threshold=threshold,
        max_views=max_views,
        pose_sd_mm=pose_sd_mm,
        pose_sd_deg=pose_sd_deg,
        seed=seed,
        detector=chosen("--detector", detector, "rig.detectors"),
        prior=prior,
    )
    if bench is not None:
        config = load_bench(bench)
    elif grid is not None:
        config = default_bench_for_grid(grid)
    else:
        raise InputError(
            "there is nothing to look at", where="BENCH", remedy="Name a bench file, or a grid with --grid"
        )
    base = load_model_base(models)

    def notice(message: str) -> None:
        typer.echo(f"left out: {plain(message)}", err=True)

    rng = np.random.default_rng([seed, 5])
    with open_rig(config, grid, allow_partial=allow_partial, rng=rng, notice=notice) as rig:
        if home:
            home_first(rig)
        if start is not None:
            _move_to_start(start, rig)
        settings = on_bench(settings, config)
        code, _ = _run(rig, base, settings, out, as_json, bench=config.name, label=base.name)
    raise typer.Exit(code)


def _move_to_start(text: str, rig: ImageGridRig | Guard) -> None:
    from rig.errors import InputError, UnreachableError

    try:
        rig.move_to(start_pose(text, rig))
    except UnreachableError as error:
        raise InputError(str(error), where="--start") from error


def start_pose(text: str, rig: ImageGridRig | Guard) -> RigPose:
    """The pose that ``--start`` means: that of a picture of the grid, or the reachable one nearest to the pose given.

    Raises:
        InputError: no such picture, or not a pose.
        UnreachableError: a pose outside the limits.
    """
    from rig.errors import InputError
    from rig.hal import RigPose
    from sim_backends.image_grid_rig import ImageGridRig

    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        if not isinstance(rig, ImageGridRig):
            raise InputError(
                f"{text!r} is no pose", where="--start", remedy="A live bench has no pictures: give x,y,z,theta[,zoom]"
            ) from None
        return rig.grid.frame(text).pose
    if len(values) not in (4, 5):
        raise InputError(
            f"{text!r} has {len(values)} numbers", where="--start", remedy="Give x,y,z,theta or x,y,z,theta,zoom"
        )
    return rig.nearest(RigPose(*values[:4], *(values[4:] or [rig.pose.zoom])))


def chosen(option: str, name: str, group: str) -> str:
    """``name``, if an entry point of the group has it.

    Raises:
        InputError: there is none; the remedy names the nearest ones.
    """
    from importlib.metadata import entry_points

    from rig.errors import InputError
    from rig.schema import did_you_mean

    known = {point.name for point in entry_points(group=group)}
    if name not in known:
        raise InputError(f"there is no {name!r}", where=option, remedy=did_you_mean(name, known))
    return name


def _settings(
    *, mode: Mode = Mode.GRADED, policy: str | None, threshold: float | None = None, **others: Any
) -> RecogniserSettings:
    """The settings, with what each mode takes where the user chose nothing.

    Raises:
        InputError: there is no such policy, or paper mode was asked for a surer pose.
    """
    from recognition.settings import RecogniserSettings
    from rig.errors import InputError

    paper = mode is Mode.PAPER
    for option, key in (("--pose-sd-mm", "pose_sd_mm"), ("--pose-sd-deg", "pose_sd_deg")):
        if paper and others.get(key) is not None:
            raise InputError(
                "paper mode takes no view to make the pose surer", where=option, remedy="Leave it out, or take graded"
            )
    return RecogniserSettings(
        mode="paper" if paper else "graded",
        policy=chosen("--policy", policy or ("paper" if paper else "information"), "rig.policies"),
        threshold=threshold if threshold is not None else 1.0 if paper else 0.99,
        **others,
    )


def on_bench(settings: RecogniserSettings, bench: BenchConfig) -> RecogniserSettings:
    """The settings with all that the bench says; a goal that the user asked for goes before the bench's."""
    from recognition.settings import Effort

    return replace(
        settings,
        bounds=bench.bounds(),
        mount=bench.mount,
        rates=bench.rates,
        effort=Effort.for_clutter(bench.rates.clutter),
        pose_sd_mm=bench.goal.pose_sd_mm if settings.pose_sd_mm is None else settings.pose_sd_mm,
        pose_sd_deg=bench.goal.pose_sd_deg if settings.pose_sd_deg is None else settings.pose_sd_deg,
    )


def _run(
    rig: Rig,
    models: ModelBase,
    settings: RecogniserSettings,
    out: Path | None,
    as_json: bool,
    *,
    bench: str,
    label: str,
) -> tuple[int, Answer]:
    from importlib.metadata import version

    from recognition.recogniser import recognise as steps_of
    from rig.cli.watching import new_run_folder, watch_run
    from rig.run import RunRecorder, RunStart

    start = RunStart(
        models=models.name,
        bench=bench,
        settings=asdict(settings) | {"prior": None if settings.prior is None else str(settings.prior)},
        command=shlex.join(["rig", *sys.argv[1:]]),
        version=version("calibration-free-rig"),
    )
    folder = new_run_folder(out, as_json, label, datetime.now())
    compile_first()
    return watch_run(steps_of(rig, models, settings), RunRecorder(folder, start, models), as_json, rig)


def compile_first() -> None:
    """Have the inner loops compiled before the first view; says so where that takes long."""
    from threading import Timer

    from recognition.warming import warm_up

    notice = Timer(
        _LONG_S, print, ["compiling the inner loops, once after an installation; about 20 s"], {"file": sys.stderr}
    )
    notice.daemon = True
    notice.start()
    try:
        warm_up()
    finally:
        notice.cancel()
