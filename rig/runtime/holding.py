"""Lets one process at a time hold a bench, and tells the others which process that is and what it does there.

A lock is a file in the runtime folder, locked with ``flock``: the kernel drops it with the process, however that ends,
so none is ever stale. It is taken before any device is opened, so that of two commands which start together one gets
all devices and the other none.
"""

from __future__ import annotations

import fcntl
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from rig.errors import HardwareError

YIELD_S = 15.0
"""Real time that one who only looks may take to make room: it may be connecting, or closing devices."""
_AGAIN_S = 0.05
_LOOKED_AT_S = 0.2
"""Who looks whether a lock is held holds it himself, for less than a millisecond."""
_LONGEST = 120


@dataclass(frozen=True, slots=True)
class Holder:
    """A process that holds a bench.

    Attributes:
        pid: its number; 0 where it has not said so.
        command: as it was typed.
        yields: it only looks, and makes room for who moves something.
    """

    pid: int = 0
    command: str = ""
    yields: bool = False

    @property
    def words(self) -> str:
        """For people: ``process 123 (`rig move bench.yaml --x-mm 5`)``."""
        process = f"process {self.pid}" if self.pid else "another process"
        return f"{process} (`{self.command}`)" if self.command else process


class BenchHeldError(HardwareError):
    """Another process holds the bench. Nothing was opened, and nothing sent.

    Attributes:
        holder: who.
    """

    def __init__(self, bench: str, holder: Holder) -> None:
        self.holder = holder
        stop = f"`rig stop {shlex.quote(bench)}`"
        super().__init__(f"{bench}: {holder.words} holds this bench. Wait until it is done, or stop it ({stop})")


def this_process(*, yields: bool = False) -> Holder:
    """The holder that this process is."""
    name, *arguments = sys.argv or ["rig"]
    command = " ".join([Path(name).name, *map(shlex.quote, arguments)])
    shown = command if len(command) <= _LONGEST else f"{command[:_LONGEST]} ..."
    return Holder(os.getpid(), shown, yields)


@contextmanager
def holding(paths: Sequence[Path], bench: str, me: Holder, ask_to_yield: Callable[[], object]) -> Iterator[None]:
    """Hold a bench while inside.

    Args:
        paths: of the locks, one for each name by which the bench may be known; the surest last.
        bench: for people.
        me: written into the locks.
        ask_to_yield: asks a holder that only looks to make room; not called by one that only looks itself.

    Raises:
        BenchHeldError: another process holds it, and makes no room.
        HardwareError: a lock cannot be made.
    """
    began_s = time.monotonic()
    while True:
        with ExitStack() as held:
            other = _taken(held, paths, me)
            if other is None:
                yield
                return
        waited_s = time.monotonic() - began_s
        makes_room = other.yields and not me.yields
        if waited_s > (YIELD_S if makes_room else _LOOKED_AT_S):
            raise BenchHeldError(bench, other)
        if makes_room:
            ask_to_yield()
        time.sleep(_AGAIN_S)


def holder_of(paths: Sequence[Path]) -> Holder | None:
    """Who holds a bench now; ``None`` if nobody does."""
    for path in paths:
        try:
            handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except FileNotFoundError:
            continue
        try:
            if not _locked(handle, fcntl.LOCK_SH):
                return _read(handle)
        finally:
            os.close(handle)
    return None


def _taken(held: ExitStack, paths: Sequence[Path], me: Holder) -> Holder | None:
    """Take all locks; who holds one, if somebody does."""
    # The surest name first: who has it gets the others, so that nobody meets one who is about to be refused himself.
    for path in reversed(paths):
        other = _take(held, path, me)
        if other is not None:
            return other
    return None


def _take(held: ExitStack, path: Path, me: Holder) -> Holder | None:
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as failure:
            raise HardwareError(f"{path} cannot be locked ({failure.strerror}). Remove it, then try again") from failure
        if not _locked(handle, fcntl.LOCK_EX):
            other = _read(handle)
            os.close(handle)
            return other
        # The former holder may have removed the file between our opening and our locking it.
        if _is_at(handle, path):
            break
        os.close(handle)
    held.callback(os.close, handle)
    held.callback(path.unlink, missing_ok=True)
    # On a full disk it is held all the same, by somebody who cannot say who he is.
    with suppress(OSError):
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps(asdict(me)).encode(), 0)
    return None


def _locked(handle: int, how: int) -> bool:
    try:
        fcntl.flock(handle, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _read(handle: int) -> Holder:
    """What a holder has written; nothing is known of one that is just beginning."""
    try:
        told = json.loads(os.pread(handle, 4096, 0))
        return Holder(int(told["pid"]), str(told["command"]), bool(told["yields"]))
    except (ValueError, KeyError, TypeError):
        return Holder()
