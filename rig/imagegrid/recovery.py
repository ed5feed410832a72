"""Brings a grid whose writer was killed, or whose disk failed, back to a state from which it can go on growing.

What was acknowledged is never touched. Of the rest, only what can be proved is kept: a picture without a line is given
the line that its writer had noted if its digest is the noted one, and is removed if not; a picture that nobody noted
is somebody else's and stays as it is.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.errors import ImageGridError
from rig.imagegrid.disk import Disk, append_line, cut, discard, sync_folder, temporary_name, write_whole
from rig.imagegrid.entry import MANIFEST, FrameEntry, GridFrame, GridInfo
from rig.imagegrid.images import digest_of
from rig.imagegrid.lock import FolderLock
from rig.imagegrid.reader import read_line, read_manifest
from rig.schema import Problem, raise_problems

Progress = Callable[[Sequence[GridFrame]], Iterable[GridFrame]]


@dataclass(frozen=True)
class Recovered:
    """A grid that can be written to.

    Attributes:
        info: what holds for the whole grid.
        frames: what it lists; may be none.
        lines: of the manifest, blank ones included.
        mended: what had to be done, one message each.
    """

    info: GridInfo
    frames: tuple[GridFrame, ...]
    lines: int
    mended: tuple[str, ...]


def recover(
    lock: FolderLock, disk: Disk, *, retake_damaged: bool = False, progress: Progress = lambda frames: frames
) -> Recovered:
    """Make a grid fit to be added to.

    Args:
        lock: held on the grid's folder.
        disk: for the repairs.
        retake_damaged: check every digest, and strike out pictures that are missing or damaged, so that they can be
            taken again. Otherwise only presence and size are checked, and what is wrong is refused.
        progress: shows how far the check is while it hands the frames on.

    Raises:
        ImageGridError: the manifest is wrong in a way that no kill explains, or pictures are missing or damaged.
        OSError: the disk refused a repair.
    """
    folder, manifest = lock.folder, lock.folder / MANIFEST
    mended = _mend_tail(manifest, disk)
    _, frames, problems, _ = read_manifest(folder)
    raise_problems(problems, ImageGridError)
    mended += _settle_left_over(lock, frames, disk)
    lock.note(None)
    mended += _clear_temporaries(folder, frames, disk)
    if retake_damaged:
        mended += _strike_out(folder, list(progress(frames)), disk)
    else:
        raise_problems([p for frame in progress(frames) for p in _changed(folder, frame)], ImageGridError)
    info, frames, problems, _ = read_manifest(folder)
    raise_problems(problems, ImageGridError)
    return Recovered(info, tuple(frames), manifest.read_bytes().count(b"\n"), tuple(mended))


def _mend_tail(manifest: Path, disk: Disk) -> list[str]:
    """Cut a last line without its end, or end it where its picture proves it whole (by hand, it is easily left out)."""
    data = manifest.read_bytes()
    start = data.rfind(b"\n") + 1
    # Flushed in any case: a line that was written by someone who was then killed may not be on the disk yet.
    if start == len(data):
        cut(disk, manifest, len(data))
        return []
    number = data.count(b"\n") + 1
    entry = read_line(data[start:], str(manifest))
    if isinstance(entry, FrameEntry) and digest_of(manifest.parent / entry.file) == entry.sha256:
        append_line(disk, manifest, b"\n")
        return [f"{manifest}:{number}: the last line had no end; its picture is whole, so it was ended"]
    cut(disk, manifest, start)
    return [f"{manifest}:{number}: the last line was torn off; it was cut away"]


def _settle_left_over(lock: FolderLock, frames: Iterable[GridFrame], disk: Disk) -> list[str]:
    """Adopt or remove the picture that a writer had in hand when it was killed."""
    entry = _noted(lock.left)
    if entry is None or entry.file in {frame.file for frame in frames}:
        return []
    path = lock.folder / entry.file
    found = digest_of(path)
    if found is None:
        return []
    if found == entry.sha256:
        sync_folder(disk, path.parent)
        append_line(disk, lock.folder / MANIFEST, encoded_line(lock.left or {}))
        return [f"{path}: was whole but not listed yet; it was added to the manifest"]
    disk.unlink(path)
    return [f"{path}: was not written to its end; it was removed"]


def _noted(left: Mapping[str, Any] | None) -> FrameEntry | None:
    if not isinstance(left, Mapping):
        return None
    entry = read_line(json.dumps(left).encode(), "the note of a killed writer")
    return entry if isinstance(entry, FrameEntry) else None


def _clear_temporaries(folder: Path, frames: Iterable[GridFrame], disk: Disk) -> list[str]:
    places = {folder, folder / "images", *((folder / frame.file).parent for frame in frames)}
    pattern = temporary_name(Path("*")).name
    found = [path for place in sorted(places) if place.is_dir() for path in sorted(place.glob(pattern))]
    for path in found:
        discard(disk, path)
    return [f"{path}: was not written to its end; it was removed" for path in found]


def _strike_out(folder: Path, frames: Sequence[GridFrame], disk: Disk) -> list[str]:
    """Take the lines of missing and damaged pictures out of the manifest, then remove what is left of the pictures."""
    manifest = folder / MANIFEST
    bad = [frame for frame in frames if digest_of(folder / frame.file) != frame.sha256]
    if not bad:
        return []
    numbers = {frame.line for frame in bad}
    with manifest.open("rb") as stream:
        kept = [line for number, line in enumerate(stream, start=1) if number not in numbers]
    write_whole(disk, manifest, b"".join(kept))
    for frame in bad:
        if (folder / frame.file).exists():
            disk.unlink(folder / frame.file)
    return [f"{folder / frame.file}: is missing or damaged; its line was struck out" for frame in bad]


def _changed(folder: Path, frame: GridFrame) -> list[Problem]:
    path, remedy = folder / frame.file, "Copy it again from its source, or delete its line"
    where = f"{folder / MANIFEST}:{frame.line}"
    if not path.is_file():
        return [Problem(where, f"{frame.file} is missing", remedy)]
    size = path.stat().st_size
    if frame.size_bytes not in (None, size):
        return [Problem(where, f"{frame.file} has {size} bytes, the manifest says {frame.size_bytes}", remedy)]
    return []


def encoded_line(line: Mapping[str, Any]) -> bytes:
    """A line of the manifest as it is written, its end included."""
    return json.dumps(line, ensure_ascii=False, allow_nan=False).encode() + b"\n"
