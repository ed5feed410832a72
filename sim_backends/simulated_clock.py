"""A clock whose time passes only when somebody waits, and that carries emulated devices along.

It is a `rig.devices.Clock`: `sleep_s` runs every attached device up to the new time, event by event and in order, and
returns at once in real time. A read with a time-out on a simulated port waits through `wait_until`.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import Protocol

_FOREVER_S = 1e12


class Simulated(Protocol):
    """A device that lives on simulated time."""

    def next_event_s(self) -> float | None:
        """When something will happen in it next if it is left alone; ``None``: never."""
        ...

    def advance_to(self, now_s: float) -> None:
        """Let everything happen that happens up to this time. Never goes back."""
        ...


class SimulatedClock:
    """Monotonic simulated time in seconds, from 0 unless told otherwise."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._devices: list[Simulated] = []
        self._calls: list[tuple[float, int, Callable[[], None]]] = []
        self._serial = 0

    def attach(self, device: Simulated) -> None:
        """Carry a device along from now on."""
        self._devices.append(device)

    def call_at(self, at_s: float, action: Callable[[], None]) -> None:
        """Run an action when that time is reached, from within whatever wait is then under way."""
        self._serial += 1
        heapq.heappush(self._calls, (at_s, self._serial, action))

    def now_s(self) -> float:
        """Simulated time, s."""
        return self._now_s

    def sleep_s(self, seconds: float) -> None:
        """Let time pass."""
        self.wait_until(lambda: False, self._now_s + max(0.0, seconds))

    def wait_until(self, happened: Callable[[], bool], deadline_s: float) -> bool:
        """Let time pass until something has happened, or the deadline; returns whether it has."""
        while not happened():
            if self._now_s >= deadline_s:
                return False
            self._step(deadline_s)
        return True

    def _step(self, deadline_s: float) -> None:
        """Go to the next event, or to the deadline where none comes before it."""
        events = [t for t in (device.next_event_s() for device in self._devices) if t is not None]
        next_call_s = self._calls[0][0] if self._calls else _FOREVER_S
        target_s = min(deadline_s, next_call_s, *events) if events else min(deadline_s, next_call_s)
        self._now_s = max(self._now_s, target_s)
        for device in self._devices:
            device.advance_to(self._now_s)
        # An action may itself wait (a STOP in the middle of a move): time is then further on when it returns.
        while self._calls and self._calls[0][0] <= self._now_s:
            heapq.heappop(self._calls)[2]()
