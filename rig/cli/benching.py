"""Commands on a live bench by hand: home, move, status and capture."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.homing import HomeFirst
from rig.cli.showing import Json, pose_words, print_json, show, tell

if TYPE_CHECKING:
    from rig.guard import Guard
    from rig.hal import RigPose

INTERRUPTED = 130


class Servo(StrEnum):
    """What the bench's servos do."""

    PAN = "pan"
    ZOOM = "zoom"


AXIS_OF = {Servo.PAN: "theta_deg", Servo.ZOOM: "zoom"}

Bench = Annotated[Path, typer.Argument(metavar="BENCH", help="The bench file of a live bench.", show_default=False)]
X = Annotated[float | None, typer.Option("--x-mm", help="Rig frame. [default: stay]", show_default=False)]
Y = Annotated[float | None, typer.Option("--y-mm", help="Rig frame. [default: stay]", show_default=False)]
Z = Annotated[float | None, typer.Option("--z-mm", help="Rig frame. [default: stay]", show_default=False)]
Theta = Annotated[float | None, typer.Option("--theta-deg", help="Pan. [default: stay]", show_default=False)]
Zoom = Annotated[float | None, typer.Option("--zoom", help="0 to 1. [default: stay]", show_default=False)]
Reboot = Annotated[
    list[Servo] | None, typer.Option(help="First reboot this servo, which has a hardware error.", show_default=False)
]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(epilog=example("rig home bench.yaml", "rig home bench.yaml --reboot pan --theta-deg 0"))(home)
    app.command(epilog=example("rig move bench.yaml --x-mm 120 --theta-deg 15", "rig move bench.yaml --by --z-mm -5"))(
        move
    )
    app.command(epilog=example("rig status bench.yaml --watch", "rig status bench.yaml --json"))(status)
    app.command(epilog=example("rig capture bench.yaml --out grids/by-hand --home --x-mm 100"))(capture)


def home(
    bench: Bench,
    theta_deg: Theta = None,
    zoom: Zoom = None,
    reboot: Reboot = None,
    as_json: Json = False,
) -> None:
    """Home the gantry. --theta-deg and --zoom say where the pan and the zoom ring stand, if they do not know it.

    Exit code 1 if they still do not: no pose can be gone to then. A servo with a hardware error is rebooted with
    --reboot, once it is cool and the cause is removed; it then no longer knows where it stands.

    See that the way to the switches is free: homing passes no keep-out check.
    """
    with _connected(bench) as (guard, asked):
        for servo in reboot or ():
            guard.reboot(AXIS_OF[servo])
        # A controller that has just been switched on is locked, and nothing can be referenced in alarm.
        guard.home()
        for axis, value in (("theta_deg", theta_deg), ("zoom", zoom)):
            if value is not None:
                guard.reference(axis, value)
        if not as_json:
            tell(guard, as_json)
        # Raises where a move would: an axis that has lost its count is not homed, but told where it stands.
        _ = guard.pose
        if as_json:
            tell(guard, as_json)
        _end(asked)


