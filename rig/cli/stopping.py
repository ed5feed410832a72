"""The command that stops a bench, whichever process holds it, and the one that releases it again."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.showing import Json, print_json

if TYPE_CHECKING:
    from rig.runtime import Attendance

HARDWARE_FAULT = 3
ENDING_S = 3.0
"""How long a command that was stopped may take to close its devices."""


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

    Who listens for a STOP does so before it looks for the latch. So whoever is not found the second time finds it.
    """
    import os

    from rig.bench import attendance_of, load_bench, stop_directly
    from rig.devices import StopReport
    from rig.errors import RigError
    from rig.runtime import stop_object

    config = load_bench(bench)
    attendance, by = attendance_of(config), f"`rig stop`, process {os.getpid()}"

    try:
        answer = attendance.ask("stop", by=by)
        if answer is None:
            attendance.latch.set(by)
            answer = attendance.ask("stop", by=by)
        if answer is None or _was_closing(answer, attendance):
            answer = {"bench": config.name, **stop_object(stop_directly(config, by))}
            if not answer["confirmed"]:
                # Whoever has opened the devices before us finds the latch, and can tell that they are at rest.
                answer = attendance.ask("stop", by=by) or answer
    except RigError as error:
        # It does not answer, and must find the latch where it ever goes on.
        trouble = "; ".join(filter(None, (str(error), attendance.latch.set(by))))
        return {"bench": config.name, **stop_object(StopReport(None, False, False, trouble))}
    return answer


def _was_closing(answer: dict[str, Any], attendance: Attendance) -> bool:
    """The command that was stopped moved nothing any more, and could not tell how devices are that it had closed."""
    return not answer["confirmed"] and answer["running"] == "closing" and _is_let_go(attendance)


def _is_let_go(attendance: Attendance) -> bool:
    """The process that held the bench ends soon."""
    import time

    until_s = time.monotonic() + ENDING_S
    while attendance.holder() is not None:
        if time.monotonic() > until_s:
            return False
        time.sleep(0.05)
    return True


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
