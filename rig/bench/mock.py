"""The mock bench: serves an image grid; what its file leaves out comes from the grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from rig.bench.entries import CommonFile, Positive, Real, Scale, Spread, Squareness, Strict
from rig.hal import AxisLimits, RigLimits
from rig.imagegrid import ImageGrid, read_grid

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from sim_backends.image_grid_rig import ImageGridRig

LINEAR_AXES = ("x_mm", "y_mm", "z_mm")
_SLOWEST_MM_PER_S, _CROSSING_S = 100.0, 20.0


class _Axis(Strict):
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
    scale: Scale = 1.0


class PanAxis(_Axis):
    """The rotation about Y, degrees. Limits 360 apart mean that it goes round without end."""

    speed_deg_per_s: Positive | None = None


class ZoomAxis(_Axis):
    """The zoom ring, 0 (widest) to 1 (longest)."""

    lower: Annotated[float, Field(ge=0, le=1)] | None = None
    upper: Annotated[float, Field(ge=0, le=1)] | None = None
    speed_per_s: Positive | None = None


class Axes(Strict):
    """All axes of the bench."""

    x_mm: LinearAxis = LinearAxis()
    y_mm: LinearAxis = LinearAxis()
    z_mm: LinearAxis = LinearAxis()
    theta_deg: PanAxis = PanAxis()
    zoom: ZoomAxis = ZoomAxis()
    squareness_deg: Squareness = Squareness()


class BenchFile(CommonFile):
    """The schema of a mock bench's file."""

    kind: Literal["mock"]
    grid: Annotated[str | None, Field(min_length=1, description="Image grid, from the bench file's folder.")] = None
    axes: Axes = Axes()
    repeatability: Annotated[Spread, Field(description="Noise that the mock rig adds to poses read back.")] = Spread()


def open_mock(
    file: BenchFile,
    grid: Path,
    distance_mm: float,
    *,
    allow_partial: bool = False,
    rng: np.random.Generator | None = None,
    notice: Callable[[str], None] | None = None,
) -> ImageGridRig:
    """Make a mock rig; arguments and errors as of `rig.bench.open_rig`, ``distance_mm`` is about that of the parts."""
    import numpy as np

    from sim_backends.image_grid_rig import ImageGridRig

    pictures = read_grid(grid, allow_partial=allow_partial)
    if notice is not None:
        for message in pictures.left_out:
            notice(message)
    noise = file.repeatability
    return ImageGridRig(
        pictures,
        _limits(file, pictures),
        internals_fixed_by_zoom=(file.camera.internals or pictures.info.internals) == "fixed_by_zoom",
        repeatability_mm=noise.sd_mm,
        repeatability_deg=noise.sd_deg,
        rng=rng or np.random.default_rng(0),
        distance_mm=distance_mm,
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
