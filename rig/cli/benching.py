"""Commands on a live bench by hand: home, move, status, stop and capture."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli.help import example
from rig.cli.homing import HomeFirst

if TYPE_CHECKING:
    from rig.bench import BenchConfig
    from rig.guard import Guard
    from rig.hal import RigPose

DONE, HARDWARE_FAULT, INTERRUPTED = 0, 3, 130
WATCH_S = 0.5

Bench = Annotated[Path, typer.Argument(metavar="BENCH", help="The bench file of a live bench.", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
X = Annotated[float | None, typer.Option("--x-mm", help="Rig frame. [default: stay]", show_default=False)]
Y = Annotated[float | None, typer.Option("--y-mm", help="Rig frame. [default: stay]", show_default=False)]
Z = Annotated[float | None, typer.Option("--z-mm", help="Rig frame. [default: stay]", show_default=False)]
Theta = Annotated[float | None, typer.Option("--theta-deg", help="Pan. [default: stay]", show_default=False)]
Zoom = Annotated[float | None, typer.Option("--zoom", help="0 to 1. [default: stay]", show_default=False)]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(epilog=example("rig home bench.yaml", "rig home bench.yaml --theta-deg 0"))(home)
    app.command(epilog=example("rig move bench.yaml --x-mm 120 --theta-deg 15", "rig move bench.yaml --by --z-mm -5"))(
        move
    )
    app.command(epilog=example("rig status bench.yaml --watch", "rig status bench.yaml --json"))(status)
    app.command(epilog=example("rig stop", "rig stop bench.yaml", "rig stop bench.yaml --release"))(stop)
    app.command(epilog=example("rig capture bench.yaml --out grids/by-hand --home --x-mm 100"))(capture)


def home(bench: Bench, theta_deg: Theta = None, zoom: Zoom = None, as_json: Json = False) -> None:
    """Home the gantry. --theta-deg and --zoom say where the pan and the zoom ring stand, if they do not know it.

    See that the way to the switches is free: homing passes no keep-out check.
    """
    with _connected(bench) as (guard, asked):
        # A controller that has just been switched on is locked, and nothing can be referenced in alarm.
        guard.home()
        for axis, value in (("theta_deg", theta_deg), ("zoom", zoom)):
            if value is not None:
                guard.reference(axis, value)
        _tell(guard, as_json)
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
    wish = {"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm, "theta_deg": theta_deg, "zoom": zoom}
    told = {axis: value for axis, value in wish.items() if value is not None}
    with _connected(bench) as (guard, asked):
        if home_first:
            guard.home()
        with _wrong_input():
            if by:
                guard.jog(**{f"d{axis}": value for axis, value in told.items()})
            else:
                guard.move_to(_changed(guard.pose, told))
        _tell(guard, as_json)
        _end(asked)


def status(
    bench: Bench,
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
    as_json: Json = False,
) -> None:
    """Show what the devices say; also of a bench that another process holds. Nothing moves."""
    from rig.bench import attendance_of, load_bench
    from rig.cli.interrupt import ends_gently

    config = load_bench(bench)
    attendance = attendance_of(config)
    # Ctrl-C is how watching ends. As an exception it could fall where Python only prints it, and be lost.
    with ends_gently(silent=True) if watch else nullcontext(lambda: True) as ended:
        if (told := attendance.ask("status")) is not None:
            while told is not None:
                _show(told, as_json)
                told = None if _waited(ended) else attendance.ask("status")
            return
        with _open(config) as guard:
            _tell(guard, as_json)
            while not _waited(ended):
                _tell(guard, as_json)


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
            _print_json(report)
        else:
            certain = "everything is at rest" if report["confirmed"] else "NOT CONFIRMED"
            typer.echo(f"{report['bench']}: STOP: {certain}")
            for line in filter(None, (report["trouble"], "" if report["position_kept"] else "it must be homed again")):
                typer.echo(f"  {line}")
    raise typer.Exit(DONE if all(report["confirmed"] for report in reports) else HARDWARE_FAULT)


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
    from rig.jog.keeping import HandGrid

    wish = {"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm, "theta_deg": theta_deg, "zoom": zoom}
    told = {axis: value for axis, value in wish.items() if value is not None}
    with (
        _connected(bench) as (guard, asked),
        HandGrid(out, bench.name, fixed_by_zoom=guard.internals_fixed_by_zoom) as grid,
    ):
        # What is wrong with a grid that is there is told before anything moves.
        grid.open()
        if home_first:
            guard.home()
        if told:
            with _wrong_input():
                guard.move_to(_changed(guard.pose, told))
        frame = guard.capture()
        kept = grid.add(frame)
        if as_json:
            _print_json({"file": str(out / kept.file), "pose": _pose(frame.rig_pose), "sha256": kept.sha256})
        else:
            typer.echo(f"{out / kept.file}: {_pose_words(frame.rig_pose)}")
        _end(asked)


@contextmanager
def _connected(bench: Path) -> Iterator[tuple[Guard, Callable[[], bool]]]:
    """A connected guard that Ctrl-C holds, and twice Ctrl-C stops; and whether that was asked."""
    from rig.bench import load_bench
    from rig.cli.interrupt import ends_gently

    with _open(load_bench(bench)) as guard, ends_gently(guard) as asked:
        yield guard, asked


def _open(config: BenchConfig) -> Guard:
    from rig.bench import open_live

    return open_live(config)


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


def _waited(ended: Callable[[], bool]) -> bool:
    """Wait until the next look; says if there is to be none."""
    import time

    until_s = time.monotonic() + WATCH_S
    while not ended() and time.monotonic() < until_s:
        time.sleep(0.05)
    return ended()


def _stop_all() -> list[dict[str, Any]]:
    import os

    from rig.errors import InputError
    from rig.runtime import ask, held_benches, runtime_folder

    answers = [ask(path, "stop", by=f"`rig stop`, process {os.getpid()}") for path in held_benches(runtime_folder())]
    found = [answer for answer in answers if answer is not None]
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
        _print_json(answer)
    else:
        typer.echo(f"{bench}: STOP is released")


def _tell(guard: Guard, as_json: bool) -> None:
    from rig.runtime import status_object

    names = {name: f"{who.kind} {who.version} at {who.where}" for name, who in guard.identities.items()}
    _show(status_object(guard.status()) | {"identities": names}, as_json)


def _show(told: dict[str, Any], as_json: bool) -> None:
    if as_json:
        _print_json(told)
        return
    from rig.table import plain

    held = f" (process {told['pid']} holds it)" if "pid" in told else ""
    running = f": {told['running']}" if told["running"] else ""
    lines = [f"state   {told['state']}{running}{held}"]
    where = "not known" if told["pose"] is None else _words(told["pose"])
    lines.append(f"pose    {where}" + (f" (stale: {told['age_s']:.1f} s old)" if told["stale"] else ""))
    for name, device in told["devices"].items():
        lines.append(f"{name:<7} {_device_words(device)}")
    lines += [f"! {trouble}" for trouble in told["troubles"]]
    for line in lines:
        # What devices say may hold control characters.
        typer.echo(plain(line))


def _device_words(device: dict[str, Any]) -> str:
    words = [device["motion"]]
    if "homed" in device:
        words.append("homed" if device["homed"] else "not homed")
        words += [f"ALARM:{device['alarm']}"] if device["alarm"] is not None else []
    else:
        words.append("referenced" if device["referenced"] else "not referenced")
        words.append("torque on" if device["torque"] else "torque off")
    units = (("temperature_c", "{:.0f} °C"), ("voltage_v", "{:.1f} V"), ("load", "load {:.0%}"))
    words += [form.format(device[key]) for key, form in units if device.get(key) is not None]
    return ", ".join(words)


def _pose(pose: RigPose) -> dict[str, float]:
    from dataclasses import asdict

    return asdict(pose)


def _pose_words(pose: RigPose) -> str:
    return _words(_pose(pose))


def _words(pose: dict[str, float]) -> str:
    x, y, z, theta, zoom = (pose[axis] for axis in ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom"))
    return f"x {x:.3f}  y {y:.3f}  z {z:.3f} mm  theta {theta:.3f}°  zoom {zoom:.3f}"


def _print_json(value: dict[str, Any]) -> None:
    import json

    print(json.dumps(value, ensure_ascii=False, allow_nan=False), file=sys.stdout, flush=True)
