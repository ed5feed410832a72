"""The files by which processes that use one bench meet."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from rig.runtime.homing import FileHomingMemory
from rig.runtime.latch import FileLatch
from rig.runtime.line import Attended, ask, ask_holder, listening


class Attendance:
    """One bench in the runtime folder.

    Args:
        folder: private to the user.
        key: names the bench, the same for all processes.
        bench: for people.

    Attributes:
        latch: a STOP that outlives processes.
        homing: where the gantry was left homed.
    """

    def __init__(self, folder: Path, key: str, bench: str) -> None:
        self._line, self._bench = folder / f"{key}.sock", bench
        self.latch = FileLatch(folder / f"{key}.stopped")
        self.homing = FileHomingMemory(folder / f"{key}.homed")

    def listen(self, guard: Attended) -> AbstractContextManager[None]:
        """Answer other processes while inside."""
        return listening(self._line, self._bench, guard)

    def ask(self, what: str, **details: str) -> dict[str, Any] | None:
        """Ask the process that holds the bench (see `rig.runtime.ask`); ``None`` if none does."""
        return ask(self._line, what, **details)


def held_benches(folder: Path) -> list[Path]:
    """The sockets of the processes that hold a bench now."""
    return [path for path in sorted(folder.glob("*.sock")) if ask_holder(path)]
