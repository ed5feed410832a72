"""Sends the main thread a second signal at each line that the handler of the first one runs through."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from types import FrameType
from typing import Any

STUCK_S = 10.0


def at_every_line(inside: Callable[[], AbstractContextManager[Any]], number: signal.Signals) -> int:
    """Returns at how many lines the second signal came. Ends the process with 9 where the main thread got stuck."""
    threading.Thread(target=_watch, args=(threading.Event(),), daemon=True).start()
    line = 0
    while _twice(inside, number, line):
        line += 1
    return line


def _watch(never: threading.Event) -> None:
    never.wait(STUCK_S)
    os._exit(9)


def _twice(inside: Callable[[], AbstractContextManager[Any]], number: signal.Signals, at: int) -> bool:
    """The first signal, and the second at a line of what follows; False if there is no such line."""
    seen = 0

    def trace(frame: FrameType, event: str, argument: object) -> Any:
        nonlocal seen
        if event == "line":
            seen += 1
            if seen == at + 1:
                signal.raise_signal(number)
        return trace

    with inside(), suppress(KeyboardInterrupt):
        sys.settrace(trace)
        try:
            signal.raise_signal(number)
        finally:
            sys.settrace(None)
    return seen > at
