"""Lets one process at a time use a device, and tells the others which process that is.

A lock is a file in the system's temporary folder, named after the device, locked with ``flock`` and holding the
process's number. The kernel drops it with the process, however that ends, so there are no stale locks.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

from rig.errors import HardwareError


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
        folder: where locks live; the system's temporary folder where not told.

    Raises:
        HardwareError: another process holds it (names the process), or the lock file belongs to another user.
    """
    path = (folder or Path(tempfile.gettempdir())) / f"rig-lock-{device.strip('/').replace('/', '-')}"
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
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