def move(
    bench: Bench,
    x_mm: X = None,
    y_mm: Y = None,
    z_mm: Z = None,
    theta_deg: Theta = None,
    zoom: Zoom = None,
    by: Annotated[bool, typer.Option("--by", help="Move by these amounts instead of to these places.")] = False,
    home_first: HomeFirst = False,
    as_json: Json = False,
) -> None:
    """Move to a pose of the rig frame, or by a step. Axes that are not named stay where they are."""
    from rig.errors import InputError

    wish = {"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm, "theta_deg": theta_deg, "zoom": zoom}
    told = {axis: value for axis, value in wish.items() if value is not None}
    if not told:
        options = ", ".join(f"--{axis.replace('_', '-')}" for axis in wish)
        raise InputError("nothing is to be moved", remedy=f"Name one axis or more: {options}")
    with _connected(bench) as (guard, asked):
        if home_first:
            guard.home()
        with _wrong_input():
            if by:
                guard.jog(**{f"d{axis}": value for axis, value in told.items()})
            else:
                guard.move_to(_changed(guard.pose, told))
        tell(guard, as_json)
        _end(asked)


def status(
    bench: Bench,
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
    as_json: Json = False,
) -> None:
    """Show what the devices say, or what the process that holds the bench knows of them. Nothing moves.

    It shares the bench: a command that moves something gets it, and --watch goes on with what that command says.
    """
    from rig.bench import load_bench
    from rig.cli.interrupt import ends_gently
    from rig.cli.looking import look_once
    from rig.cli.looking import watch as watch_bench

    config = load_bench(bench)

    def shown(told: dict[str, Any]) -> None:
        show(told, as_json, shlex.quote(str(bench)))

    # Ctrl-C is how watching ends. As an exception it could fall where Python only prints it, and be lost; and what is
    # known of where the bench was left homed goes when a session is broken off.
    with ends_gently(silent=True) as ended:
        if watch:
            watch_bench(config, shown, ended)
        else:
            look_once(config, shown)


def capture(
    bench: Bench,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="The image grid's folder; it may exist.")],
    x_mm: X = None,
    y_mm: Y = None,
    z_mm: Z = None,
    theta_deg: Theta = None,
    zoom: Zoom = None,
    home_first: HomeFirst = False,
    as_json: Json = False,
) -> None:
    """Take a picture, at a pose or where the rig stands, and keep it in an image grid with its pose."""
    from dataclasses import asdict

    from rig.imagegrid.entry import MANIFEST
    from rig.jog.keeping import HandGrid

    wish = {"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm, "theta_deg": theta_deg, "zoom": zoom}
    told = {axis: value for axis, value in wish.items() if value is not None}
    with (
        _connected(bench) as (guard, asked),
        HandGrid(out, bench.name, fixed_by_zoom=guard.internals_fixed_by_zoom) as grid,
    ):
        # What is wrong with a grid that is there is told before anything moves; a new one begins with a picture.
        if (out / MANIFEST).exists():
            grid.open()
        if home_first:
            guard.home()
        if told:
            with _wrong_input():
                guard.move_to(_changed(guard.pose, told))
        frame = guard.capture()
        kept = grid.add(frame)
        if as_json:
            print_json({"file": str(out / kept.file), "pose": asdict(frame.rig_pose), "sha256": kept.sha256})
        else:
            typer.echo(f"{out / kept.file}: {pose_words(frame.rig_pose)}")
        _end(asked)


@contextmanager
def _connected(bench: Path) -> Iterator[tuple[Guard, Callable[[], bool]]]:
    """A connected guard that Ctrl-C holds, and twice Ctrl-C stops; and whether that was asked."""
    from rig.bench import load_bench, open_live
    from rig.cli.interrupt import ends_gently
    from rig.guard import HeldError

    guard = open_live(load_bench(bench))
    try:
        with (
            guard,
            ends_gently(guard, saying="holding motion (a picture in hand is finished); Ctrl-C again: STOP") as asked,
        ):
            yield guard, asked
    except HeldError as error:
        homing = f". Home it next (`rig home {guard.bench}`, or --home): its place is not kept"
        as_found = guard.rules.homing == "as_found"
        raise HeldError(f"interrupted: motion was held{'' if as_found else homing}") from error


@contextmanager
def _wrong_input() -> Iterator[None]:
    """A pose that was asked for and cannot be reached is wrong input."""
    from rig.errors import InputError, UnreachableError

    try:
        yield
    except UnreachableError as error:
        raise InputError(str(error)) from error


def _end(asked: Callable[[], bool]) -> None:
    if asked():
        raise typer.Exit(INTERRUPTED)


def _changed(pose: RigPose, told: dict[str, float]) -> RigPose:
    from dataclasses import replace

    return replace(pose, **told)
