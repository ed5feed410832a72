"""What Ctrl-C does to a run: the first ends it after the view in hand, the second at once."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def ends_gently(
    saying: str = "finishing this view; press Ctrl-C again to stop at once",
    at_first: Callable[[], None] | None = None,
) -> Iterator[Callable[[], bool]]:
    """While inside, SIGINT and SIGTERM are requests; yields a function that says whether one was made.

    The first is answered with ``saying``, and calls ``at_first`` in a thread of its own: what was interrupted may hold
    a lock that ``at_first`` waits for. A second SIGINT raises KeyboardInterrupt wherever the program is. In a thread
    other than the main one signals are left as they are.
    """
    asked = threading.Event()

    def ask(number: int, frame: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()
        print(saying, file=sys.stderr, flush=True)
        if at_first is not None:
            threading.Thread(target=at_first, name="at first Ctrl-C", daemon=True).start()

    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
