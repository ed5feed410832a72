"""Has Python's garbage collected while nothing moves, and only then (decision 0055)."""

from __future__ import annotations

import gc
from typing import Any

from rig.devices import Clock

EVERY_S = 10.0


class Pauses:
    """A context manager: inside, garbage in cycles is collected by `take` alone.

    A full collection keeps all threads at a stand while it looks through every object, 0.1 to 0.35 s here: the one that
    sends STOP, too, and the one that keeps a moving servo's watchdog (0.2 s) quiet.

    Args:
        clock: for the time between two collections.
        every_s: the shortest.
    """

    def __init__(self, clock: Clock, *, every_s: float = EVERY_S) -> None:
        self._clock, self._every_s = clock, every_s
        self._last_s = clock.now_s()

    def take(self) -> None:
        """Collect, if that was not done just now. To be called while nothing moves."""
        if self._clock.now_s() - self._last_s >= self._every_s:
            gc.collect()
            self._last_s = self._clock.now_s()

    def __enter__(self) -> Pauses:
        gc.collect()
        # What the libraries have made by now stays for good, and need not be looked through again.
        gc.freeze()
        gc.disable()
        return self

    def __exit__(self, *exc: Any) -> None:
        gc.enable()
        gc.unfreeze()
