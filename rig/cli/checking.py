"""Command that looks at a live bench and moves nothing: doctor."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.showing import print_json

if TYPE_CHECKING:
    from rig.doctor import Finding

DONE, HARDWARE_FAULT = 0, 3
_COLOURS = {"pass": typer.colors.GREEN, "warn": typer.colors.YELLOW, "fail": typer.colors.RED, "not tested": None}


def register(app: typer.Typer) -> None:
    """Add the command."""
    epilog = example("rig doctor bench.yaml", "rig doctor bench.yaml --json", "rig doctor --discover --out bench.yaml")
    app.command(epilog=epilog)(doctor)


def doctor(
    bench: Annotated[
        Path | None, typer.Argument(metavar="BENCH", help="The bench file of a live bench.", show_default=False)
    ] = None,
    discover: Annotated[
        bool, typer.Option("--discover", help="Find what is connected instead; no bench file is needed.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="With --discover: write a first bench file.")
    ] = None,
    out_folder: Annotated[
        Path, typer.Option("--out-folder", metavar="DIR", help="Where pictures are to go; its disk is tried.")
    ] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Check a live bench: ports, firmware, limits, servos, camera, disk. Each line says what to do about it.

    Nothing moves, is homed or unlocked, and no torque is enabled. Opening a serial port restarts some boards by its
    DTR line, as every use does (`dtr` in the bench file). Exit code 3 if a check fails; warnings are allowed.
    """
    from rig.errors import InputError

    if discover == (bench is not None):
        raise InputError("name a bench file, or ask to --discover one", where="BENCH", remedy="Give one of the two")
    if out is not None and not discover:
        raise InputError("writes what --discover finds", where="--out", remedy="Add --discover, or leave it out")
    if bench is not None:
        _examine(bench, out_folder, as_json)
    else:
        _discover(out, as_json)


def _examine(bench: Path, out_folder: Path, as_json: bool) -> None:
    from rig.bench import load_bench
    from rig.doctor import examine, healthy, this_computer

    findings = examine(load_bench(bench), this_computer(), out_folder)
    found = list(findings) if as_json else _shown(findings)
    counts = {word: sum(finding.ok.value == word for finding in found) for word in _COLOURS}
    if as_json:
        lines = [_object(finding) for finding in found]
        print_json({"bench": str(bench), "healthy": healthy(found), "counts": counts, "findings": lines})
    else:
        typer.echo(", ".join(f"{count} {word}" for word, count in counts.items() if count))
    raise typer.Exit(DONE if healthy(found) else HARDWARE_FAULT)


def _shown(findings: Iterable[Finding]) -> list[Finding]:
    """Print each line as soon as it is known."""
    from rig.table import plain

    found = []
    for finding in findings:
        found.append(finding)
        word = finding.ok.value
        # What devices say may hold control characters.
        told = plain(f"{finding.told}. {finding.remedy}" if finding.remedy else finding.told)
        typer.echo(f"{_marked(word)}  {finding.subject:<10}  {finding.what:<15}  {told}")
    return found


def _marked(word: str) -> str:
    # Typer strips colours where there is no terminal, and does not know this agreement (https://no-color.org).
    plainly = bool(os.environ.get("NO_COLOR"))
    return f"{word:<10}" if plainly else typer.style(f"{word:<10}", fg=_COLOURS[word])


def _object(finding: Finding) -> dict[str, str]:
    return {
        "subject": finding.subject,
        "what": finding.what,
        "ok": finding.ok.value,
        "told": finding.told,
        "remedy": finding.remedy,
    }


def _discover(out: Path | None, as_json: bool) -> None:
    from rig.doctor import discover, first_bench, found_object, this_computer
    from rig.errors import HardwareError, InputError

    if out is not None and out.exists():
        raise InputError("there is a file of that name", where=str(out), remedy="Name another, or move it away")
    if not as_json:
        typer.echo("opening each serial port, which restarts some boards; nothing is moved", err=True)
    found = discover(this_computer())
    if as_json:
        print_json(found_object(found))
    else:
        _tell(found_object(found))
    if out is None:
        return
    if found.gantry is None:
        raise HardwareError(
            f"{out}: not written, since no gantry was found. Connect it and switch it on, then try again"
        )
    out.write_text(first_bench(found), encoding="utf-8")
    typer.echo(f"{out}: written; read its comments and measure what they ask for before anything moves", err=True)


def _tell(found: dict[str, Any]) -> None:
    from rig.table import plain

    for port in found["ports"]:
        who = ", ".join(port["answers"]) or f"nobody answers{port['trouble'] and ': '}{port['trouble']}"
        typer.echo(plain(f"port    {port['port']}: {who}"))
    for camera in found["cameras"]:
        typer.echo(plain(f"camera  {camera['path']}: {camera['identity']}"))
    if not found["ports"]:
        typer.echo("port    none")
    if not found["cameras"]:
        typer.echo("camera  none")
