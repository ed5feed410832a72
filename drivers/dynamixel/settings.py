"""What a bench file says of a servo axis, and the scale between its positions and the servo's ticks."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.dynamixel.table import (
    ACCELERATION_DEG_PER_S2,
    FURTHEST_TICKS,
    MODELS,
    TICKS_PER_TURN,
    VELOCITY_DEG_PER_S,
    WATCHDOG_UNIT_MS,
)

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
"""Bits per second that both the servos and the SDK know."""

_PROFILE_MOST = 32767

Real = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
Torque = Literal["hold", "release"]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class _Geared(_Strict):
    """A shaft behind a gear: from degrees at the axis to ticks of the servo, whole turns counted."""

    gear_ratio: Annotated[Positive, Field(description="Turns of the servo for one turn of the axis.")] = 1.0
    sign: Annotated[Literal[1, -1], Field(description="-1: the axis turns against the servo's count.")] = 1
    zero_ticks: Annotated[int, Field(ge=-FURTHEST_TICKS, le=FURTHEST_TICKS, description="The servo's count at 0°.")] = (
        TICKS_PER_TURN // 2
    )

    @property
    def ticks_per_deg(self) -> float:
        """Ticks for one degree of the axis, without sign."""
        return self.gear_ratio * TICKS_PER_TURN / 360.0

    def ticks_at(self, angle_deg: float) -> float:
        """Ticks, not rounded, at an angle of the axis."""
        return self.zero_ticks + self.sign * self.ticks_per_deg * angle_deg

    def angle_deg_at(self, ticks: float) -> float:
        """The inverse of `ticks_at`."""
        return (ticks - self.zero_ticks) / (self.sign * self.ticks_per_deg)


class PanRole(_Geared):
    """The servo turns the camera about Y. Positions are degrees."""

    kind: Literal["pan"]
    lower_deg: Real
    upper_deg: Real

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.lower_deg < self.upper_deg:
            raise ValueError(f"lower_deg ({self.lower_deg:g}) should be below upper_deg ({self.upper_deg:g})")
        return self

    @property
    def lower(self) -> float:
        """Lowest position, degrees."""
        return self.lower_deg

    @property
    def upper(self) -> float:
        """Highest position, degrees."""
        return self.upper_deg

    def to_angle_deg(self, position: float) -> float:
        """Angle of the axis at a position."""
        return position

    def to_position(self, angle_deg: float) -> float:
        """Position at an angle of the axis."""
        return angle_deg


class ZoomRole(_Geared):
    """The servo turns a zoom ring. Positions are zoom settings 0 (widest) to 1 (longest)."""

    kind: Literal["zoom"]
    table: Annotated[
        tuple[tuple[float, float], ...],
        Field(min_length=2, max_length=100, description="Pairs of zoom setting and angle of the ring in degrees."),
    ]

    @model_validator(mode="after")
    def _monotone(self) -> Self:
        zooms, angles = self._columns
        if zooms[0] != 0.0 or zooms[-1] != 1.0 or not _rises(zooms):
            raise ValueError(f"the zoom settings of the table should rise from 0 to 1, not {_list(zooms)}")
        if not (_rises(angles) or _rises(angles[::-1])):
            raise ValueError(f"the angles of the table should all rise or all fall, not {_list(angles)}")
        return self

    @property
    def _columns(self) -> tuple[list[float], list[float]]:
        return [zoom for zoom, _ in self.table], [angle for _, angle in self.table]

    @property
    def lower(self) -> float:
        """Lowest position."""
        return 0.0

    @property
    def upper(self) -> float:
        """Highest position."""
        return 1.0

    def to_angle_deg(self, position: float) -> float:
        """Angle of the ring at a zoom setting, between the table's entries by straight lines."""
        return _interpolate(position, *self._columns)

    def to_position(self, angle_deg: float) -> float:
        """The inverse of `to_angle_deg`; beyond the table the last line goes on, so that a reading is never hidden."""
        zooms, angles = self._columns
        if angles[0] > angles[-1]:
            zooms, angles = zooms[::-1], angles[::-1]
        return _interpolate(angle_deg, angles, zooms)


Role = Annotated[PanRole | ZoomRole, Field(discriminator="kind")]


def position_at(role: Role, ticks: float) -> float:
    """Position at so many ticks, turns counted in.

    An end of the travel lies between two ticks: an axis that was sent there must not read as beyond it, where no move
    may begin or end, and where there is no zoom setting. By more than a tick it is really beyond.
    """
    position = role.to_position(role.angle_deg_at(ticks))
    end = min(max(position, role.lower), role.upper)
    return end if abs(role.ticks_at(role.to_angle_deg(end)) - ticks) <= 1.0 else position


