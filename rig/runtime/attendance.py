"""The files by which processes that use one bench meet."""

from __future__ import annotations

import threading
from collections.abc import Sequence
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
        key: names the bench, the same for all processes that know it by this name.
        bench: for people.
        also: keys of other names by which the same bench may be known; the last is the surest one.

    Attributes:
        latch: a STOP that outlives processes.
        homing: where the gantry was left homed.
    """

    def __init__(self, folder: Path, key: str, bench: str, *, also: Sequence[str] = ()) -> None:
        keys = (key, *also)
        self._lines, self._bench = tuple(folder / f"{one}.sock" for one in keys), bench
        self.latch = FileLatch(*(folder / f"{one}.stopped" for one in keys))
        self.homing = FileHomingMemory(folder / f"{keys[-1]}.homed")

    def listen(self, guard: Attended) -> AbstractContextManager[None]:
        """Answer other processes while inside."""
        return listening(self._lines, self._bench, guard)

    def ask(self, what: str, **details: str) -> dict[str, Any] | None:
        """Ask the process that holds the bench (see `rig.runtime.ask`); ``None`` if none does."""
        answers = (ask(line, what, **details) for line in self._lines)
        return next((answer for answer in answers if answer is not None), None)


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

    # A link is another name of a bench that is there already.
    lines = [path for path in folder.glob("*.sock") if not path.is_symlink()]
    threads = [threading.Thread(target=stop, args=(path,), daemon=True) for path in lines]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sorted(reports, key=lambda report: str(report["bench"]))
