"""What a bench says about its GRBL-family gantry: port, axes, homing, tolerances and deadlines; strict and frozen."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class GrblAxis(_Strict):
    """One linear axis, in machine coordinates.

    Attributes:
        lower_mm, upper_mm: where it may be sent, both ends included.
        feed_mm_per_min: the axis' own speed in moves and jogs.
    """

    lower_mm: Finite
    upper_mm: Finite
    feed_mm_per_min: Positive

    @model_validator(mode="after")
    def _ends_in_order(self) -> GrblAxis:
        if self.lower_mm >= self.upper_mm:
            raise ValueError(f"lower_mm {self.lower_mm} must be below upper_mm {self.upper_mm}")
        return self


class GrblDeadlines(_Strict):
    """How long the driver waits before it takes something for failed.

    Attributes:
        connect_s: for the first sign of life; boards that restart when the port opens need seconds.
        reply_s: for the ``ok`` of a line.
        status_s: for a status report, each of at most four times.
        home_s: for the whole homing cycle, silence included.
        hold_s: for coming to rest after ``!``; then it is reset regardless.
        reset_s: for the banner after 0x18.
        stall_s: without any progress of a move.
    """

    connect_s: Positive = 5.0
    reply_s: Positive = 2.0
    status_s: Positive = 0.2
    home_s: Positive = 180.0
    hold_s: Positive = 2.0
    reset_s: Positive = 3.0
    stall_s: Positive = 1.5


class GrblSettings(_Strict):
    """The gantry of a bench.

    Attributes:
        port: path under ``/dev/serial/by-path`` or ``by-id``, or the adapter's serial number.
        baud: of the controller.
        dtr: state of the DTR line; boards that restart with it want it off, some with native USB want it on.
        x, y, z: the axes.
        homing: ``required``: no absolute move before `home` has succeeded in this session. ``trusted``: a controller
            that is found idle, and did not restart on connecting, is believed to have been homed. ``none``: the
            machine cannot home, its coordinates hold from connecting on. The last two are explicit overrides.
        unhomed_jog_mm: longest jog that is allowed before homing, e.g. to leave a pressed limit switch; 0: none.
        tolerance_mm: per axis, between target and the position read back.
        stale_s: age from which a status is shown as stale.
        deadlines: see `GrblDeadlines`.
    """

    port: Annotated[str, Field(min_length=1)]
    baud: Annotated[int, Field(gt=0)] = 115200
    dtr: bool = False
    x: GrblAxis
    y: GrblAxis
    z: GrblAxis
    homing: Literal["required", "trusted", "none"] = "required"
    unhomed_jog_mm: NotNegative = 0.0
    tolerance_mm: Positive = 0.05
    stale_s: Positive = 1.0
    deadlines: GrblDeadlines = GrblDeadlines()

    @property
    def axes(self) -> tuple[GrblAxis, GrblAxis, GrblAxis]:
        """X, Y, Z."""
        return (self.x, self.y, self.z)
