"""The command that stops a bench, whichever process holds it, and the one that releases it again."""

from __future__ import annotations

import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.showing import Json, print_json

if TYPE_CHECKING:
    from rig.bench import BenchConfig
    from rig.runtime import Attendance

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
            _tell(report)
    raise typer.Exit(0 if all(report["confirmed"] for report in reports) else HARDWARE_FAULT)


def _tell(report: dict[str, Any]) -> None:
    certain = "everything is at rest" if report["confirmed"] else "NOT CONFIRMED: use the wired emergency stop"
    bench = shlex.quote(report["bench"])
    typer.echo(f"{report['bench']}: STOP: {certain}")
    homing = "" if report["position_kept"] else f"it must be homed again: rig home {bench}"
    release = f"nothing moves before it is released: rig stop {bench} --release"
    for line in filter(None, (report["trouble"], homing, release)):
        typer.echo(f"  {line}")


def _stop_all() -> list[dict[str, Any]]:
    import os

    from rig.errors import InputError
    from rig.runtime import runtime_folder, stop_held

    found = stop_held(runtime_folder(), f"`rig stop`, process {os.getpid()}")
    if not found:
        raise InputError(
            "no process of yours holds a bench; those that are just starting will not move",
            where="BENCH",
            remedy="Name the bench file to stop it",
        )
    return found


def _stop(bench: Path) -> dict[str, Any]:
    """STOP a bench at whatever moment of another command's life.

    Such a command listens before it looks for the latch: who is not found listening once that is set will find it.
    """
    import os

    from rig.bench import attendance_of, load_bench
    from rig.devices import StopReport
    from rig.errors import RigError
    from rig.runtime import stop_object

    config = load_bench(bench)
    attendance, by = attendance_of(config), f"`rig stop`, process {os.getpid()}"
    try:
        answer = attendance.stop(by)
        if answer is None:
            attendance.latch.set(by)
            answer = _asked_or_directly(config, attendance, by)
        return answer
    except RigError as error:
        # It does not answer, and must find the latch where it ever goes on.
        trouble = "; ".join(filter(None, (str(error), attendance.latch.set(by))))
        return {"bench": config.name, **stop_object(StopReport(None, False, False, trouble))}


def _asked_or_directly(config: BenchConfig, attendance: Attendance, by: str) -> dict[str, Any]:
    """Ask who holds the bench, or else hold it and tell the devices, so that nobody opens them meanwhile."""
    import time

    from rig.bench import stop_directly
    from rig.errors import HardwareError
    from rig.runtime import PASSING_S, BenchHeldError, stop_object

    until_s = time.monotonic() + PASSING_S
    while (answer := attendance.stop(by)) is None:
        with ExitStack() as held:
            try:
                held.enter_context(attendance.hold())
            except HardwareError as error:
                # Held by one who is just beginning or ending: it will soon listen, or be gone.
                if isinstance(error, BenchHeldError) and time.monotonic() < until_s:
                    continue
            return {"bench": config.name, **stop_object(stop_directly(config, by))}
    return answer


def _release(bench: Path, as_json: bool) -> None:
    from rig.bench import attendance_of, load_bench
    from rig.errors import RigError

    attendance = attendance_of(load_bench(bench))
    was = attendance.latch.note()
    try:
        answer = attendance.ask("release")
    except RigError:
        if was:
            raise
        # Of a bench that is not stopped there is nothing to release, whatever its holder is doing.
        answer = {}
    else:
        if answer is None:
            attendance.latch.clear()
            answer = {}
    if as_json:
        print_json({"bench": str(bench), "released": was, **answer})
    elif was or answer:
        typer.echo(f"{bench}: STOP is released" + (f" ({was})" if was else ""))
    else:
        typer.echo(f"{bench}: no STOP was latched")
