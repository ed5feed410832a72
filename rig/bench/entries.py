"""What both kinds of bench files have in common: mount, camera, object, detector, goal, timing."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from recognition.rates import DetectionRates

Real = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Angle = Annotated[float, Field(gt=0, lt=180, allow_inf_nan=False)]
Skew = Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)]
Tilt = Annotated[float, Field(ge=-20, le=20, allow_inf_nan=False)]
Scale = Annotated[
    float,
    Field(gt=0.5, lt=2, allow_inf_nan=False, description="True millimetres per millimetre that the axis tells."),
]


class Strict(BaseModel):
    """Frozen, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class MountEntry(Strict):
    """How the camera hangs (`recognition.geometry.Mount`): lever arm, mm, pan at the rotary's zero, small tilts."""

    x_mm: Real = 0.0
    y_mm: Real = 0.0
    z_mm: Real = 0.0
    pan_zero_deg: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)] = 0.0
    roll_deg: Tilt = 0.0
    pitch_deg: Tilt = 0.0


class Squareness(Strict):
    """By how much the angles between the linear axes fall short of 90 degrees."""

    xy: Skew = 0.0
    xz: Skew = 0.0
    yz: Skew = 0.0


def _rising(value: tuple[float, float] | None) -> None:
    if value is not None and not value[0] < value[1]:
        raise ValueError(
            f"should rise from the smallest to the largest value, not go from {value[0]:g} to {value[1]:g}"
        )


class CameraEntry(Strict):
    """What is known of the camera: whether its internals stay when the zoom stays, and weak bounds on its view."""

    internals: Literal["fixed_by_zoom", "change_every_view"] | None = None
    view_angle_deg: Annotated[
        tuple[Angle, Angle] | None, Field(description="Smallest and largest horizontal angle of view.")
    ] = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        _rising(self.view_angle_deg)
        return self


class ObjectEntry(Strict):
    """What is known of the object before it is known which one it is."""

    distance_mm: Annotated[
        tuple[Positive, Positive] | None, Field(description="Smallest and largest distance from camera to parts.")
    ] = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        _rising(self.distance_mm)
        return self


class Spread(Strict):
    """Standard deviations of a position, per axis, and of the pan."""

    sd_mm: NotNegative = 0.0
    sd_deg: NotNegative = 0.0


class DetectionEntry(Strict):
    """How the detector behaves on this bench; what is left out is as on clean pictures (`DetectionRates`)."""

    found: Annotated[Share, Field(description="Share of the visible parts that are found.")] = DetectionRates().found
    clutter: Annotated[Positive, Field(description="False detections in a view.")] = DetectionRates().clutter
    corner_sd_px: Annotated[Positive, Field(description="Standard deviation of a corner coordinate.")] = (
        DetectionRates().corner_sd_px
    )
    measured: Annotated[bool, Field(description="They were counted on views with truth, not guessed.")] = False


class Goal(Strict):
    """How sure the pose must be before a run ends, as standard deviations.

    Left out, the position is wanted to 5 % of the distance to the parts, and of the pan nothing is asked.
    """

    pose_sd_mm: Positive | None = None
    pose_sd_deg: Positive | None = None


class Timing(Strict):
    """What each view costs besides the travel."""

    settle_s: NotNegative = 0.0
    exposure_s: NotNegative = 0.0


class CommonFile(Strict):
    """The keys that every bench file has."""

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")]
    mount: MountEntry = MountEntry()
    camera: CameraEntry = CameraEntry()
    object: ObjectEntry = ObjectEntry()
    motion: Annotated[Spread, Field(description="How far poses read back may be trusted.")] = Spread()
    detection: DetectionEntry = DetectionEntry()
    goal: Annotated[Goal, Field(description="Options of the command line override it.")] = Goal()
    timing: Timing = Timing()
