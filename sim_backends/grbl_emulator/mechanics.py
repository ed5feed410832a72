"""The emulated mechanics: where each axis *really* is, apart from where its motor was told to be.

Between motor and carriage lie backlash, steps lost (a stuck axis, the ends of the frame, a stop without braking), and
an offset that only homing knows. The physical coordinate of an axis is that of its home switch minus how far off it
stands, mm: after an undisturbed homing it equals the machine coordinate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Triple = tuple[float, float, float]
OVERTRAVEL_MM = 3.0
"""How far behind the switches the frame ends."""


@dataclass
class PhysicalAxis:
    """One axis.

    Attributes:
        low_mm, high_mm: where its two limit switches trip.
        backlash_mm: how far the motor turns for nothing when it turns round. Pushed upwards the carriage stands at the
            motor's place, pushed downwards so much above it.
        carriage_mm: where it is.
        offset_mm: physical coordinate minus motor coordinate, backlash apart.
    """

    low_mm: float
    high_mm: float
    backlash_mm: float = 0.0
    carriage_mm: float = 0.0
    offset_mm: float = 0.0
    motor_mm: float = 0.0
    stuck: bool = False
    lost_mm: float = 0.0

    def follow(self, motor_mm: float) -> None:
        """The motor turns to a place, in one direction."""
        moved, self.motor_mm = motor_mm - self.motor_mm, motor_mm
        if self.stuck:
            self._lose(-moved)
            return
        ends = (self.low_mm - OVERTRAVEL_MM, self.high_mm + OVERTRAVEL_MM)
        if moved > 0.0:
            pushed = max(self.carriage_mm, motor_mm + self.offset_mm)
        else:
            pushed = min(self.carriage_mm, motor_mm + self.offset_mm + self.backlash_mm)
        self.carriage_mm = min(max(pushed, ends[0]), ends[1])
        self._lose(self.carriage_mm - pushed)

    def _lose(self, steps_mm: float) -> None:
        self.offset_mm += steps_mm
        self.lost_mm += abs(steps_mm)

    def coast(self, distance_mm: float) -> None:
        """The carriage runs on while the motor has stopped without braking."""
        self._lose(distance_mm)
        self.carriage_mm += distance_mm

    def rename(self, motor_mm: float) -> None:
        """The controller calls the present place something else."""
        self.offset_mm += self.motor_mm - motor_mm
        self.motor_mm = motor_mm

    @property
    def tripped(self) -> bool:
        """One of its limit switches is pressed."""
        return self.carriage_mm >= self.high_mm - 1e-7 or self.carriage_mm <= self.low_mm + 1e-7

    def motor_at_switch(self, direction: float) -> float | None:
        """Where the motor is when the next switch in a direction trips or comes free; ``None``: never, or by now."""
        if self.stuck or direction == 0.0:
            return None
        play = 0.0 if direction > 0.0 else self.backlash_mm
        places = [switch - self.offset_mm - play for switch in (self.low_mm, self.high_mm)]
        ahead = [place for place in places if (place - self.motor_mm) * direction > 1e-7]
        return min(ahead, key=lambda place: abs(place - self.motor_mm)) if ahead else None


class Mechanics:
    """The three axes."""

    def __init__(
        self,
        switches_mm: tuple[tuple[float, float], ...],
        *,
        backlash_mm: Triple = (0.0, 0.0, 0.0),
        start_mm: Triple | None = None,
    ) -> None:
        """Set the machine up.

        Args:
            switches_mm: where the lower and the upper limit switch of X, Y and Z trip.
            backlash_mm: of each axis.
            start_mm: where the carriages stand when power comes for the first time; the middle where not told.
        """
        self.axes = [PhysicalAxis(low, high, b) for (low, high), b in zip(switches_mm, backlash_mm, strict=True)]
        for index, axis in enumerate(self.axes):
            middle = (axis.low_mm + axis.high_mm) / 2.0
            axis.carriage_mm = axis.offset_mm = middle if start_mm is None else start_mm[index]
        self.lowest_mm, self.highest_mm = list(self.position), list(self.position)

    @property
    def position(self) -> Triple:
        """Where the carriages are: the truth."""
        return (self.axes[0].carriage_mm, self.axes[1].carriage_mm, self.axes[2].carriage_mm)

    def follow(self, motors: Triple) -> None:
        """All motors turn to a place, each in one direction."""
        for axis, motor in zip(self.axes, motors, strict=True):
            axis.follow(motor)
        self._note()

    def stop_dead(self, velocity_mm_s: Triple) -> None:
        """The motors stop without braking; what moves runs on a little: steps are lost."""
        for axis, speed in zip(self.axes, velocity_mm_s, strict=True):
            axis.coast(0.01 * speed)
        self._note()

    def rename(self, motors: Triple) -> None:
        """The controller takes the present place for this one."""
        for axis, motor in zip(self.axes, motors, strict=True):
            axis.rename(motor)

    def tripped(self) -> tuple[bool, bool, bool]:
        """The limit switches of X, Y, Z."""
        return (self.axes[0].tripped, self.axes[1].tripped, self.axes[2].tripped)

    def along_at_switch(self, start: Triple, unit: Triple, along_mm: float) -> float | None:
        """How far along a straight move the next switch changes."""
        best = math.inf
        for index, axis in enumerate(self.axes):
            motor = axis.motor_at_switch(unit[index])
            if motor is not None:
                along = (motor - start[index]) / unit[index]
                best = along if along_mm < along < best else best
        return None if math.isinf(best) else best

    def _note(self) -> None:
        """The monitor asks later how far the carriages ever went."""
        for index, place in enumerate(self.position):
            self.lowest_mm[index] = min(self.lowest_mm[index], place)
            self.highest_mm[index] = max(self.highest_mm[index], place)


def switches_of(travel_mm: Triple, homes_down: int) -> tuple[tuple[float, float], ...]:
    """Switches that fit a controller's settings: home at the one end, and 2 mm behind the travel at the other.

    Args:
        travel_mm: $130 to $132.
        homes_down: $23, the axes that home towards their negative end.
    """
    return tuple(
        (-travel, 2.0) if homes_down & (1 << index) else (-travel - 2.0, 0.0) for index, travel in enumerate(travel_mm)
    )
