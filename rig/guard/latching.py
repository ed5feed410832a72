"""Latches a STOP for other processes while the devices are stopping: neither waits for the other."""

from __future__ import annotations

import threading

from rig.guard.watch import StopLatch

LATCH_S = 2.0
"""How long a file system that hangs may keep a STOP from telling what it did; real time."""


class Latching:
    """Begins to latch in a thread of its own.

    Args:
        latch: keeps the STOP.
        note: who stopped.
    """

    def __init__(self, latch: StopLatch, note: str) -> None:
        self._latch, self._note, self._trouble = latch, note, ""
        self._thread: threading.Thread | None = threading.Thread(target=self._set, name="STOP latch", daemon=True)
        try:
            self._thread.start()
        except RuntimeError:
            # No thread can be had: then once the devices are stopped, rather than not at all.
            self._thread = None

    def end(self) -> str:
        """Wait until it is latched; returns what went wrong, empty if nothing did."""
        if self._thread is None:
            self._set()
            return self._trouble
        self._thread.join(LATCH_S)
        if self._thread.is_alive():
            return "STOP is not latched for other processes yet: keep them from moving"
        return self._trouble

    def _set(self) -> None:
        self._trouble = self._latch.set(self._note)
