"""Command that starts a bench without hardware: emulate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli.help import example

if TYPE_CHECKING:
    from queue import SimpleQueue

    from rig.bench import BenchConfig
    from sim_backends.camera_pictures import Pictures


def register(app: typer.Typer) -> None:
    """Add the command."""
    epilog = example(
        "rig emulate examples/bench_emulated.yaml --bench-out bench.yaml",
        "rig emulate bench.yaml --object library --models campus",
        "rig emulate bench.yaml --grid grids/castle",
    )
    app.command(epilog=epilog)(emulate)


def emulate(
    bench: Annotated[Path, typer.Argument(metavar="BENCH", help="The bench file of a live bench.", show_default=False)],
    object_id: Annotated[
        str | None,
        typer.Option(
            "--object", metavar="NAME", help="What stands before the camera. [default: the model base's first]"
        ),
    ] = None,
    models: Annotated[
        str, typer.Option("--models", metavar="M", help="The model base that it is in: a YAML file, or one that ships.")
    ] = "architecture",
    grid: Annotated[
        Path | None,
        typer.Option("--grid", metavar="DIR", help="The camera sees an image grid's nearest pictures instead."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the object's looks and place, and of noise.")] = 0,
    bench_out: Annotated[
        Path | None,
        typer.Option("--bench-out", metavar="FILE", help="Write the bench file to use here. [default: print it]"),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="With --bench-out: overwrite a file that no `rig emulate` has written.")
    ] = False,
) -> None:
    """Start emulators of all devices of a live bench on ports of this computer, and run until Ctrl-C.

    Use the bench file that it writes as that of any live bench, from other terminals: it names the emulated ports. The
    servos and the controller speak byte for byte as real ones do; the camera sees what stands before it from where the
    emulated axes really are. Nothing on the bench's real ports is touched.
    """
    import sys
    from tempfile import TemporaryDirectory

    from rig.bench import load_bench
    from rig.emulation import EmulatedBench
    from rig.emulation.files import refuse_overwriting

    config = load_bench(bench)
    if bench_out is not None and not force:
        refuse_overwriting(bench_out)
    view = _view(config, object_id, models, grid, seed)
    with EmulatedBench(config, view, seed=seed) as running, TemporaryDirectory(prefix="rig-emulate-") as folder:
        path = running.file_for(bench_out or Path(folder) / "bench.yaml")
        if bench_out is None:
            print(path.read_text(encoding="utf-8"), end="", flush=True)
        asked = _asked_to_end()
        typer.echo(f"emulating {bench}: use {path}; Ctrl-C ends it", err=True)
        sys.stderr.flush()
        asked.get()


def _asked_to_end() -> SimpleQueue[int]:
    """Gets Ctrl-C and SIGTERM from now on, which is how this command ends well."""
    import signal
    from queue import SimpleQueue

    # An Event would not do: its lock may be held by who waits for it, in the midst of whom the handler runs.
    asked: SimpleQueue[int] = SimpleQueue()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _: asked.put(got))
    return asked


def _view(config: BenchConfig, object_id: str | None, models: str, grid: Path | None, seed: int) -> Pictures:
    from rig.emulation import grid_view, object_view, stand_in_front
    from rig.errors import InputError

    if grid is not None:
        if object_id is not None:
            raise InputError(
                "the camera sees either an object or a grid", where="--grid", remedy="Leave one of them out"
            )
        from rig.imagegrid import read_grid

        return grid_view(config, read_grid(grid))
    from recognition.modelbase_io import load_model_base

    base = load_model_base(models)
    return object_view(config, stand_in_front(config, base, object_id or base.objects[0].id, seed=seed), seed=seed)
