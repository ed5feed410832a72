"""A STOP that outlives the process that was stopped: a file that every session looks for before it moves anything."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path


def _now() -> datetime:
    return datetime.now().astimezone()


class FileLatch:
    """A `rig.guard.StopLatch`. Cheap to look at: one call for each name, which finds no file.

    Args:
        paths: of the files, in one private folder: one for each name by which the bench may be known. Each of them
            stops; it holds the note, and then the names of all, since others may know but one of them.
        now: date and time, for people.
    """

    def __init__(self, *paths: Path, now: Callable[[], datetime] = _now) -> None:
        self._paths, self._now = paths, now

    def note(self) -> str:
        """Who stopped the bench and when; empty if it is not stopped. A file that cannot be read still stops."""
        for path in self._paths:
            try:
                return path.read_text(errors="replace").partition("\n")[0].strip() or "by somebody"
            except FileNotFoundError:
                continue
            except OSError as failure:
                return f"{path} cannot be read: {failure.strerror}"
        return ""

    def set(self, note: str) -> str:
        """Latch, unless that is done already; returns what went wrong. Never raises."""
        who = " ".join(note.split())
        # Who asked for it from another process has told which.
        process = "" if "process " in who else f", process {os.getpid()}"
        first = f"{who}{process}, {self._now():%Y-%m-%d %H:%M:%S}"
        lines = (first, *(path.name for path in self._paths))
        troubles = [_written(path, "\n".join(lines) + "\n") for path in self._paths]
        return next(filter(None, troubles), "")

    def clear(self) -> None:
        """Release."""
        # Its own names last: where this is killed halfway the bench is still stopped by all that it knows of.
        for path in (*_others(self._paths), *self._paths):
            path.unlink(missing_ok=True)


def _others(paths: Sequence[Path]) -> set[Path]:
    """The files of further names that these tell of."""
    found: set[Path] = set()
    for path in paths:
        with suppress(OSError, ValueError):
            _, *names = path.read_text(errors="replace").splitlines()
            # Nothing outside the folder, whatever the file says.
            found |= {path.with_name(Path(name).name) for name in names if name.endswith(path.suffix)}
    return found - set(paths)


def _written(path: Path, text: str) -> str:
    try:
        with path.open("x") as file:
            file.write(text)
    except FileExistsError:
        return ""
    except OSError as failure:
        # An empty file that could be made, on a full disk, latches all the same.
        if path.exists():
            return ""
        return f"STOP could not be latched for other processes ({failure.strerror}): keep them from moving"
    return ""
