"""The emulated planner: straight moves in a queue, joined with look-ahead, run as trapezoids of exact constant phases.

Millimetres, mm/s, mm/s². Time is given from outside; between two events the motion is a closed formula, so that it can
be asked for at any time and nothing is stepped.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

Triple = tuple[float, float, float]
_TINY_MM = 1e-9
_TINY_MM_S = 1e-7


@dataclass
class PlannedMove:
    """One straight move. ``entry_mm_s`` is what look-ahead allows at its start."""

    start: Triple
    unit: Triple
    length_mm: float
    nominal_mm_s: float
    accel_mm_s2: float
    junction_mm_s: float
    entry_mm_s: float = 0.0

    def at(self, along_mm: float) -> Triple:
        """The place so far along."""
        return (
            self.start[0] + self.unit[0] * along_mm,
            self.start[1] + self.unit[1] * along_mm,
            self.start[2] + self.unit[2] * along_mm,
        )


@dataclass(frozen=True, slots=True)
class _Phase:
    """Constant acceleration from a time on, over a distance."""

    began_s: float
    ends_s: float
    from_mm: float
    length_mm: float
    speed_mm_s: float
    last_speed_mm_s: float
    accel_mm_s2: float


@dataclass(frozen=True, slots=True)
class MachineLimits:
    """Largest speed and acceleration of each axis, and how far a corner may be cut (GRBL's junction deviation, mm)."""

    speed_mm_s: Triple
    accel_mm_s2: Triple
    junction_deviation_mm: float


class Planner:
    """The queue and the motion at its head.

    Args:
        mark: given a move and how far along it is, how far along something will happen on it (a switch trips), or
            ``None``; the motion has an event there.
    """

    def __init__(self, mark: Callable[[PlannedMove, float], float | None]) -> None:
        self._mark = mark
        self._moves: deque[PlannedMove] = deque()
        self._along_mm = 0.0
        self._speed_mm_s = 0.0
        self._phase: _Phase | None = None
        self.position: Triple = (0.0, 0.0, 0.0)
        self.holding = False

    def __len__(self) -> int:
        return len(self._moves)

    @property
    def running(self) -> bool:
        """Motion is under way."""
        return self._phase is not None

    @property
    def end(self) -> Triple:
        """Where the last move in the queue ends: what the g-code parser takes for its place."""
        return self._moves[-1].at(self._moves[-1].length_mm) if self._moves else self.position

    @property
    def velocity(self) -> Triple:
        """Speed of each axis, mm/s."""
        if self._phase is None:
            return (0.0, 0.0, 0.0)
        unit = self._moves[0].unit
        return (unit[0] * self._speed_mm_s, unit[1] * self._speed_mm_s, unit[2] * self._speed_mm_s)

    def add(self, target: Triple, feed_mm_s: float | None, limits: MachineLimits) -> bool:
        """Append a move; False where there is nothing to travel. The look-ahead is done by `replan`."""
        start = self.end
        delta = [b - a for a, b in zip(start, target, strict=True)]
        length = math.sqrt(sum(d * d for d in delta))
        if length < _TINY_MM:
            return False
        unit = (delta[0] / length, delta[1] / length, delta[2] / length)
        fastest = min(v / abs(u) for u, v in zip(unit, limits.speed_mm_s, strict=True) if abs(u) > 1e-12)
        accel = min(a / abs(u) for u, a in zip(unit, limits.accel_mm_s2, strict=True) if abs(u) > 1e-12)
        nominal = fastest if feed_mm_s is None else min(feed_mm_s, fastest)
        junction = _junction(self._moves[-1], unit, accel, limits) if self._moves else 0.0
        self._moves.append(PlannedMove(start, unit, length, nominal, accel, min(junction, nominal)))
        return True

    def start(self, now_s: float) -> None:
        """Set the queue in motion, or go on after a hold."""
        self.holding = False
        self.replan(now_s)

    def hold(self, now_s: float) -> None:
        """Slow down along the path and stop."""
        self.holding = True
        if self.running:
            self.replan(now_s)

    def replan(self, now_s: float) -> None:
        """Take the moves and the wish to hold into account, from the present place and speed."""
        self._look_ahead()
        self._phase = self._next_phase(now_s)

    def flush(self) -> None:
        """Forget all moves and stop dead."""
        self._moves.clear()
        self._along_mm = self._speed_mm_s = 0.0
        self._phase, self.holding = None, False

    def next_event_s(self) -> float | None:
        """When the present phase ends."""
        return None if self._phase is None else self._phase.ends_s

    def advance_to(self, now_s: float) -> None:
        """Move on within the present phase, or to its end; `next_event_s` must not be passed by."""
        phase = self._phase
        if phase is None:
            return
        if now_s >= phase.ends_s:
            self._along_mm, self._speed_mm_s = phase.from_mm + phase.length_mm, phase.last_speed_mm_s
            self.position = self._moves[0].at(self._along_mm)
            self._finish(phase.ends_s)
            return
        seconds = max(0.0, now_s - phase.began_s)
        self._speed_mm_s = max(0.0, phase.speed_mm_s + phase.accel_mm_s2 * seconds)
        self._along_mm = phase.from_mm + phase.speed_mm_s * seconds + 0.5 * phase.accel_mm_s2 * seconds**2
        self.position = self._moves[0].at(self._along_mm)

    def _finish(self, now_s: float) -> None:
        if self._moves[0].length_mm - self._along_mm <= _TINY_MM:
            self.position = self._moves[0].at(self._moves[0].length_mm)
            self._moves.popleft()
            self._along_mm = 0.0
        if not self._moves or (self.holding and self._speed_mm_s <= _TINY_MM_S):
            self._speed_mm_s, self._phase = 0.0, None
        else:
            self._phase = self._next_phase(now_s)

    def _look_ahead(self) -> None:
        """Entry speeds such that every move can still brake for those behind it, and none is entered too fast."""
        after = 0.0
        for move in reversed(self._moves):
            move.entry_mm_s = min(move.junction_mm_s, math.sqrt(after**2 + 2.0 * move.accel_mm_s2 * move.length_mm))
            after = move.entry_mm_s
        speed, along = self._speed_mm_s, self._along_mm
        for index, move in enumerate(self._moves):
            if index:
                move.entry_mm_s = min(move.entry_mm_s, speed)
                speed = move.entry_mm_s
            speed = math.sqrt(speed**2 + 2.0 * move.accel_mm_s2 * (move.length_mm - along))
            along = 0.0

    def _next_phase(self, now_s: float) -> _Phase | None:
        if not self._moves:
            return None
        move, speed = self._moves[0], self._speed_mm_s
        left = move.length_mm - self._along_mm
        leave = self._moves[1].entry_mm_s if len(self._moves) > 1 else 0.0
        accel, length = _profile(speed, leave, left, move, holding=self.holding)
        if length <= 0.0:
            return None
        mark = self._mark(move, self._along_mm)
        if mark is not None and mark - self._along_mm > _TINY_MM:
            length = min(length, mark - self._along_mm)
        last = math.sqrt(max(0.0, speed**2 + 2.0 * accel * length))
        ends_s = now_s + 2.0 * length / (speed + last)
        return _Phase(now_s, ends_s, self._along_mm, length, speed, last, accel)


def _profile(speed: float, leave: float, left: float, move: PlannedMove, *, holding: bool) -> tuple[float, float]:
    """Acceleration of the phase that comes next, and its length."""
    accel = move.accel_mm_s2
    if holding:
        return (-accel, min(left, speed**2 / (2.0 * accel))) if speed > _TINY_MM_S else (0.0, 0.0)
    brake = (speed**2 - leave**2) / (2.0 * accel)
    if brake >= left - _TINY_MM:
        return (leave**2 - speed**2) / (2.0 * left), left
    if speed < move.nominal_mm_s - _TINY_MM_S:
        peak_squared = min(move.nominal_mm_s**2, (2.0 * accel * left + speed**2 + leave**2) / 2.0)
        return accel, min(left, max((peak_squared - speed**2) / (2.0 * accel), 0.0))
    return 0.0, left - max(brake, 0.0)


def _junction(before: PlannedMove, unit: Triple, accel: float, limits: MachineLimits) -> float:
    """The speed at which a corner may be taken (GRBL's planner.c, `plan_buffer_line`)."""
    cosine = -sum(a * b for a, b in zip(before.unit, unit, strict=True))
    if cosine > 0.999999:
        return 0.0
    if cosine < -0.999999:
        return before.nominal_mm_s
    half = math.sqrt(0.5 * (1.0 - cosine))
    return min(before.nominal_mm_s, math.sqrt(accel * limits.junction_deviation_mm * half / (1.0 - half)))
