"""Writes files so that they are whole or not there, also after a power loss; every call to the disk can be replaced."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Protocol

_ONLY_WRITE = os.O_WRONLY | os.O_CREAT | getattr(os, "O_BINARY", 0)


class Disk(Protocol):
    """The calls that change a disk, as the module ``os`` has them; passed in, so that a test can let each one fail."""

    def open(self, path: Path, flags: int, mode: int = ..., /) -> int:
        """Open a file or a folder."""
        ...

    def write(self, handle: int, data: bytes, /) -> int:
        """Write, perhaps less than given; returns how much."""
        ...

    def fsync(self, handle: int, /) -> None:
        """Put what was written on the disk itself."""
        ...

    def ftruncate(self, handle: int, length: int, /) -> None:
        """Set a file's length."""
        ...

    def replace(self, source: Path, target: Path, /) -> None:
        """Rename, over what is there."""
        ...

    def mkdir(self, path: Path, /) -> None:
        """Make a folder."""
        ...

    def unlink(self, path: Path, /) -> None:
        """Remove a file."""
        ...


class TakenBackError(OSError):
    """A line could not be added, and the file is as it was before. Any other OSError leaves that open."""


def make_folder(disk: Disk, folder: Path, root: Path | None = None) -> None:
    """Make a folder, and make it last: what holds it is flushed, up to ``root`` or to what was there before."""
    missing = [f for f in (folder, *folder.parents) if not f.is_dir()]
    # Two levels also where nothing was missing: whoever made them (``grids/new``) may have been killed before it could
    # flush.
    top = root or (missing or [folder])[-1].parent.parent
    for new in reversed(missing):
        disk.mkdir(new)
    while folder != top:
        folder = folder.parent
        sync_folder(disk, folder)


def write_whole(disk: Disk, path: Path, data: bytes) -> None:
    """Write a file that is either whole or not there, also after a power loss."""
    temporary = temporary_name(path)
    try:
        handle = disk.open(temporary, _ONLY_WRITE | os.O_TRUNC, 0o666)
        try:
            write_all(disk, handle, data)
            disk.fsync(handle)
        finally:
            os.close(handle)
        disk.replace(temporary, path)
    except OSError:
        discard(disk, temporary)
        raise
    sync_folder(disk, path.parent)


def temporary_name(path: Path) -> Path:
    """What a file is called while it is being written."""
    return path.with_name(f".{path.name}.part")


def append_line(disk: Disk, path: Path, line: bytes) -> None:
    """Add a line that is either whole or not there; half of one would spoil the next.

    Raises:
        TakenBackError: it could not be written; the file is as it was.
        OSError: nor could what was written be taken back: the file may end in half a line.
    """
    new = not path.exists()
    handle = disk.open(path, _ONLY_WRITE | os.O_APPEND, 0o666)
    try:
        before = os.fstat(handle).st_size
        try:
            write_all(disk, handle, line)
            disk.fsync(handle)
        except OSError as failure:
            # Flushed as well: a line that comes back after a power loss would be one that was never acknowledged.
            disk.ftruncate(handle, before)
            disk.fsync(handle)
            raise TakenBackError(failure.errno, failure.strerror) from failure
    finally:
        os.close(handle)
    if new:
        sync_folder(disk, path.parent)


def cut(disk: Disk, path: Path, length: int) -> None:
    """Shorten a file to so many bytes, or only flush it where it has no more."""
    handle = disk.open(path, os.O_RDWR)
    try:
        if os.fstat(handle).st_size > length:
            disk.ftruncate(handle, length)
        disk.fsync(handle)
    finally:
        os.close(handle)


def write_all(disk: Disk, handle: int, data: bytes) -> None:
    """Write it all: on a disk that is nearly full, a call may write less than it was given, and says so only next."""
    rest = memoryview(data)
    while rest:
        rest = rest[disk.write(handle, bytes(rest) if len(rest) < len(data) else data) :]


def discard(disk: Disk, path: Path) -> None:
    """Remove what a failure left, if that can be done."""
    try:
        disk.unlink(path)
    except OSError:
        # The failure that led here is the one to tell; what stays is cleared away when the grid is opened again.
        return


def sync_folder(disk: Disk, folder: Path) -> None:
    """Make a rename last. Where folders cannot be opened (Windows) the file system has to see to it."""
    try:
        handle = disk.open(folder, os.O_RDONLY)
    except PermissionError:
        return
    try:
        disk.fsync(handle)
    finally:
        os.close(handle)
