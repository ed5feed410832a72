"""The arithmetic of moves, as pure functions: limits, lines of g-code, durations, jog segments.

Machine coordinates in mm, feeds in mm/min. Every line names its units, distances and G53 itself, so that nothing that
others left behind (G20, G91, G92, work offsets) changes where it goes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

from rig.errors import UnreachableError

Triple = tuple[float, float, float]
JOG_SEGMENT_S = 0.25
"""The operator's process may die when a segment has just been sent: motion must end within 0.3 s."""
_SLOWEST_MM_S2 = 50.0
_AXES = ("x", "y", "z")


class Axis(Protocol):
    """What must be known of an axis; `drivers.grbl_settings.GrblAxis` is one."""

    @property
    def lower_mm(self) -> float: ...  # noqa: D102 - told in GrblAxis
    @property
    def upper_mm(self) -> float: ...  # noqa: D102 - told in GrblAxis
    @property
    def feed_mm_per_min(self) -> float: ...  # noqa: D102 - told in GrblAxis


def check_limits(target: Triple, axes: Sequence[Axis]) -> None:
    """Refuse what is not finite or outside the limits; nothing is ever clipped.

    Raises:
        UnreachableError: names axis, value, limits and remedy.
    """
    for name, value, axis in zip(_AXES, target, axes, strict=True):
        if not (math.isfinite(value) and axis.lower_mm <= value <= axis.upper_mm):
            raise UnreachableError(
                f"{name} = {value:.3f} mm is outside its limits {axis.lower_mm:.3f} to {axis.upper_mm:.3f} mm "
                "(machine coordinates). Choose a place inside, or correct the limits in the bench file"
            )


def move_line(target: Triple, feed_mm_per_min: float, axes: Sequence[Axis]) -> str:
    """The line of an absolute move; the last place before bytes are written, so that limits are checked here.

    Raises:
        UnreachableError: see `check_limits`.
    """
    check_limits(target, axes)
    check_limits(rounded(target), axes)
    return f"G21G90G94G53G1{_words(target)}F{feed_mm_per_min:.1f}"


def jog_line(target: Triple, feed_mm_per_min: float, axes: Sequence[Axis] | None) -> str:
    """The line of a jog to a place in machine coordinates: sent twice by mistake, it still goes to that place.

    Args:
        target: where to.
        feed_mm_per_min: how fast.
        axes: for the limits; ``None``: not homed, limits mean nothing, and the caller has bounded the step.

    Raises:
        UnreachableError: see `check_limits`.
    """
    if axes is not None:
        check_limits(target, axes)
        check_limits(rounded(target), axes)
    elif not all(map(math.isfinite, target)):
        raise UnreachableError(f"a jog to {target} is not finite")
    return f"$J=G21G90G53{_words(target)}F{feed_mm_per_min:.1f}"


def rounded(target: Triple) -> Triple:
    """As it will be written: to a thousandth of a millimetre."""
    return (round(target[0], 3) + 0.0, round(target[1], 3) + 0.0, round(target[2], 3) + 0.0)


def _words(target: Triple) -> str:
    """Fixed point, three digits: GRBL reads no exponents."""
    return "".join(f"{letter}{value:.3f}" for letter, value in zip("XYZ", rounded(target), strict=True))


def path_feed(start: Triple, target: Triple, axes: Sequence[Axis]) -> float:
    """The largest feed along a straight move at which no axis exceeds its own, mm/min."""
    length = math.dist(start, target)
    feeds = [
        axis.feed_mm_per_min * length / abs(b - a)
        for a, b, axis in zip(start, target, axes, strict=True)
        if abs(b - a) > 1e-9
    ]
    return min(feeds, default=min(axis.feed_mm_per_min for axis in axes))


def path_accel(start: Triple, target: Triple, firmware: Mapping[int, float]) -> float:
    """The acceleration along a straight move, mm/s², by $120 to $122; a cautious guess where they were not told."""
    length = math.dist(start, target)
    accels = [
        firmware.get(120 + index, _SLOWEST_MM_S2) * length / abs(b - a)
        for index, (a, b) in enumerate(zip(start, target, strict=True))
        if abs(b - a) > 1e-9
    ]
    return max(min(accels, default=_SLOWEST_MM_S2), 1e-3)


def firmware_feed(start: Triple, target: Triple, feed_mm_per_min: float, firmware: Mapping[int, float]) -> float:
    """The feed that the firmware will really go: $110 to $112 bound each axis."""
    length = math.dist(start, target)
    bounds = [
        firmware[110 + index] * length / abs(b - a)
        for index, (a, b) in enumerate(zip(start, target, strict=True))
        if abs(b - a) > 1e-9 and firmware.get(110 + index, 0.0) > 0.0
    ]
    return min([feed_mm_per_min, *bounds])


def duration_s(length_mm: float, feed_mm_per_min: float, accel_mm_s2: float) -> float:
    """Seconds of a trapezoid from rest to rest."""
    speed = feed_mm_per_min / 60.0
    if length_mm * accel_mm_s2 >= speed**2:
        return length_mm / speed + speed / accel_mm_s2
    return 2.0 * math.sqrt(length_mm / accel_mm_s2)


def segment_mm(feed_mm_per_min: float, accel_mm_s2: float) -> float:
    """How far a jog gets from rest to rest in `JOG_SEGMENT_S`."""
    speed = feed_mm_per_min / 60.0
    if speed >= accel_mm_s2 * JOG_SEGMENT_S / 2.0:
        return accel_mm_s2 * JOG_SEGMENT_S**2 / 4.0
    return speed * (JOG_SEGMENT_S - speed / accel_mm_s2)


def jog_targets(start: Triple, target: Triple, longest_mm: float) -> list[Triple]:
    """The ends of equal segments from a place to another."""
    count = max(1, math.ceil(math.dist(start, target) / longest_mm - 1e-9))
    ends = [_between(start, target, number / count) for number in range(1, count)]
    return [*ends, target]


def _between(start: Triple, target: Triple, share: float) -> Triple:
    return (
        start[0] + (target[0] - start[0]) * share,
        start[1] + (target[1] - start[1]) * share,
        start[2] + (target[2] - start[2]) * share,
    )


def off_path_mm(start: Triple, target: Triple, place: Triple) -> float:
    """Distance of a place from the straight line between two others."""
    length = math.dist(start, target)
    if length < 1e-9:
        return math.dist(start, place)
    along = sum((b - a) * (p - a) for a, b, p in zip(start, target, place, strict=True)) / length
    nearest = _between(start, target, min(max(along / length, 0.0), 1.0))
    return math.dist(nearest, place)


def apart_mm(a: Triple, b: Triple) -> float:
    """The largest difference of any axis."""
    return max(abs(u - v) for u, v in zip(a, b, strict=True))
