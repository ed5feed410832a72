"""Bounds from below when a frame arrived and was exposed, however many older ones a buffer held (decision 0052).

No clock of the camera is believed, and no speed of this computer. The facts used hold whatever is late:
- A buffer that was seen empty at time t hands out only frames that arrived after t.
- A buffer of at most n frames hands out, after n grabs that began at t or later, only frames that arrived after t.
- A frame is not exposed before the exposure of the frame before it has ended.
"""

from __future__ import annotations

import math
from collections import deque


class FreshnessBound:
    """Follows one camera's buffer, which hands frames out in the order in which they arrived."""

    def __init__(self, buffer_frames: int | None, latency_s: float) -> None:
        """Nothing is known yet.

        Args:
            buffer_frames: most frames that the buffer can hold; ``None``: no bound is known.
            latency_s: longest time from the end of an exposure until the frame has arrived.
        """
        self._latency_s = latency_s
        self._begun_s: deque[float] | None = None if buffer_frames is None else deque(maxlen=buffer_frames + 1)
        self._arrived_after_s = self._before_arrived_after_s = -math.inf

    def seen_empty(self, at_s: float) -> None:
        """The buffer held nothing at some moment that was no earlier than this."""
        self._arrived_after_s = max(self._arrived_after_s, at_s)

    def grabbed(self, began_s: float, exposure_s: float = math.inf) -> float:
        """A grab that began then gave a frame; returns a time that its exposure began after.

        Args:
            began_s: when the grab began.
            exposure_s: how long the exposure can have been; infinite: not known.

        Returns:
            Seconds on the same clock, ``-inf`` as long as nothing is known.
        """
        before_s = self._before_arrived_after_s
        if self._begun_s is not None:
            self._begun_s.append(began_s)
            if len(self._begun_s) == self._begun_s.maxlen:
                self._arrived_after_s = max(self._arrived_after_s, self._begun_s[0])
        self._before_arrived_after_s = self._arrived_after_s
        return max(before_s, self._arrived_after_s - exposure_s) - self._latency_s
