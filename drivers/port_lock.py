"""Lets one process at a time use a device, and tells the others which process that is.

A lock is a file in ``/tmp``, named after the device, locked with ``flock`` and holding the process's number. It is
there for all users alike, whatever their environment says, and stays when it is given back, so that nobody locks a
file that another has just removed. The kernel drops a lock with its process, however that ends: there are no stale
ones.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from rig.errors import HardwareError

SHARED = Path("/tmp")
"""The same for every user, login and service: a device is used by one of them at a time."""
_OPEN = os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC


class PortLock:
    """A held lock; `release` gives it back. Made by `lock_port`."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def release(self) -> None:
        """Give the lock back. Safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def lock_port(device: str, folder: Path | None = None) -> PortLock:
    """Take the lock of a device.

    Args:
        device: the device's own path, links resolved.
        folder: where locks live; ``/tmp`` where not told.

    Raises:
        HardwareError: another process holds it (names the process), or its file cannot be opened.
    """
    path = (folder or SHARED) / f"rig-lock-{device.strip('/').replace('/', '-')}"
    try:
        descriptor = _opened(path)
    except OSError as error:
        raise HardwareError(f"{device}: its lock file {path} cannot be opened ({error.strerror}). Remove it") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        holder = os.pread(descriptor, 32, 0).decode("ascii", "replace").strip() or "unknown"
        os.close(descriptor)
        raise HardwareError(
            f"{device}: in use by process {holder}. Stop that process, or wait until it is done"
        ) from error
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
    return PortLock(descriptor)


def _opened(path: Path) -> int:
    """The lock file, made if need be, so that any user may lock it.

    Looked for before it is made: in a sticky folder the kernel (``fs.protected_regular``) lets nobody *create* a file
    that somebody else has made, although all may write it.
    """
    try:
        return os.open(path, _OPEN)
    except FileNotFoundError:
        pass
    try:
        descriptor = os.open(path, _OPEN | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        return os.open(path, _OPEN)
    os.fchmod(descriptor, 0o666)
    return descriptor
