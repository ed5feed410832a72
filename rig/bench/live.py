"""The schema of a live bench's file: devices, axes in the rig frame, safety. Units are in the names."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from rig.bench.entries import CommonFile, NotNegative, Positive, Real, Scale, Squareness, Strict
from rig.bench.placement import AxisPlacement
from rig.guard import Box, Offers, Rules, Tolerance
from rig.hal import AXES, AxisLimits, RigLimits
from rig.schema_words import ELSEWHERE

Sign = Annotated[Literal[1, -1], Field(description="-1: counts against the rig frame's direction.")]
Approach = Literal["from_below", "from_above"]
Zoom = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


def _misplaced(at: tuple[str, ...], message: str) -> PydanticCustomError:
    """What is wrong between two parts of a file, told at one of them."""
    return PydanticCustomError(ELSEWHERE, "{message}", {"message": message, "at": at})


class DeviceEntry(BaseModel):
    """A device: its driver, and whatever settings that driver has (`rig.bench.drivers` checks them)."""

    model_config = ConfigDict(frozen=True, extra="allow")

    driver: Annotated[str, Field(min_length=1)]


class Devices(Strict):
    """The devices of the bench. Without a pan the camera looks along Z for ever; without a zoom its lens is fixed."""

    gantry: DeviceEntry
    pan: DeviceEntry | None = None
    zoom: DeviceEntry | None = None
    camera: DeviceEntry


class _LiveAxis(Strict):
    """Where an axis may go, in the rig frame; both ends included."""

    approach: Annotated[Approach, Field(description="From where every place is come to, if there is backlash.")] = (
        "from_below"
    )

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper."""
        raise NotImplementedError

    @property
    def play(self) -> float:
        """How far a place is gone past, in the axis's unit."""
        raise NotImplementedError

    @property
    def overshoot(self) -> float:
        """As `rig.guard.Rules.overshoot` has it."""
        return self.play if self.approach == "from_below" else -self.play

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        lower, upper = self.ends
        if not lower < upper:
            raise ValueError(f"lower ({lower:g}) should be below upper ({upper:g})")
        if self.play >= upper - lower:
            raise ValueError(f"a backlash of {self.play:g} leaves no travel")
        return self


class LiveLinearAxis(_LiveAxis):
    """One axis of the gantry, in the rig frame, mm."""

    lower: Real
    upper: Real
    speed_mm_per_s: Positive
    backlash_mm: NotNegative = 0.0
    sign: Sign = 1
    scale: Scale = 1.0
    offset_mm: Annotated[Real, Field(description="Rig coordinate of the machine's zero.")] = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper, mm."""
        return self.lower, self.upper

    @property
    def play(self) -> float:
        """In mm."""
        return self.backlash_mm


class LivePanAxis(_LiveAxis):
    """The rotation about Y, in the rig frame, degrees. It never wraps: its cable does not either."""

    lower: Real
    upper: Real
    speed_deg_per_s: Positive
    backlash_deg: NotNegative = 0.0
    sign: Sign = 1
    offset_deg: Annotated[Real, Field(description="Pan in the rig frame at the servo's zero.")] = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper, degrees."""
        return self.lower, self.upper

    @property
    def play(self) -> float:
        """In degrees."""
        return self.backlash_deg


class LiveZoomAxis(_LiveAxis):
    """The zoom ring, 0 (widest) to 1 (longest)."""

    lower: Zoom = 0.0
    upper: Zoom = 1.0
    speed_per_s: Positive = 0.5
    backlash: Zoom = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper."""
        return self.lower, self.upper

    @property
    def play(self) -> float:
        """In zoom settings."""
        return self.backlash


class LiveAxes(Strict):
    """All axes of a live bench."""

    x_mm: LiveLinearAxis
    y_mm: LiveLinearAxis
    z_mm: LiveLinearAxis
    theta_deg: LivePanAxis | None = None
    zoom: LiveZoomAxis | None = None
    squareness_deg: Squareness = Squareness()

    @property
    def placement(self) -> AxisPlacement:
        """Machine coordinates to rig frame and back."""
        x, y, z, pan = self.x_mm, self.y_mm, self.z_mm, self.theta_deg
        return AxisPlacement(
            sign=(x.sign, y.sign, z.sign),
            offset_mm=(x.offset_mm, y.offset_mm, z.offset_mm),
            pan_sign=1.0 if pan is None else pan.sign,
            pan_offset_deg=0.0 if pan is None else pan.offset_deg,
        )


class KeepOut(Strict):
    """A box in the rig frame, mm, that the camera's mount must stay out of."""

    name: Annotated[str, Field(min_length=1, max_length=60)] = "object"
    x_mm: tuple[Real, Real]
    y_mm: tuple[Real, Real]
    z_mm: tuple[Real, Real]

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for axis in ("x_mm", "y_mm", "z_mm"):
            low, high = getattr(self, axis)
            if not low < high:
                raise ValueError(f"{axis} should rise from the smallest to the largest value, not {low:g} to {high:g}")
        return self

    def box(self, margin_mm: float) -> Box:
        """The box with its margin."""
        sides = (self.x_mm, self.y_mm, self.z_mm)
        (x0, x1), (y0, y1), (z0, z1) = ((low - margin_mm, high + margin_mm) for low, high in sides)
        return Box(self.name, (x0, y0, z0), (x1, y1, z1), margin_mm)