class DynamixelSettings(_Strict):
    """A Dynamixel servo (protocol 2.0) as pan axis or zoom ring.

    Degrees are degrees of the axis, behind the gear. ``port`` is a path, best one under ``/dev/serial/by-path``, or the
    serial number of the adapter. Axes on one port need the same ``baud``.
    """

    port: Annotated[str, Field(min_length=1)]
    id: Annotated[int, Field(ge=0, le=252)]
    model: Annotated[str, Field(description=f"One of {', '.join(MODELS)}.")]
    mode: Literal["position", "extended", "current_based"]
    role: Role
    baud: int = 57600
    speed_deg_per_s: Positive = 30.0
    acceleration_deg_per_s2: Positive = 60.0
    tolerance_deg: Positive = 0.1
    current_limit_ma: Annotated[
        Positive | None, Field(description="Largest current in mode current_based; left out, the servo's own limit.")
    ] = None
    watchdog_ms: Annotated[
        int, Field(ge=0, le=2540, description="A servo that moves stops when it hears nothing for so long; 0: off.")
    ] = 200
    torque_at_close: Torque = "release"
    torque_at_stop: Torque = "hold"
    torque_at_failed_start: Torque = "release"
    poll_s: Positive = 0.02
    arrive_margin_s: Annotated[Positive, Field(description="A move may take 1.5 times what it should, and this.")] = 2.0
    stuck_s: Annotated[Positive, Field(description="No progress for so long before the goal: stuck.")] = 0.5
    stop_s: Annotated[Positive, Field(description="A STOP is confirmed so long after braking, or not at all.")] = 1.0
    reboot_s: Annotated[Positive, Field(description="A reboot is over within this.")] = 3.0
    latency_timer_ms: Annotated[int, Field(ge=1, le=255, description="Largest latency timer of an FTDI adapter.")] = 16

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        # The later ones rely on what the first has found in order.
        complaint = self._complain_of_choice() or self._complain_of_current()
        complaint = complaint or self._complain_of_range() or self._complain_of_profile()
        if complaint:
            raise ValueError(complaint)
        return self

    def _complain_of_choice(self) -> str:
        if self.model not in MODELS:
            return f"model {self.model!r} is none of {', '.join(MODELS)}"
        if self.baud not in BAUD_RATES:
            return f"baud {self.baud} is none of {', '.join(map(str, BAUD_RATES))}"
        if self.watchdog_ms % WATCHDOG_UNIT_MS:
            return f"watchdog_ms {self.watchdog_ms} should be a multiple of {WATCHDOG_UNIT_MS}"
        return ""

    def _complain_of_current(self) -> str:
        if self.mode == "current_based" and MODELS[self.model].current_unit_ma is None:
            return f"{self.model} measures no current and has no mode current_based"
        if self.mode != "current_based" and self.current_limit_ma is not None:
            return f"current_limit_ma acts in mode current_based only, not in {self.mode}"
        return ""

    def _complain_of_range(self) -> str:
        ends = [self.role.ticks_at(self.role.to_angle_deg(p)) for p in (self.role.lower, self.role.upper)]
        lowest, highest = (0, TICKS_PER_TURN - 1) if self.mode == "position" else (-FURTHEST_TICKS, FURTHEST_TICKS)
        if min(ends) < lowest or max(ends) > highest:
            return (
                f"the travel is {min(ends):.0f} to {max(ends):.0f} ticks, and mode {self.mode} reaches {lowest} to "
                f"{highest}: narrow it, move zero_ticks, or use mode extended"
            )
        if self.tolerance_deg * self.role.ticks_per_deg < 0.5:
            return f"tolerance_deg {self.tolerance_deg:g} is finer than half a tick of the servo"
        return ""

    def _complain_of_profile(self) -> str:
        # A profile register of 0 does not mean "stand still" but "without limit".
        if not 1 <= self.profile_velocity <= _PROFILE_MOST:
            return f"speed_deg_per_s should be {VELOCITY_DEG_PER_S / self.role.gear_ratio:.3g} or more behind this gear"
        if not 1 <= self.profile_acceleration <= _PROFILE_MOST:
            slowest = ACCELERATION_DEG_PER_S2 / self.role.gear_ratio
            return f"acceleration_deg_per_s2 should be {slowest:.3g} or more behind this gear"
        return ""

    @property
    def profile_velocity(self) -> int:
        """In the servo's unit."""
        return int(self.speed_deg_per_s * self.role.gear_ratio / VELOCITY_DEG_PER_S)

    @property
    def profile_acceleration(self) -> int:
        """In the servo's unit."""
        return int(self.acceleration_deg_per_s2 * self.role.gear_ratio / ACCELERATION_DEG_PER_S2)

    @property
    def watchdog_units(self) -> int:
        """The watchdog as the servo wants it."""
        return self.watchdog_ms // WATCHDOG_UNIT_MS


def _rises(values: Sequence[float]) -> bool:
    return all(a < b for a, b in pairwise(values))


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _interpolate(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """Straight lines through the points, the first and last of them going on; ``xs`` rise."""
    at = min(max(bisect_right(xs, x), 1), len(xs) - 1)
    share = (x - xs[at - 1]) / (xs[at] - xs[at - 1])
    return ys[at - 1] + share * (ys[at] - ys[at - 1])
