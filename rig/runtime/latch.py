"""A STOP that outlives the process that was stopped: a file that every session looks for before it moves anything."""

from __future__ import annotations

import os
from collections.abc import Callable
from datetime import datetime
from pathlib import Path


def _now() -> datetime:
    return datetime.now().astimezone()


class FileLatch:
    """A `rig.guard.StopLatch`. Cheap to look at: one call that finds no file.

    Args:
        path: of the file, in a private folder.
        now: date and time, for people.
    """

    def __init__(self, path: Path, now: Callable[[], datetime] = _now) -> None:
        self._path, self._now = path, now

    def note(self) -> str:
        """Who stopped the bench and when; empty if it is not stopped. A file that cannot be read still stops."""
        try:
            return self._path.read_text(errors="replace").strip() or "by somebody"
        except FileNotFoundError:
            return ""
        except OSError as failure:
            return f"{self._path} cannot be read: {failure.strerror}"

    def set(self, note: str) -> str:
        """Latch, unless that is done already; returns what went wrong. Never raises."""
        text = f"{note}, process {os.getpid()}, {self._now():%Y-%m-%d %H:%M:%S}\n"
        try:
            with self._path.open("x") as file:
                file.write(text)
        except FileExistsError:
            return ""
        except OSError as failure:
            # An empty file that could be made, on a full disk, latches all the same.
            if self._path.exists():
                return ""
            return f"STOP could not be latched for other processes ({failure.strerror}): keep them from moving"
        return ""

    def clear(self) -> None:
        """Release."""
        self._path.unlink(missing_ok=True)
