"""A rig that serves pictures which were captured beforehand: its reachable poses are the cells of an image grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rig.errors import InputError, UnreachableError
from rig.hal import AXES, AxisLimits, Frame, RigLimits, RigPose, travel_seconds
from rig.imagegrid import GridFrame, ImageGrid
from rig.imagegrid.entry import pose_key

ZOOM_AS_DEG = 60.0
"""What the whole range of zoom counts for when the nearest cell is looked for: about what it changes of a picture."""
_SCATTER_SD = 6.0


@dataclass(frozen=True, slots=True)
class Speeds:
    """How fast the mock rig pretends to be; the linear axes share one speed."""

    linear_mm_per_s: float = 100.0
    theta_deg_per_s: float = 30.0
    zoom_per_s: float = 0.5


class ImageGridRig:
    """A ``rig.hal.Rig`` on an image grid, a full lattice or an irregular set of places.

    With repeatability noise the pictures stay what they are, and the pose *read back* after each move is off by normal
    deviates on x, y, z (``repeatability_mm``) and theta (``repeatability_deg``), drawn anew for each move. ``pose`` and
    ``Frame.rig_pose`` are what is read back, ``Frame.commanded`` is the cell. Zoom is read back as commanded.

    The pan wraps (190 is -170, and travel takes the short way) where its limits span a full circle.
    """

    def __init__(
        self,
        grid: ImageGrid,
        limits: RigLimits,
        *,
        internals_fixed_by_zoom: bool,
        repeatability_mm: float = 0.0,
        repeatability_deg: float = 0.0,
        rng: np.random.Generator | None = None,
        distance_mm: float = 1000.0,
        start: RigPose | None = None,
    ) -> None:
        """Set the rig up.

        Args:
            grid: the pictures; cells outside the limits are not offered.
            limits: travel and speeds.
            internals_fixed_by_zoom: whether the grid's camera had the same internals whenever it had the same zoom.
            repeatability_mm: standard deviation of the position read back, per axis.
            repeatability_deg: standard deviation of the pan read back.
            rng: draws the noise; needed if there is any.
            distance_mm: of what is looked at, roughly; says how many millimetres count like a degree in ``nearest``.
            start: a cell to stand at first; ``None``: the first picture that is within the limits.

        Raises:
            InputError: no cell lies within the limits, or the noise is not a number or has no generator.
            UnreachableError: ``start`` is no cell.
        """
        self._grid, self._limits, self._fixed = grid, limits, internals_fixed_by_zoom
        self._noise = (repeatability_mm, repeatability_deg)
        self._rng = rng
        self._check_noise()
        self._wraps = limits.theta_deg.upper - limits.theta_deg.lower >= 360.0 - 1e-9
        self._frames = tuple(frame for frame in grid.frames if self._outside(frame.pose) is None)
        if not self._frames:
            raise InputError(
                "none of the grid's pictures was taken within the limits",
                where=str(grid.folder),
                remedy=f"Widen the axis limits; the first picture: {self._outside(grid.frames[0].pose)}",
            )
        self._cells = {pose_key(frame.pose): frame for frame in self._frames}
        self._poses = tuple(frame.pose for frame in self._frames)
        mm_per_deg = math.radians(1.0) * distance_mm
        self._weights = np.array([1.0, 1.0, 1.0, mm_per_deg, mm_per_deg * ZOOM_AS_DEG])
        self._table = np.array([[getattr(pose, axis) for axis in AXES] for pose in self._poses])
        self._sequence, self._clock_s = 0, 0.0
        self._stand_at(self._frames[0] if start is None else self._cell(start))

    @property
    def grid(self) -> ImageGrid:
        """The grid that is served."""
        return self._grid

    @property
    def pose(self) -> RigPose:
        """Where the rig stands, as read back."""
        return self._pose

    @property
    def limits(self) -> RigLimits:
        """Travel and speeds."""
        return self._limits

    @property
    def internals_fixed_by_zoom(self) -> bool:
        """True if the same zoom setting always means the same internals."""
        return self._fixed

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        """All cells within the limits, in the grid's order."""
        return self._poses

    def nearest(self, wish: RigPose) -> RigPose:
        """The cell whose picture is most like that at the wish.

        Distances mix by what moves in the picture: a degree of pan counts like the millimetres that it sweeps at
        ``distance_mm``, the whole range of zoom like ``ZOOM_AS_DEG`` degrees.

        Raises:
            UnreachableError: the wish is not finite or outside the limits.
        """
        self._refuse_outside(wish)
        return self._poses[int(np.argmin(self._distances(wish)))]

    def move_to(self, pose: RigPose) -> RigPose:
        """Move to a cell at once; the rig's own clock goes on by the time that the move takes.

        Raises:
            UnreachableError: outside the limits, or no cell; names axis, value and limit or nearest cell.
        """
        frame = self._cell(pose)
        self._clock_s += self.travel_s(self._pose, frame.pose)
        self._stand_at(frame)
        return self._pose

    def capture(self) -> Frame:
        """Load the picture of the present cell; its digest is checked now. Nothing is kept in memory.

        Raises:
            ImageGridError: the picture is missing or damaged.
            ImageError: it is not a picture that can be used.
        """
        image = self._grid.load(self._at)
        self._sequence += 1
        return Frame(image, self._pose, self._at.pose, self._at.file, self._sequence, self._clock_s)

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        """Seconds from one pose to the other, settling and exposure included."""
        if self._wraps:
            turn = (end.theta_deg - start.theta_deg + 180.0) % 360.0 - 180.0
            end = replace(end, theta_deg=start.theta_deg + turn)
        return travel_seconds(self._limits, start, end)

    def close(self) -> None:
        """Nothing to release."""

    def __enter__(self) -> ImageGridRig:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

    def _check_noise(self) -> None:
        for name, sd in zip(("repeatability_mm", "repeatability_deg"), self._noise, strict=True):
            if not (math.isfinite(sd) and sd >= 0.0):
                raise InputError(f"{sd} is no standard deviation", where=name, remedy="Give 0 or more")
        if any(self._noise) and self._rng is None:
            raise InputError(
                "noise needs a random generator", where="rng", remedy="Pass numpy.random.default_rng(seed)"
            )

    def _stand_at(self, frame: GridFrame) -> None:
        self._at, self._pose = frame, frame.pose
        if self._rng is not None and any(self._noise):
            mm, deg = self._noise
            dx, dy, dz, turn = (self._rng.standard_normal(4) * (mm, mm, mm, deg)).tolist()
            at = frame.pose
            self._pose = RigPose(at.x_mm + dx, at.y_mm + dy, at.z_mm + dz, at.theta_deg + turn, at.zoom)

    def _cell(self, pose: RigPose) -> GridFrame:
        self._refuse_outside(pose)
        frame = self._cells.get(pose_key(pose))
        if frame is None:
            near = self.nearest(pose)
            off = [f"{a} = {getattr(pose, a):g} (there {getattr(near, a):g})" for a in AXES if _differ(pose, near, a)]
            raise UnreachableError(
                f"no picture was taken there: the nearest of {len(self._poses)} cells differs in {', '.join(off)}. "
                "Ask nearest() first"
            )
        return frame

    def _distances(self, wish: RigPose) -> npt.NDArray[np.float64]:
        gaps = self._table - np.array([getattr(wish, axis) for axis in AXES])
        if self._wraps:
            gaps[:, 3] = (gaps[:, 3] + 180.0) % 360.0 - 180.0
        return np.asarray(np.linalg.norm(gaps * self._weights, axis=1))

    def _refuse_outside(self, pose: RigPose) -> None:
        outside = self._outside(pose)
        if outside is not None:
            raise UnreachableError(f"{outside}. Choose a pose within the limits")

    def _outside(self, pose: RigPose) -> str | None:
        """Which axis of a pose is beyond its limits, in words; what is read back may scatter beyond them."""
        mm, deg = (_SCATTER_SD * sd for sd in self._noise)
        slack = {"x_mm": mm, "y_mm": mm, "z_mm": mm, "theta_deg": deg}
        for axis in AXES:
            value, limit = getattr(pose, axis), getattr(self._limits, axis)
            if axis == "theta_deg" and self._wraps and math.isfinite(value):
                continue
            more = slack.get(axis, 0.0) + 1e-9
            # Written so that a value which is not a number is outside.
            if not (limit.lower - more <= value <= limit.upper + more):
                return f"{axis} = {value:g} is outside {limit.lower:g} .. {limit.upper:g}"
        return None


def limits_of(
    grid: ImageGrid, speeds: Speeds | None = None, settle_s: float = 0.0, exposure_s: float = 0.0
) -> RigLimits:
    """Limits that just hold all cells of a grid; the pan's are a full circle where the cells span most of one."""
    fast = speeds or Speeds()
    values = grid.axis_values()
    by_axis = dict.fromkeys(AXES, fast.linear_mm_per_s) | {
        "theta_deg": fast.theta_deg_per_s,
        "zoom": fast.zoom_per_s,
    }
    ends = {axis: (values[axis][0], values[axis][-1]) for axis in AXES}
    if ends["theta_deg"][1] - ends["theta_deg"][0] > 270.0:
        ends["theta_deg"] = (-180.0, 180.0)
    limits = {axis: AxisLimits(*ends[axis], by_axis[axis]) for axis in AXES}
    return RigLimits(**limits, settle_s=settle_s, exposure_s=exposure_s)


def _differ(pose: RigPose, other: RigPose, axis: str) -> bool:
    return bool(abs(getattr(pose, axis) - getattr(other, axis)) > 1e-6)
