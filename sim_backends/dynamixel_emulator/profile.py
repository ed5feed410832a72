"""Motion with bounded speed and acceleration from any speed to rest at a goal, as a servo's profile gives it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of constant acceleration; ``duration_s``, and acceleration in units per s²."""

    duration_s: float
    acceleration: float


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion that begins at ``start_s`` and ends at rest at ``goal``. Any unit of length; time in seconds."""

    start_s: float
    start: float
    velocity: float
    goal: float
    segments: tuple[Segment, ...] = ()

    @property
    def end_s(self) -> float:
        """When it comes to rest."""
        return self.start_s + sum(s.duration_s for s in self.segments)

    def at(self, now_s: float) -> tuple[float, float]:
        """Position and velocity."""
        left_s, position, velocity = now_s - self.start_s, self.start, self.velocity
        for segment in self.segments:
            step_s = min(left_s, segment.duration_s)
            position += (velocity + segment.acceleration * step_s / 2.0) * step_s
            velocity += segment.acceleration * step_s
            left_s -= step_s
            if left_s <= 0.0:
                return position, velocity
        return self.goal, 0.0


def rest(position: float, now_s: float) -> Motion:
    """Standing still."""
    return Motion(now_s, position, 0.0, position)


def motion(start: float, velocity: float, goal: float, speed: float, acceleration: float, now_s: float) -> Motion:
    """The fastest motion from a place and velocity to rest at ``goal``: speed up, go on, slow down; all positive."""
    overshoot = start + velocity * abs(velocity) / (2.0 * acceleration) - goal
    if overshoot == 0.0 and velocity == 0.0:
        return rest(goal, now_s)
    sign = -1.0 if overshoot > 0.0 else 1.0
    distance, forward = sign * (goal - start), sign * velocity
    peak = min(math.sqrt(max(0.0, acceleration * distance + forward * forward / 2.0)), speed)
    up = Segment(abs(peak - forward) / acceleration, sign * math.copysign(acceleration, peak - forward))
    down = Segment(peak / acceleration, -sign * acceleration)
    covered = (forward + peak) / 2.0 * up.duration_s + peak / 2.0 * down.duration_s
    cruise = Segment(max(0.0, distance - covered) / peak if peak > 0.0 else 0.0, 0.0)
    return Motion(now_s, start, velocity, goal, (up, cruise, down))
