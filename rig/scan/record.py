"""What a scan's folder remembers of it, so that it goes on only with the same bench and the same plan."""

from __future__ import annotations

import hashlib
import json
import os
import re
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from rig.bench import BenchConfig
from rig.errors import InputError, RigError
from rig.imagegrid import GridInfo, GridWriter, hold_folder
from rig.imagegrid.disk import Disk, write_whole
from rig.imagegrid.entry import MANIFEST
from rig.imagegrid.lock import LOCK
from rig.imagegrid.recovery import Progress
from rig.imagegrid.writer import cannot_write, yaml_of
from rig.scan.plan import ScanPlan
from rig.schema import BENCH_MAX_BYTES, load_model

RECORD = "scan.yaml"
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class ScanRecord(BaseModel):
    """``scan.yaml``: by what the grid in the folder is being made."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")] = 1
    bench: str
    bench_sha256: Digest
    bench_told: Annotated[dict[str, Any], Field(description="To name what differs; the digest decides.")] = {}
    plan: str
    plan_sha256: Digest
    poses: Annotated[int, Field(ge=1)]
    started_at: Annotated[str, Field(description="For people; nothing is decided by it.")]

    @staticmethod
    def of(bench: BenchConfig, grid: Path | None, plan: ScanPlan, now: datetime) -> ScanRecord:
        """Of a scan that begins now; ``grid`` is another image grid than the bench's own."""
        return ScanRecord(
            bench=bench.name,
            bench_sha256=bench_digest(bench, grid),
            bench_told=bench_told(bench),
            plan=plan.name,
            plan_sha256=plan.sha256,
            poses=len(plan.poses),
            started_at=now.isoformat(timespec="seconds"),
        )


def bench_told(bench: BenchConfig) -> dict[str, Any]:
    """What a bench file says of the bench: all but by which ports it is reached today."""
    told: dict[str, Any] = bench.file.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude={"grid"})
    for device in told.get("devices", {}).values():
        device.pop("port", None)
        if "source" in device:
            # A loopback camera's port is a new one each time that its server is started.
            device["source"] = _LOOPBACK.sub(r"\1", device["source"])
    return told


_LOOPBACK = re.compile(r"^(https?://(?:127\.0\.0\.1|localhost|\[::1\])):\d+")


def bench_digest(bench: BenchConfig, grid: Path | None = None) -> str:
    """SHA-256 of what a bench file says (not of how it is written), and of the manifest of the grid that it serves."""
    digest = hashlib.sha256(json.dumps(bench_told(bench), sort_keys=True).encode())
    served = grid or bench.grid
    if served is not None and (served / MANIFEST).is_file():
        digest.update((served / MANIFEST).read_bytes())
    return digest.hexdigest()


def open_scan_folder(
    folder: Path,
    record: ScanRecord,
    info: GridInfo,
    *,
    resume: bool,
    disk: Disk = os,
    progress: Progress = lambda frames: frames,
) -> GridWriter:
    """The grid that a scan writes to; its ``frames`` are those that need not be taken again.

    Args:
        folder: made if need be.
        record: of this scan.
        info: for a new grid.
        resume: go on with a scan that was cut short; where none was begun yet, begin. Otherwise the folder must be new
            or empty.
        disk: the calls that change the disk.
        progress: shows how far the check of the pictures that are there already has come.

    Raises:
        InputError: the folder holds something else, another bench's scan or another plan's, or another process
            writes there.
        RigError: it cannot be written.
    """
    lock = hold_folder(folder, disk)
    try:
        if resume and (folder / RECORD).exists():
            refuse_other_scan(folder, record)
        else:
            _refuse_full(folder, resume)
            write_whole(disk, folder / RECORD, yaml_of(record).encode())
    except OSError as failure:
        lock.release()
        raise cannot_write(folder, failure) from failure
    except RigError:
        lock.release()
        raise
    return GridWriter(folder, info, grow=True, retake_damaged=True, lock=lock, disk=disk, progress=progress)


def refuse_other_scan(folder: Path, record: ScanRecord) -> None:
    """Look whether a scan can go on in a folder, before anything moves.

    Raises:
        InputError: there is no such folder, or it holds another bench's or plan's scan; names the keys that differ.
    """
    if not folder.is_dir():
        raise InputError("there is no such folder", where=str(folder), remedy="Name the folder of the scan to resume")
    path = folder / RECORD
    if not path.exists():
        return
    found = load_model(path, ScanRecord, BENCH_MAX_BYTES)
    for what, theirs, ours, named in (
        ("bench", found.bench_sha256, record.bench_sha256, found.bench),
        ("plan", found.plan_sha256, record.plan_sha256, found.plan),
    ):
        if theirs != ours:
            keys = _differing(found.bench_told, record.bench_told) if what == "bench" and found.bench_told else []
            of = f"; what differs is {', '.join(keys)}" if keys else ""
            raise InputError(
                f"the scan in this folder was begun with another {what} ({named}, SHA-256 {theirs[:12]}...; "
                f"this one {ours[:12]}...){of}",
                where=str(path),
                remedy=f"Resume with the {what} that it was begun with, or name another folder",
            )


def _differing(theirs: Any, ours: Any, key: str = "") -> list[str]:
    """Keys, with dots, under which two mappings say something else."""
    if not (isinstance(theirs, dict) and isinstance(ours, dict)):
        return [] if theirs == ours else [key]
    names = [*theirs, *(name for name in ours if name not in theirs)]
    return [
        found
        for name in names
        for found in _differing(theirs.get(name), ours.get(name), f"{key}.{name}" if key else str(name))
    ]


def _refuse_full(folder: Path, resume: bool) -> None:
    """What someone who was killed at the very beginning left is nothing: a lock, a record under its temporary name."""
    if all(f.name == LOCK or f.name.endswith(".part") for f in folder.iterdir()):
        return
    if resume:
        raise InputError("there is no scan in this folder", where=str(folder), remedy="Name the folder of the scan")
    begun = (folder / RECORD).exists()
    raise InputError(
        "holds a scan already" if begun else "the folder is not empty",
        where=str(folder),
        remedy="Go on with --resume, or name a new folder" if begun else "Name a new folder",
    )
