"""What Ctrl-C does to a run: the first ends it after the view in hand, the second at once."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def ends_gently() -> Iterator[Callable[[], bool]]:
    """While inside, SIGINT and SIGTERM are requests; yields a function that says whether one was made.

    A second SIGINT raises KeyboardInterrupt wherever the program is. In a thread other than the main one signals are
    left as they are.
    """
    asked = threading.Event()

    def ask(number: int, frame: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()
        print("finishing this view; press Ctrl-C again to stop at once", file=sys.stderr, flush=True)

    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
