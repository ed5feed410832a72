"""The files by which processes that use one bench meet."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from rig.devices import StopReport
from rig.errors import RigError
from rig.runtime.homing import FileHomingMemory
from rig.runtime.latch import FileLatch
from rig.runtime.line import Attended, ask, listening
from rig.runtime.telling import stop_object


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


def stop_held(folder: Path, by: str) -> list[dict[str, Any]]:
    """STOP all benches that processes hold, all at the same time, and return what they told.

    Of a process that does not answer the report says so, and is not confirmed.
    """
    reports: list[dict[str, Any]] = []

    def stop(path: Path) -> None:
        try:
            answer = ask(path, "stop", by=by)
        except RigError as error:
            answer = {"bench": str(path), **stop_object(StopReport(None, False, False, str(error)))}
        if answer is not None:
            reports.append(answer)

    threads = [threading.Thread(target=stop, args=(path,), daemon=True) for path in sorted(folder.glob("*.sock"))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sorted(reports, key=lambda report: str(report["bench"]))
