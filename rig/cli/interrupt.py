"""What Ctrl-C does: the first press ends a run after the view in hand and holds motion, the second is STOP."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from types import FrameType
from typing import Protocol, runtime_checkable

_STOP_S = 15.0


@runtime_checkable
class Halts(Protocol):
    """Something that moves: a `rig.guard.Guard`."""

    def hold(self) -> object:
        """Stop motion; a picture being taken is finished."""
        ...

    def stop(self, by: str) -> object:
        """STOP, latched."""
        ...


@contextmanager
def ends_gently(rig: object = None, *, silent: bool = False, saying: str | None = None) -> Iterator[Callable[[], bool]]:
    """While inside, SIGINT and SIGTERM are requests; yields a function that says whether one was made.

    ``saying``: what the first one is answered with, where it is no view that is finished.

    Of a rig that moves (`Halts`) the first also holds the motion; the second stops it for good (STOP, latched), and
    raises KeyboardInterrupt wherever the program is. In a thread other than the main one signals are left as they are.
    """
    halts = rig if isinstance(rig, Halts) else None
    answered = saying or (
        "holding motion, finishing the picture in hand; Ctrl-C again: STOP"
        if halts
        else "finishing this view; press Ctrl-C again to stop at once"
    )
    asked = False
    # A signal may come while the main thread holds any lock: another thread, begun before, does what it asks for. Nor
    # may the handler take one, for the next signal interrupts it: only `SimpleQueue.put` is safe then.
    wishes: SimpleQueue[str] = SimpleQueue()

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        again, asked = asked, True
        wishes.put("stop" if again else "hold")
        if again:
            raise KeyboardInterrupt
        if not silent:
            # Where the main thread is just writing there nothing can be told.
            with suppress(RuntimeError):
                print(answered, file=sys.stderr, flush=True)

    def was_asked() -> bool:
        return asked

    if threading.current_thread() is not threading.main_thread():
        yield was_asked
        return
    helper = threading.Thread(target=_follow, args=(wishes, halts), name="Ctrl-C", daemon=True)
    helper.start()
    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield was_asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        wishes.put("")
        helper.join(_STOP_S)


def _follow(wishes: SimpleQueue[str], rig: Halts | None) -> None:
    while wish := wishes.get():
        if rig is None:
            continue
        if wish == "stop":
            _tried("STOP", lambda: _stop(rig))
        else:
            # In a thread of its own, so that a hold that takes long does not delay a STOP.
            _tried("hold", threading.Thread(target=_tried, args=("hold", rig.hold), name="hold", daemon=True).start)


def _stop(rig: Halts) -> None:
    from rig.devices import StopReport

    report = rig.stop("Ctrl-C twice")
    certain = "everything is at rest"
    if isinstance(report, StopReport) and not report.confirmed:
        certain = f"NOT CONFIRMED: use the wired emergency stop ({report.trouble})"
    release = f"rig stop {getattr(rig, 'bench', 'BENCH')} --release"
    print(f"STOP: {certain}; nothing moves before it is released: {release}", file=sys.stderr, flush=True)


def _tried(what: str, action: Callable[[], object]) -> None:
    """Whatever goes wrong, the next Ctrl-C must find somebody who follows."""
    try:
        action()
    except Exception as error:
        told = f"{what} failed: {type(error).__name__}: {error}. Use the wired emergency stop. This is a bug: report it"
        print(told, file=sys.stderr, flush=True)
