"""The whole examination of a live bench: every check runs, and what rests on one that failed says so.

Nothing moves, is homed, unlocked, reset or let go of, and no torque is enabled. The rule that no byte reaches hardware
without passing the guard is about commands: what goes out here is what the drivers' own `connect` and `status` send to
find out who answers and how it stands. Opening a port may restart some boards by its DTR line; the bench file's ``dtr``
is obeyed as in every use. Connecting a camera locks its controls as the bench file says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from rig.bench import BenchConfig, Device, LiveBenchFile
from rig.doctor import bench_file, camera, computer, gantry, ports, servos
from rig.doctor.finding import Finding, Verdict, not_tested
from rig.doctor.firmware import CHECKS
from rig.doctor.surroundings import Surroundings
from rig.errors import InputError

SERVO_ROLES = ("pan", "zoom")


def examine(config: BenchConfig, world: Surroundings, out_folder: Path) -> Iterator[Finding]:
    """Check a live bench, line by line.

    Args:
        config: the bench.
        world: this computer.
        out_folder: where pictures are to be written.

    Raises:
        InputError: it is a mock bench.
    """
    file = config.file
    if not isinstance(file, LiveBenchFile):
        raise InputError(
            "this is a mock bench: there is no hardware to look at",
            where=config.name,
            remedy="Name a bench of `kind: live`, or run `rig doctor --discover` to get one",
        )
    return _examined(config, file, world, out_folder)


def _examined(config: BenchConfig, file: LiveBenchFile, world: Surroundings, out_folder: Path) -> Iterator[Finding]:
    yield from bench_file.check_bench_file(config, file)
    runtime, held = computer.check_runtime(config, world)
    yield from runtime
    yield computer.check_disk(out_folder, world)
    devices = config.devices
    if held:
        for role in devices:
            yield from not_tested(role, ("everything",), "runtime: in use")
        return
    paths = ports.resolved(devices, world)
    check_gantry = partial(gantry.check_gantry, file=file, world=world)
    of_gantry = list(_behind_port(devices["gantry"], paths, world, ("firmware", "state", *CHECKS), check_gantry))
    yield from of_gantry
    missing = any(finding.what == "firmware" and finding.ok is Verdict.FAIL for finding in of_gantry)
    for role in (role for role in SERVO_ROLES if role in devices):
        on_bus = sum(paths.get(other) == paths.get(role) for other in SERVO_ROLES if other in devices)
        check_axis = partial(
            servos.check_axis, missing=devices["gantry"] if missing else None, on_bus=on_bus, world=world
        )
        yield from _behind_port(devices[role], paths, world, servos.lines_of(devices[role]), check_axis)
    yield from camera.check_camera(devices["camera"], world)


def _behind_port(
    device: Device,
    paths: Mapping[str, str],
    world: Surroundings,
    lines: tuple[str, ...],
    check: Callable[[Device], list[Finding]],
) -> Iterator[Finding]:
    """A device's port, and then the device, where the port can be used; servos may share one, but not with others."""
    port = ports.port_of(device)
    strangers = SERVO_ROLES if device.role == "gantry" else ("gantry",)
    others = {path: role for role, path in paths.items() if role in strangers}
    found = [] if port is None else ports.check_port(device.role, port, others, world)
    yield from found
    bad = next((finding for finding in found if finding.ok is Verdict.FAIL), None)
    if bad is not None:
        yield from not_tested(device.role, lines, f"{bad.subject}: {bad.what}")
    else:
        yield from check(device)
