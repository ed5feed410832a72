"""How commands on a live bench tell its status, a pose or anything else: in words, or as one JSON object."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig.guard import Guard
    from rig.hal import RigPose

_printed: ContextVar[list[None] | None] = ContextVar("printed", default=None)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


def status_of(guard: Guard) -> dict[str, Any]:
    """Ask a rig for its status; the object that `show` takes, with who the devices are."""
    from rig.runtime import status_object

    names = {name: f"{who.kind} {who.version} at {who.where}" for name, who in guard.identities.items()}
    return status_object(guard.status()) | {"identities": names}


def tell(guard: Guard, as_json: bool) -> None:
    """Ask a rig for its status and show it."""
    show(status_of(guard), as_json)


def show(told: dict[str, Any], as_json: bool, bench: str = "") -> None:
    """Show a status as `rig.runtime.status_object` has it; of a named bench, people are told what to do next."""
    if as_json:
        print_json(told)
        return
    from rig.table import plain

    held = f" ({_holder_words(told)} holds the bench)" if "pid" in told else ""
    running = f": {told['running']}" if told["running"] else ""
    lines = [f"state   {told['state']}{running}{held}"]
    old = f" (stale: {told['age_s']:.1f} s old)" if told["stale"] else ""
    lines.append("pose    not known" if told["pose"] is None else f"pose    {_words(told['pose'])}{old}")
    for name, device in told["devices"].items():
        lines.append(f"{name:<7} {_device_words(device)}")
    lines += [f"! {trouble}" for trouble in told["troubles"]]
    if bench and (remedy := _remedy(told, bench)):
        lines.append(f"next    {remedy}")
    for line in lines:
        # What devices say may hold control characters.
        typer.echo(plain(line))


def _remedy(told: dict[str, Any], bench: str) -> str:
    from rig.guard import State, remedies

    state = State(told["state"])
    if state is State.STOPPED:
        return remedies.release(bench)
    if state is State.UNHOMED:
        axes = {"pan": "theta_deg", "zoom": "zoom"}
        lost = [axes[name] for name, device in told["devices"].items() if not device.get("referenced", True)]
        return remedies.find_place(lost, bench)
    return remedies.out_of(state, bench) if state is State.ALARM else ""


def _holder_words(told: dict[str, Any]) -> str:
    return f"process {told['pid']}" + (f", `{told['command']}`," if told.get("command") else "")


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


def pose_words(pose: RigPose) -> str:
    """A pose in one line, for people."""
    from dataclasses import asdict

    return _words(asdict(pose))


def _words(pose: dict[str, float]) -> str:
    from rig.hal import AXES

    x, y, z, theta, zoom = (pose[axis] for axis in AXES)
    return f"x {x:.3f}  y {y:.3f}  z {z:.3f} mm  theta {theta:.3f}°  zoom {zoom:.3f}"


def print_json(value: dict[str, Any]) -> None:
    """One JSON object on a line of its own, for scripts."""
    import json

    if (printed := _printed.get()) is not None:
        printed.append(None)
    print(json.dumps(value, ensure_ascii=False, allow_nan=False), file=sys.stdout, flush=True)


@contextmanager
def counting_objects() -> Iterator[Callable[[], int]]:
    """While inside, tells how many objects `print_json` has printed."""
    printed: list[None] = []
    token = _printed.set(printed)
    try:
        yield lambda: len(printed)
    finally:
        _printed.reset(token)
