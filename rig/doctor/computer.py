"""Looks at what the bench needs of this computer: a disk to write to, the runtime folder, and no latched STOP."""

from __future__ import annotations

from pathlib import Path

from rig.bench import BenchConfig, attendance_of
from rig.doctor.finding import Finding, failed, not_tested, passed, raised, warned
from rig.doctor.surroundings import DiskLook, Surroundings
from rig.errors import InputError, RigError

_LEAST_BYTES, _FEW_BYTES = 0.5e9, 5e9
_SLOWEST_BYTES_PER_S = 10e6
_RUNTIME_LINES = ("STOP", "in use")


def check_disk(folder: Path, world: Surroundings) -> Finding:
    """It can be written, has room, and is not too slow for pictures that are flushed one by one."""
    try:
        look = world.disk(folder)
    except OSError as failure:
        return failed(
            "disk",
            "output folder",
            f"{folder} cannot be written ({failure.strerror or failure})",
            "Name a folder of your own with --out-folder",
        )
    return disk_finding(folder, look)


def disk_finding(folder: Path, look: DiskLook) -> Finding:
    """The verdict on a disk."""
    free, speed = f"{look.free_bytes / 1e9:.1f} GB free", f"{look.bytes_per_s / 1e6:.0f} MB/s"
    if look.free_bytes < _FEW_BYTES:
        full = failed if look.free_bytes < _LEAST_BYTES else warned
        remedy = "Make room, or write to another disk (--out-folder tries one)"
        return full("disk", "output folder", f"{folder}: {free}", remedy)
    if look.bytes_per_s < _SLOWEST_BYTES_PER_S:
        return warned(
            "disk",
            "output folder",
            f"{folder}: pictures are flushed at {speed}, so that scans wait for the disk",
            "Write to a local disk instead of a network or memory-card one (--out-folder tries one)",
        )
    return passed("disk", "output folder", f"{folder}: {free}, {speed} with every write flushed")


def check_runtime(config: BenchConfig, world: Surroundings) -> tuple[list[Finding], bool]:
    """The lines, and whether another process holds the bench: its devices are then not ours to look at."""
    try:
        folder = world.runtime()
    except InputError as error:
        return [raised("runtime", "folder", error), *not_tested("runtime", _RUNTIME_LINES, "runtime: folder")], False
    attendance = attendance_of(config, folder)
    found = [passed("runtime", "folder", str(folder))]
    note = attendance.latch.note()
    if note:
        remedy = f"See that it is safe to move, then run `rig stop {config.name} --release`"
        found.append(failed("runtime", "STOP", f"latched: {note}", remedy))
    else:
        found.append(passed("runtime", "STOP", "not latched"))
    try:
        answer = attendance.ask("status")
    except RigError as error:
        return [*found, raised("runtime", "in use", error)], True
    if answer is not None:
        told = f"process {answer['pid']} holds the bench ({answer['state']})"
        remedy = "Wait until it is done or end it, then ask again; `rig status` shows what it does"
        return [*found, failed("runtime", "in use", told, remedy)], True
    return [*found, passed("runtime", "in use", "by no process")], False
