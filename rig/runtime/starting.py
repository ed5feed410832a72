"""A STOP of whatever is held also concerns commands that are just starting and hold nothing yet: they find it here."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

NAME = "all.stopped-at"
STARTING_S = 10.0
"""No command takes longer from its start until it holds its bench. What came before that is no longer its concern."""
_IMPORTED_S = time.monotonic()


class StopOfAll:
    """When somebody last asked for a STOP of everything.

    Args:
        folder: where processes meet.
        now: seconds, the same for all processes of this computer.
    """

    def __init__(self, folder: Path, now: Callable[[], float] = time.monotonic) -> None:
        self._path, self._now = folder / NAME, now

    def set(self, by: str) -> None:
        """Ask for one now. Where it cannot be written, those who are starting do not hear of it."""
        new = self._path.with_name(f"{NAME}.{os.getpid()}")
        with suppress(OSError):
            new.write_text(json.dumps({"at_s": self._now(), "by": by}), encoding="utf-8")
            # Whole, whoever reads it meanwhile.
            new.replace(self._path)

    def since(self, begun_s: float) -> str:
        """Who asked for one after ``begun_s``; empty if nobody did."""
        try:
            told = json.loads(self._path.read_text(encoding="utf-8"))
            # A time to come is one from before this computer was started.
            return str(told["by"]) if begun_s <= float(told["at_s"]) <= self._now() else ""
        except (OSError, ValueError, KeyError, TypeError):
            return ""


def begun_s() -> float:
    """When this process began, on the monotonic clock, or `STARTING_S` ago if that is later."""
    now_s = time.monotonic()
    age_s = now_s - _IMPORTED_S
    with suppress(OSError, ValueError, IndexError, AttributeError):
        # Behind the name of the process, which may hold anything, the 20th: clock ticks since the computer's start.
        # They are rounded down: a process may seem to have begun too early, and is stopped, never too late.
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        age_s = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    return now_s - min(age_s, STARTING_S)
