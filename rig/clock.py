"""The computer's own monotonic clock, handed to everything that measures or waits on a real bench."""

from __future__ import annotations

import time


class SystemClock:
    """A `rig.devices.Clock`: real time, never set back."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        return time.monotonic()

    def sleep_s(self, seconds: float) -> None:
        """Wait."""
        time.sleep(max(0.0, seconds))
