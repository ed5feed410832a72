"""The command that stops a bench, whichever process holds it, and the one that releases it again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.showing import Json, print_json

HARDWARE_FAULT = 3


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(epilog=example("rig stop", "rig stop bench.yaml", "rig stop bench.yaml --release"))(stop)


def stop(
    bench: Annotated[
        Path | None, typer.Argument(metavar="BENCH", help="Left out: all benches that processes of yours hold.")
    ] = None,
    release: Annotated[
        bool, typer.Option("--release", help="Undo a STOP instead, once it is safe to move again.")
    ] = False,
    as_json: Json = False,
) -> None:
    """STOP a bench, whichever process holds it. It stays stopped until it is released with --release.

    Exit code 3 if it is not confirmed that everything is at rest: use the wired emergency stop then.
    """
    from rig.errors import InputError

    if release and bench is None:
        raise InputError("which bench is to be released?", where="BENCH", remedy="Name its bench file")
    if bench is None:
        reports = _stop_all()
    elif release:
        _release(bench, as_json)
        return
    else:
        reports = [_stop(bench)]
    for report in reports:
        if as_json:
            print_json(report)
        else:
            certain = "everything is at rest" if report["confirmed"] else "NOT CONFIRMED"
            typer.echo(f"{report['bench']}: STOP: {certain}")
            for line in filter(None, (report["trouble"], "" if report["position_kept"] else "it must be homed again")):
                typer.echo(f"  {line}")
    raise typer.Exit(0 if all(report["confirmed"] for report in reports) else HARDWARE_FAULT)


def _stop_all() -> list[dict[str, Any]]:
    import os

    from rig.errors import InputError
    from rig.runtime import runtime_folder, stop_held

    found = stop_held(runtime_folder(), f"`rig stop`, process {os.getpid()}")
    if not found:
        raise InputError("no process of yours holds a bench", where="BENCH", remedy="Name the bench file to stop it")
    return found


def _stop(bench: Path) -> dict[str, Any]:
    import os

    from rig.bench import attendance_of, load_bench, stop_directly
    from rig.runtime import stop_object

    config = load_bench(bench)
    by = f"`rig stop`, process {os.getpid()}"
    answer = attendance_of(config).ask("stop", by=by)
    return answer if answer is not None else {"bench": config.name, **stop_object(stop_directly(config, by))}


def _release(bench: Path, as_json: bool) -> None:
    from rig.bench import attendance_of, load_bench

    attendance = attendance_of(load_bench(bench))
    answer = attendance.ask("release")
    if answer is None:
        was = attendance.latch.note()
        attendance.latch.clear()
        answer = {"bench": str(bench), "released": was}
    if as_json:
        print_json(answer)
    else:
        typer.echo(f"{bench}: STOP is released")
