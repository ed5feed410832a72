"""Ends a session in order when it is told to end or loses its terminal, even where the screen hangs (decision 0055)."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue

INTERRUPTED = 130
GRACE_S = 3.0


@contextmanager
def leaves_in_order(
    force: Callable[[], object], *, grace_s: float = GRACE_S, end: Callable[[int], object] = os._exit
) -> Iterator[threading.Event]:
    """While inside, SIGTERM and SIGHUP set the event that is yielded; the screen is to end when it is set.

    textual writes through a queue: where the terminal is gone nobody empties it, and the screen waits for ever.

    Args:
        force: holds and closes the bench, from another thread, where the screen has not been left in time.
        grace_s: real time that the screen has.
        end: ends the process then.
    """
    asked, left = threading.Event(), threading.Event()
    # The next signal interrupts the handler of the first, which must therefore take no lock, as an event's `set` does.
    wishes: SimpleQueue[None] = SimpleQueue()

    def watch() -> None:
        wishes.get()
        asked.set()
        if not left.wait(grace_s):
            try:
                force()
            finally:
                end(INTERRUPTED)

    threading.Thread(target=watch, name="jog leaving", daemon=True).start()
    before = {number: signal.signal(number, lambda *_: wishes.put(None)) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield asked
    finally:
        left.set()
        wishes.put(None)
        for number, handler in before.items():
            signal.signal(number, handler)
