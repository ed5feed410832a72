"""Reads bench files (``bench.yaml``) and makes live rigs of them. There is one kind of bench so far, the mock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from recognition.geometry import Mount
from recognition.rates import DetectionRates
from recognition.settings import BenchBounds
from rig.errors import InputError
from rig.hal import AxisLimits, RigLimits
from rig.imagegrid import ImageGrid, read_grid
from rig.schema import BENCH_MAX_BYTES, load_model

if TYPE_CHECKING:
    import numpy as np

    from sim_backends.image_grid_rig import ImageGridRig

Real = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Angle = Annotated[float, Field(gt=0, lt=180, allow_inf_nan=False)]
Skew = Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)]
Tilt = Annotated[float, Field(ge=-20, le=20, allow_inf_nan=False)]

LINEAR_AXES = ("x_mm", "y_mm", "z_mm")
_SLOWEST_MM_PER_S, _CROSSING_S = 100.0, 20.0


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class _Axis(_Strict):
    """Limits of an axis; a mock bench may leave them out, and then has those of its grid."""

    lower: Real | None = None
    upper: Real | None = None

    @model_validator(mode="after")
    def _both_in_order(self) -> Self:
        if (self.lower is None) != (self.upper is None):
            raise ValueError("give both lower and upper, or neither")
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"lower ({self.lower:g}) is above upper ({self.upper:g})")
        return self


class LinearAxis(_Axis):
    """One axis of the gantry, mm."""

    speed_mm_per_s: Positive | None = None
    scale: Annotated[
        float,
        Field(gt=0.5, lt=2, allow_inf_nan=False, description="True millimetres per millimetre that the axis tells."),
    ] = 1.0


class PanAxis(_Axis):
    """The rotation about Y, degrees. Limits 360 apart mean that it goes round without end."""

    speed_deg_per_s: Positive | None = None


class ZoomAxis(_Axis):
    """The zoom ring, 0 (widest) to 1 (longest)."""

    lower: Annotated[float, Field(ge=0, le=1)] | None = None
    upper: Annotated[float, Field(ge=0, le=1)] | None = None
    speed_per_s: Positive | None = None


class Squareness(_Strict):
    """By how much the angles between the linear axes fall short of 90 degrees."""

    xy: Skew = 0.0
    xz: Skew = 0.0
    yz: Skew = 0.0


class Axes(_Strict):
    """All axes of the bench."""

    x_mm: LinearAxis = LinearAxis()
    y_mm: LinearAxis = LinearAxis()
    z_mm: LinearAxis = LinearAxis()
    theta_deg: PanAxis = PanAxis()
    zoom: ZoomAxis = ZoomAxis()
    squareness_deg: Squareness = Squareness()


class MountEntry(_Strict):
    """How the camera hangs (`recognition.geometry.Mount`): lever arm, mm, pan at the rotary's zero, small tilts."""

    x_mm: Real = 0.0
    y_mm: Real = 0.0
    z_mm: Real = 0.0
    pan_zero_deg: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)] = 0.0
    roll_deg: Tilt = 0.0
    pitch_deg: Tilt = 0.0


def _rising(value: tuple[float, float] | None) -> None:
    if value is not None and not value[0] < value[1]:
        raise ValueError(
            f"should rise from the smallest to the largest value, not go from {value[0]:g} to {value[1]:g}"
        )


class CameraEntry(_Strict):
    """What is known of the camera: whether its internals stay when the zoom stays, and weak bounds on its view."""

    internals: Literal["fixed_by_zoom", "change_every_view"] | None = None
    view_angle_deg: Annotated[
        tuple[Angle, Angle] | None, Field(description="Smallest and largest horizontal angle of view.")
    ] = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        _rising(self.view_angle_deg)
        return self


class ObjectEntry(_Strict):
    """What is known of the object before it is known which one it is."""

    distance_mm: Annotated[
        tuple[Positive, Positive] | None, Field(description="Smallest and largest distance from camera to parts.")
    ] = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        _rising(self.distance_mm)
        return self


class Spread(_Strict):
    """Standard deviations of a position, per axis, and of the pan."""

    sd_mm: NotNegative = 0.0
    sd_deg: NotNegative = 0.0


class DetectionEntry(_Strict):
    """How the detector behaves on this bench; what is left out is as on clean pictures (`DetectionRates`)."""

    found: Annotated[Share, Field(description="Share of the visible parts that are found.")] = DetectionRates().found
    clutter: Annotated[Positive, Field(description="False detections in a view.")] = DetectionRates().clutter
    corner_sd_px: Annotated[Positive, Field(description="Standard deviation of a corner coordinate.")] = (
        DetectionRates().corner_sd_px
    )


class Goal(_Strict):
    """How sure the pose must be before a run ends, as standard deviations.

    Left out, the position is wanted to 5 % of the distance to the parts, and of the pan nothing is asked.
    """

    pose_sd_mm: Positive | None = None
    pose_sd_deg: Positive | None = None


class Timing(_Strict):
    """What each view costs besides the travel."""

    settle_s: NotNegative = 0.0
    exposure_s: NotNegative = 0.0


class BenchFile(_Strict):
    """The schema of a bench file."""

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")]
    kind: Literal["mock"]
    grid: Annotated[str | None, Field(min_length=1, description="Image grid, from the bench file's folder.")] = None
    axes: Axes = Axes()
    mount: MountEntry = MountEntry()
    camera: CameraEntry = CameraEntry()
    object: ObjectEntry = ObjectEntry()
    motion: Annotated[Spread, Field(description="How far poses read back may be trusted.")] = Spread()
    repeatability: Annotated[Spread, Field(description="Noise that the mock rig adds to poses read back.")] = Spread()
    detection: DetectionEntry = DetectionEntry()
    goal: Annotated[Goal, Field(description="Options of the command line override it.")] = Goal()
    timing: Timing = Timing()