class Safety(Strict):
    """What the guard demands. Torque policies and time-outs of a STOP are the devices' own settings."""

    keep_out: Annotated[tuple[KeepOut, ...], Field(max_length=50)] = ()
    margin_mm: Annotated[NotNegative, Field(description="Around the keep-out boxes; how far the camera reaches.")] = 0.0
    tolerance_mm: Annotated[Positive, Field(description="Between commanded and read back, per axis.")] = 0.05
    tolerance_deg: Positive = 0.1
    tolerance_zoom: Positive = 0.01
    stale_s: Annotated[Positive, Field(description="A status older than this blocks moves.")] = 1.0
    homing: Annotated[
        Literal["each_session", "remembered", "as_found"], Field(description="What counts as homed (decision 0051).")
    ] = "each_session"
    unhomed_jog_mm: Annotated[NotNegative, Field(description="Longest jog before homing; 0: none.")] = 0.0


class Views(Strict):
    """The lattice of poses that the rig offers as next views."""

    step_mm: Positive = 40.0
    step_deg: Positive = 15.0
    zooms: Annotated[
        tuple[Zoom, ...], Field(max_length=20, description="Left out: the ends of the zoom's travel.")
    ] = ()
    reach: Annotated[int, Field(ge=1, le=5, description="Steps to each side of where the rig stands.")] = 2


class LiveBenchFile(CommonFile):
    """The schema of a live bench's file."""

    kind: Literal["live"]
    devices: Devices
    axes: LiveAxes
    safety: Safety = Safety()
    views: Views = Views()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for device, axis in (("pan", "theta_deg"), ("zoom", "zoom")):
            if (getattr(self.devices, device) is None) != (getattr(self.axes, axis) is None):
                at = ("axes", axis) if getattr(self.devices, device) is None else ("devices", device)
                raise _misplaced(at, f"give both devices.{device} and axes.{axis}, or neither")
        arm_mm = math.hypot(self.mount.x_mm, self.mount.y_mm, self.mount.z_mm)
        if self.safety.keep_out and self.safety.margin_mm < arm_mm:
            raise _misplaced(
                ("safety", "margin_mm"),
                f"{self.safety.margin_mm:g} mm is shorter than the mount's lever arm ({arm_mm:g} mm), on which the "
                "camera swings about: make it as long as camera and lens reach",
            )
        return self

    @property
    def travel(self) -> RigLimits:
        """Limits and speeds; an axis that is not there stays at 0."""
        axes, absent = self.axes, AxisLimits(0.0, 0.0, 1.0)
        x, y, z = (AxisLimits(*axis.ends, axis.speed_mm_per_s) for axis in (axes.x_mm, axes.y_mm, axes.z_mm))
        return RigLimits(
            x,
            y,
            z,
            absent if axes.theta_deg is None else AxisLimits(*axes.theta_deg.ends, axes.theta_deg.speed_deg_per_s),
            absent if axes.zoom is None else AxisLimits(*axes.zoom.ends, axes.zoom.speed_per_s),
            self.timing.settle_s,
            self.timing.exposure_s,
        )

    @property
    def rules(self) -> Rules:
        """What the guard demands."""
        safety, views = self.safety, self.views
        named = {name: getattr(self.axes, name) for name in AXES}
        return Rules(
            travel=self.travel,
            keep_out=tuple(entry.box(safety.margin_mm) for entry in safety.keep_out),
            overshoot={name: axis.overshoot for name, axis in named.items() if axis is not None and axis.play},
            tolerance=Tolerance(safety.tolerance_mm, safety.tolerance_deg, safety.tolerance_zoom),
            stale_s=safety.stale_s,
            homing=safety.homing,
            unhomed_jog_mm=safety.unhomed_jog_mm,
            internals_fixed_by_zoom=self.camera.internals == "fixed_by_zoom",
            offers=Offers(views.step_mm, views.step_deg, views.zooms, views.reach),
        )
