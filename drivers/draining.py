"""Who takes frames out of a camera's buffer: a thread, or, on simulated time, whoever waits for a picture."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Protocol

from rig.devices import Clock

_PAUSE_S = 0.002
_PATIENCE_S = 0.3


class Drain(Protocol):
    """Runs one camera's steps until one returns False or `stop` is called, then the finish, once."""

    def start(self, step: Callable[[], bool], finish: Callable[[], None]) -> None:
        """Begin."""
        ...

    def idle(self) -> None:
        """Let it go on for a moment."""
        ...

    def stop(self) -> None:
        """End it, waiting a bounded time. A step that hangs finishes by itself once it returns."""
        ...


class ThreadDrain:
    """Steps in a thread of their own. Nobody else touches the source, for OpenCV's captures are not made for that."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, step: Callable[[], bool], finish: Callable[[], None]) -> None:
        """Begin in a new thread."""
        self._stop = stop = threading.Event()

        def run() -> None:
            # A signal would end OpenCV's poll early, which then looks like a buffer that was seen empty.
            signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
            try:
                while not stop.is_set() and step():
                    pass
            finally:
                finish()

        # A daemon: a camera that hangs in a read must not keep the process from ending.
        self._thread = threading.Thread(target=run, name="camera drain", daemon=True)
        self._thread.start()

    def idle(self) -> None:
        """Wait a moment."""
        self._clock.sleep_s(_PAUSE_S)

    def stop(self) -> None:
        """End the thread, or leave it to end by itself where a read hangs."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(_PATIENCE_S)
            self._thread = None


class InlineDrain:
    """Steps are run by whoever waits; time passes in the reads of an emulated source. Between captures nothing drains,
    which is the worst that can happen to a buffer."""

    def __init__(self) -> None:
        self._step: Callable[[], bool] | None = None
        self._finish: Callable[[], None] = _nothing

    def start(self, step: Callable[[], bool], finish: Callable[[], None]) -> None:
        """Begin with the next `idle`."""
        self._step, self._finish = step, finish

    def idle(self) -> None:
        """One step."""
        if self._step is not None and not self._step():
            self.stop()

    def stop(self) -> None:
        """End it now."""
        if self._step is not None:
            self._step = None
            self._finish()


def _nothing() -> None:
    pass
