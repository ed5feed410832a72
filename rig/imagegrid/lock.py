"""One writer at a time for a folder: a lock that names its holder, and the picture that the holder has in hand."""

from __future__ import annotations

import json
import os
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.errors import InputError
from rig.imagegrid.disk import Disk, discard, write_all

LOCK = ".lock"


class FolderLock:
    """Holds a folder until it is released, or the process ends in whatever way.

    The operating system lets go of the lock when its holder dies, so none is ever stale. What the holder has noted
    stays in the file, and tells the next one what was left half done. It is not flushed: after a power loss it may be
    gone, and with it no more than the right to clear up.

    Attributes:
        left: what a holder that was killed had noted, or ``None``.

    Raises:
        InputError: another process holds it; names its PID.
        OSError: the lock file cannot be written.
    """

    def __init__(self, folder: Path, disk: Disk = os) -> None:
        self.folder = folder
        self._disk = disk
        self._handle = _locked(folder, disk)
        self._release = weakref.finalize(self, _release, self._handle, folder / LOCK, disk)
        found = _read(self._handle)
        self.left: Mapping[str, Any] | None = found.get("line") if found is not None else None
        try:
            # Kept in the note until another picture takes its place: its own death may come first.
            self.note(self.left)
        except OSError:
            self.release()
            raise

    def note(self, line: Mapping[str, Any] | None) -> None:
        """Say which picture is in hand, by its line of the manifest."""
        text = json.dumps({"pid": os.getpid(), "line": line}, ensure_ascii=False).encode()
        os.lseek(self._handle, 0, os.SEEK_SET)
        self._disk.ftruncate(self._handle, 0)
        write_all(self._disk, self._handle, text)

    def release(self) -> None:
        """Let go, and leave no file behind. Safe to call twice."""
        self._release()


def _locked(folder: Path, disk: Disk) -> int:
    path = folder / LOCK
    while True:
        handle = disk.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock(handle, folder)
            # The former holder may have removed the file between our opening and our locking it.
            if path.exists() and os.path.samestat(os.fstat(handle), path.stat()):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows: no such locks; that nobody else writes there is then the user's to see to.
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as failure:
        pid = (_read(handle) or {}).get("pid")
        holder = "another process" if pid is None else "this process" if pid == os.getpid() else f"process {pid}"
        raise InputError(
            f"{holder} is writing there", where=str(folder), remedy="Wait until it has ended, or name another folder"
        ) from failure


def _read(handle: int) -> dict[str, Any] | None:
    """What the file says; ``None`` for nothing, or for something that was torn when its writer was killed."""
    os.lseek(handle, 0, os.SEEK_SET)
    try:
        found = json.loads(os.read(handle, 1 << 20))
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def _release(handle: int, path: Path, disk: Disk) -> None:
    discard(disk, path)
    os.close(handle)
