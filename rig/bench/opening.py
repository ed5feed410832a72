"""Makes rigs of benches: a mock rig on an image grid, or a guarded live rig."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.combined import CombinedRig
from drivers.rig_status import NAMES
from drivers.stopping_all import in_threads
from rig.bench.config import BenchConfig
from rig.bench.drivers import Maker, make_devices
from rig.bench.live import LiveBenchFile
from rig.bench.mock import BenchFile, open_mock
from rig.clock import SystemClock
from rig.devices import Clock, LiveAxis, StopReport
from rig.errors import HardwareError, InputError
from rig.guard import Guard
from rig.runtime import Attendance, runtime_folder

if TYPE_CHECKING:
    import numpy as np

    from sim_backends.image_grid_rig import ImageGridRig


def open_rig(
    config: BenchConfig,
    grid: Path | None = None,
    *,
    allow_partial: bool = False,
    rng: np.random.Generator | None = None,
    notice: Callable[[str], None] | None = None,
) -> ImageGridRig | Guard:
    """Make a rig of a bench. A live one connects when it is entered (``with``), and not before.

    Args:
        config: the bench.
        grid: another image grid than a mock bench's own.
        allow_partial: go on where the grid lacks pictures.
        rng: for the noise of the poses read back; ``None``: one that always starts the same.
        notice: is told, one call each, what the grid lacks.

    Raises:
        InputError: there is no grid, it is faulty (`ImageGridError`), or none of its pictures is within the limits; or
            a grid was given for a live bench.
    """
    if isinstance(config.file, BenchFile):
        folder = grid or config.grid
        if folder is None:
            raise InputError("the bench names no image grid", where=config.name, remedy="Give one with --grid DIR")
        bounds = config.bounds()
        # Distances are known to a factor only: the geometric mean is their middle.
        distance_mm = (bounds.distance_min_mm * bounds.distance_max_mm) ** 0.5
        return open_mock(config.file, folder, distance_mm, allow_partial=allow_partial, rng=rng, notice=notice)
    if grid is not None:
        raise InputError(
            "a live bench takes its own pictures", where=config.name, remedy="Leave --grid out, or name a mock bench"
        )
    return open_live(config)


def open_live(
    config: BenchConfig,
    *,
    clock: Clock | None = None,
    make: Maker | None = None,
    runtime: Path | None = None,
    make_room: Callable[[], object] | None = None,
    **others: Any,
) -> Guard:
    """Make the guarded rig of a live bench; nothing is opened yet.

    Args:
        config: the bench.
        clock: for everything; ``None``: real time.
        make: constructs one device, e.g. on an emulated port; ``None``: the drivers' own constructors.
        runtime: where processes of this user meet; ``None``: `rig.runtime.runtime_folder`.
        make_room: for who only looks: called when another process wants the bench, which then waits for its end.
        others: passed on to `drivers.combined.CombinedRig`.

    Raises:
        InputError: it is a mock bench.
    """
    file, clock = _live(config), clock or SystemClock()
    gantry, axes, camera = make_devices(config.devices, clock, make)
    by_axis = {axis: axes[role] for axis, role in NAMES.items() if role in axes}
    rig = CombinedRig(gantry, by_axis, camera, file.axes.placement, clock, **others)
    attendance = attendance_of(config, runtime, make_room=make_room)
    return Guard(
        rig,
        file.rules,
        clock,
        memory=attendance.homing,
        latch=attendance.latch,
        company=(attendance.listen,),
        bench=shlex.quote(config.name),
    )


def attendance_of(
    config: BenchConfig, runtime: Path | None = None, *, make_room: Callable[[], object] | None = None
) -> Attendance:
    """Where processes that use a live bench meet, in another folder than `rig.runtime.runtime_folder` if so told.

    Raises:
        InputError: it is a mock bench, or the runtime folder cannot be used.
    """
    _live(config)
    folder = runtime or runtime_folder()
    return Attendance(folder, config.key, config.name, also=config.other_keys, make_room=make_room)


def stop_directly(config: BenchConfig, by: str) -> StopReport:
    """STOP a live bench that no process holds, and latch it. Devices that cannot be reached are told in the report."""
    file, clock = _live(config), SystemClock()
    gantry, axes, camera = make_devices(config.devices, clock)
    by_axis = {axis: axes[role] for axis, role in NAMES.items() if role in axes}
    # A gantry's driver opens its port for a STOP; a servo must be known before it can be told anything, which may take
    # long. So that is part of its own STOP, and nobody else waits for it.
    reach = {NAMES[axis]: partial(_connect_and_stop, device) for axis, device in by_axis.items()}
    rig = CombinedRig(
        gantry, by_axis, camera, file.axes.placement, clock, stops=lambda stops: in_threads({**stops, **reach})
    )
    report = Guard(rig, file.rules, clock, latch=attendance_of(config).latch).stop(by)
    with suppress(HardwareError):
        gantry.close()
    return report


def _connect_and_stop(axis: LiveAxis) -> StopReport:
    unreached = ""
    try:
        axis.connect()
    except HardwareError as error:
        unreached = str(error)
    report = axis.stop()
    with suppress(HardwareError):
        axis.close()
    if report.confirmed or not unreached:
        return report
    return replace(report, trouble="; ".join(filter(None, (report.trouble, unreached))))


def _live(config: BenchConfig) -> LiveBenchFile:
    if not isinstance(config.file, LiveBenchFile):
        raise InputError(
            "this is a mock bench: nothing moves there", where=config.name, remedy="Name a bench of `kind: live`"
        )
    return config.file