@dataclass(frozen=True)
class BenchConfig:
    """A bench file, checked, and where its image grid is.

    Attributes:
        name: the bench file, or the grid's folder where there is no bench file; for messages.
        file: what it says.
        grid: folder of the image grid, if one is named.
    """

    name: str
    file: BenchFile
    grid: Path | None = None

    @property
    def mount(self) -> Mount:
        """How the camera hangs on the rig, and how straight the rig's axes are."""
        axes, square = self.file.axes, self.file.axes.squareness_deg
        return Mount(
            **self.file.mount.model_dump(),
            x_scale=axes.x_mm.scale,
            y_scale=axes.y_mm.scale,
            z_scale=axes.z_mm.scale,
            xy_deg=square.xy,
            xz_deg=square.xz,
            yz_deg=square.yz,
        )

    @property
    def rates(self) -> DetectionRates:
        """How the detector behaves on this bench."""
        told = self.file.detection
        return DetectionRates(told.found, told.clutter, told.corner_sd_px)

    @property
    def goal(self) -> Goal:
        """How sure the pose must be where the user asks for nothing else."""
        return self.file.goal

    def bounds(self) -> BenchBounds:
        """What the recogniser may know of distances, the lens and the gantry; what the file leaves out is wide."""
        bounds = BenchBounds(motion_sd_mm=self.file.motion.sd_mm, motion_sd_deg=self.file.motion.sd_deg)
        if self.file.object.distance_mm is not None:
            near, far = self.file.object.distance_mm
            bounds = replace(bounds, distance_min_mm=near, distance_max_mm=far)
        if self.file.camera.view_angle_deg is not None:
            narrow, wide = self.file.camera.view_angle_deg
            bounds = replace(bounds, view_angle_min_deg=narrow, view_angle_max_deg=wide)
        return bounds


def load_bench(path: Path) -> BenchConfig:
    """Read a bench file.

    Raises:
        InputError: with file:line:column of everything that is wrong, and remedies.
    """
    file = load_model(path, BenchFile, BENCH_MAX_BYTES)
    return BenchConfig(str(path), file, None if file.grid is None else path.parent / file.grid)


def default_bench_for_grid(grid_dir: Path) -> BenchConfig:
    """A mock bench for an image grid that comes without a bench file: limits and speeds from the grid, wide bounds."""
    return BenchConfig(str(grid_dir), BenchFile.model_validate({"schema": 1, "kind": "mock"}), grid_dir)


def open_rig(
    config: BenchConfig,
    grid: Path | None = None,
    *,
    allow_partial: bool = False,
    rng: np.random.Generator | None = None,
    notice: Callable[[str], None] | None = None,
) -> ImageGridRig:
    """Make a live rig of a bench.

    Args:
        config: the bench.
        grid: another image grid than the bench's own.
        allow_partial: go on where the grid lacks pictures.
        rng: for the noise of the poses read back; ``None``: one that always starts the same.
        notice: is told, one call each, what the grid lacks.

    Raises:
        InputError: there is no grid, it is faulty (`ImageGridError`), or none of its pictures is within the limits.
    """
    import numpy as np

    from sim_backends.image_grid_rig import ImageGridRig

    folder = grid or config.grid
    if folder is None:
        raise InputError("the bench names no image grid", where=config.name, remedy="Give one with --grid DIR")
    pictures = read_grid(folder, allow_partial=allow_partial)
    if notice is not None:
        for message in pictures.left_out:
            notice(message)
    bounds, noise = config.bounds(), config.file.repeatability
    return ImageGridRig(
        pictures,
        _limits(config.file, pictures),
        internals_fixed_by_zoom=(config.file.camera.internals or pictures.info.internals) == "fixed_by_zoom",
        repeatability_mm=noise.sd_mm,
        repeatability_deg=noise.sd_deg,
        rng=rng or np.random.default_rng(0),
        # Distances are known to a factor only: the geometric mean is their middle.
        distance_mm=(bounds.distance_min_mm * bounds.distance_max_mm) ** 0.5,
    )


def _limits(file: BenchFile, grid: ImageGrid) -> RigLimits:
    """The bench's limits and speeds; what it leaves out, from the grid."""
    from sim_backends.image_grid_rig import Speeds, limits_of

    axes, values = file.axes, grid.axis_values()
    # A grid may be of a model on a table or of a castle: nobody waits minutes for a mock gantry.
    extent = max(values[axis][-1] - values[axis][0] for axis in LINEAR_AXES)
    speeds = Speeds(linear_mm_per_s=max(_SLOWEST_MM_PER_S, extent / _CROSSING_S))
    found = limits_of(grid, speeds, file.timing.settle_s, file.timing.exposure_s)
    return replace(
        found,
        x_mm=_axis(axes.x_mm, axes.x_mm.speed_mm_per_s, found.x_mm),
        y_mm=_axis(axes.y_mm, axes.y_mm.speed_mm_per_s, found.y_mm),
        z_mm=_axis(axes.z_mm, axes.z_mm.speed_mm_per_s, found.z_mm),
        theta_deg=_axis(axes.theta_deg, axes.theta_deg.speed_deg_per_s, found.theta_deg),
        zoom=_axis(axes.zoom, axes.zoom.speed_per_s, found.zoom),
    )


def _axis(told: _Axis, speed: float | None, found: AxisLimits) -> AxisLimits:
    if told.lower is not None and told.upper is not None:
        found = replace(found, lower=told.lower, upper=told.upper)
    return found if speed is None else replace(found, speed_per_s=speed)
