"""The files by which processes that use one bench meet."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rig.devices import StopReport
from rig.errors import RigError
from rig.runtime.holding import Holder, holder_of, holding, this_process
from rig.runtime.homing import FileHomingMemory
from rig.runtime.latch import FileLatch
from rig.runtime.line import Attended, MuteError, ask, listening
from rig.runtime.starting import StopOfAll, begun_s
from rig.runtime.telling import stop_object

PASSING_S = 5.0
"""How long a command may take to open its devices, or to close them."""
_AGAIN_S = 0.1


class Attendance:
    """One bench in the runtime folder.

    Args:
        folder: private to the user.
        key: names the bench, the same for all processes that know it by this name.
        bench: for people.
        also: keys of other names by which the same bench may be known; the last is the surest one.
        make_room: for who only looks at the bench: called, in another thread, when a process asks that moves something.

    Attributes:
        latch: a STOP that outlives processes.
        homing: where the gantry was left homed.
    """

    def __init__(
        self,
        folder: Path,
        key: str,
        bench: str,
        *,
        also: Sequence[str] = (),
        make_room: Callable[[], object] | None = None,
    ) -> None:
        keys = (key, *also)
        self._lines, self._bench = tuple(folder / f"{one}.sock" for one in keys), bench
        self._locks, self._make_room = tuple(folder / f"{one}.held" for one in keys), make_room
        self._stop_of_all, self._begun_s = StopOfAll(folder), begun_s()
        self.latch = FileLatch(*(folder / f"{one}.stopped" for one in keys))
        self.homing = FileHomingMemory(folder / f"{keys[-1]}.homed")

    @contextmanager
    def listen(self, guard: Attended) -> Iterator[None]:
        """Hold the bench, and answer other processes, while inside.

        Where all was stopped since this process began, or last held the bench, STOP is latched.

        Raises:
            BenchHeldError: another process holds it.
            InputError: the socket cannot be made.
        """
        command = this_process().command
        with self.hold(), listening(self._lines, self._bench, guard, command, self._make_room):
            # Only now: who stops all looks for those that listen after he has left word for the others.
            if by := self._stop_of_all.since(self._begun_s):
                self.latch.set(by)
            try:
                yield
            finally:
                self._begun_s = time.monotonic()

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Hold the bench while inside, and answer nobody.

        Raises:
            BenchHeldError: another process holds it.
        """
        me = this_process(yields=self._make_room is not None)
        with holding(self._locks, self._bench, me, self._ask_for_room):
            yield

    def holder(self) -> Holder | None:
        """Who holds the bench now; ``None`` if nobody does."""
        return holder_of(self._locks)

    def ask(self, what: str, **details: str) -> dict[str, Any] | None:
        """Ask the process that holds the bench; ``None`` if none does.

        Raises:
            MuteError: it does not answer; tells which process it is.
            RigError: what was asked was refused, and why.
        """
        try:
            answers = (ask(line, what, **details) for line in self._lines)
            return next((answer for answer in answers if answer is not None), None)
        except MuteError as error:
            holder = self.holder() or Holder()
            raise MuteError(f"{self._bench}: {holder.words}", error.why) from error

    def stop(self, by: str) -> dict[str, Any] | None:
        """STOP by the process that holds the bench; what it told, or ``None`` if none does any more.

        Raises:
            MuteError: as `ask`.
        """
        return _told_all(lambda: self.ask("stop", by=by))[-1]

    def _ask_for_room(self) -> None:
        # Who does not answer, or does not understand, keeps the bench; that is told where it is not free in time.
        with suppress(RigError):
            self.ask("make room")


def stop_held(folder: Path, by: str) -> list[dict[str, Any]]:
    """STOP all benches that processes hold, all at the same time, and return what they told.

    Processes that have begun already, and hold nothing yet, will find STOP latched.
    Of a process that does not answer the report says so, and is not confirmed.
    """
    reports: list[dict[str, Any]] = []

    def stop(path: Path) -> None:
        try:
            answers = _told_all(lambda: ask(path, "stop", by=by))
        except RigError as error:
            answers = [{"bench": str(path), **stop_object(StopReport(None, False, False, str(error)))}]
        # Who has gone meanwhile told what it knew before.
        reports.extend(list(filter(None, answers))[-1:])

    StopOfAll(folder).set(by)
    # A link is another name of a bench that is there already.
    lines = [path for path in folder.glob("*.sock") if not path.is_symlink()]
    threads = [threading.Thread(target=stop, args=(path,), daemon=True) for path in lines]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sorted(reports, key=lambda report: str(report["bench"]))


def _told_all(stop: Callable[[], dict[str, Any] | None]) -> list[dict[str, Any] | None]:
    """Ask for a STOP until who is asked knows all devices, or is gone; what it told each time.

    One that is still connecting, or is closing, moves nothing, and cannot tell how its devices are.
    """
    until_s = time.monotonic() + PASSING_S
    answers = [stop()]
    while (last := answers[-1]) and not last["confirmed"] and last["running"] in ("connecting", "closing"):
        if time.monotonic() > until_s:
            break
        time.sleep(_AGAIN_S)
        answers.append(stop())
    return answers
