"""Where a gantry can look at an object from: the object's plan, kept clear of, and stations in front of its walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, Mount, Pose4, rig_pose_for
from recognition.modelbase import ObjectModel
from rig.hal import AxisLimits, RigLimits, RigPose
from sim_backends.walls import Wall, walls_of

FloatArray = npt.NDArray[np.float64]

CLEAR_MM = 60.0
"""How near a camera may come to a wall."""


@dataclass(frozen=True)
class Plan:
    """The object from above: its walls as segments ``(n, 2, 2)`` of (x, z), object frame, mm."""

    segments: FloatArray

    @staticmethod
    def of(walls: Sequence[Wall]) -> Plan:
        """The plan of vertical walls: their upper edges."""
        return Plan(np.array([wall.corners_mm[:2][:, [0, 2]] for wall in walls]).reshape(-1, 2, 2))

    def distance_mm(self, points: FloatArray) -> FloatArray:
        """Distance ``(m,)`` of points ``(m, 2)`` to the nearest wall."""
        a, step = self.segments[:, 0], self.segments[:, 1] - self.segments[:, 0]
        offset = points[:, None] - a
        along = np.clip((offset * step).sum(-1) / np.maximum((step**2).sum(-1), 1e-12), 0, 1)
        return np.asarray(np.linalg.norm(offset - along[..., None] * step, axis=-1).min(axis=1))

    def inside(self, points: FloatArray) -> npt.NDArray[np.bool_]:
        """``(m,)``: points ``(m, 2)`` enclosed by walls. Nothing is enclosed by walls that do not close a ring."""
        if not self._closed():
            return np.zeros(len(points), dtype=bool)
        (ax, az), (bx, bz) = (self.segments[:, k].T for k in (0, 1))
        x, z = points[:, :1], points[:, 1:]
        straddles = (az > z) != (bz > z)
        with np.errstate(divide="ignore", invalid="ignore"):
            hit = ax + (z - az) * (bx - ax) / (bz - az)
        return np.asarray((straddles & (hit > x)).sum(axis=1) % 2 == 1)

    def clear_between(self, start: FloatArray, points: FloatArray) -> npt.NDArray[np.bool_]:
        """``(m,)``: no wall stands between ``start`` ``(2,)`` and points ``(m, 2)``."""
        a, b = self.segments[:, 0], self.segments[:, 1]
        ends = points[:, None]

        def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
            return np.asarray((q - p)[..., 0] * (r - p)[..., 1] - (q - p)[..., 1] * (r - p)[..., 0])

        apart = side(start, ends, a) * side(start, ends, b) < 0
        across = side(a, b, start) * side(a, b, ends) < 0
        return np.asarray(~(apart & across).any(axis=1))

    def free(self, points: FloatArray, clear_mm: float = CLEAR_MM) -> npt.NDArray[np.bool_]:
        """``(m,)``: points ``(m, 2)`` outside the object and at least ``clear_mm`` from its walls."""
        return np.asarray((self.distance_mm(points) >= clear_mm - 1e-6) & ~self.inside(points))

    def _closed(self) -> bool:
        """Every end of a wall meets the end of another one."""
        ends = self.segments.reshape(-1, 2)
        gaps = np.linalg.norm(ends[:, None] - ends[None], axis=-1)
        tolerance = 1e-3 * max(float(np.ptp(ends, axis=0).max()), 1.0)
        return bool(np.all((gaps < tolerance).sum(axis=1) % 2 == 0))


def facing_deg(wall: Wall) -> float:
    """The pan (object frame) at which a camera looks straight at the wall."""
    return float(np.degrees(np.arctan2(wall.normal[0], -wall.normal[2])))


def viewing_poses(
    object_model: ObjectModel,
    object_in_rig: Pose4,
    distances_mm: Sequence[float],
    *,
    step_mm: float | None = None,
    height_step_mm: float | None = None,
    pans_deg: Sequence[float] = (-20.0, 0.0, 20.0),
    zooms: Sequence[float] = (0.0,),
    clear_mm: float = CLEAR_MM,
    mount: Mount | None = None,
) -> list[RigPose]:
    """Poses all around an object that look at its walls.

    Args:
        object_model: walls without parts are not looked at, but kept clear of.
        object_in_rig: object -> rig.
        distances_mm: stand-offs from the wall looked at.
        step_mm: between stations along a wall; ``None``: 0.4 of the stand-off. ``height_step_mm``: the same upwards.
        pans_deg: pans at each station, away from looking straight at the wall; those that look past the object are
            left out.
        zooms: zoom settings at each station.
        clear_mm: stations nearer than this to any wall, inside the object or behind another wall are left out.
        mount: how the camera hangs on the rig.
    """
    walls = walls_of(object_model)
    plan = Plan.of(walls)
    poses: list[RigPose] = []
    for wall in (w for w in walls if w.parts):
        for distance in distances_mm:
            across, up = step_mm or 0.4 * distance, height_step_mm or step_mm or 0.4 * distance
            for centre in _stations(wall, plan, distance, across, up, clear_mm):
                for pan in pans_deg:
                    in_object = CameraPose(facing_deg(wall) + pan, *(float(v) for v in centre))
                    if not _looks_at_object(in_object, plan, 3.0 * distance):
                        continue
                    camera = CameraPose.from_to_camera(in_object.to_camera() @ object_in_rig.inverse())
                    poses.extend(rig_pose_for(camera, mount, zoom) for zoom in zooms)
    return poses


def _stations(
    wall: Wall, plan: Plan, distance: float, step: float, height_step: float, clear_mm: float
) -> list[FloatArray]:
    """Camera centres ``(3,)`` in front of a wall, from a quarter of the stand-off beyond one end to the other."""
    width, height = wall.size_mm
    top_left, top_right = wall.corners_mm[:2]
    along = (top_right - top_left) / width
    reach = 0.5 * width + 0.25 * distance
    aside = np.arange(-np.floor(reach / step), np.floor(reach / step) + 1) * step
    rows = max(1, int(height / height_step))
    drops = (np.arange(rows) + 0.5) * height / rows
    foot = (top_left + top_right) / 2 + wall.normal * distance
    places = foot + aside[:, None] * along
    near_wall = ((top_left + top_right) / 2 + wall.normal * 1e-3 * distance)[[0, 2]]
    # The wall itself is not in the way of its own stations; a wing or a neighbouring wall may be.
    good = plan.free(places[:, [0, 2]], clear_mm) & plan.clear_between(near_wall, places[:, [0, 2]])
    return [place + np.array([0.0, drop, 0.0]) for place in places[good] for drop in drops]


def _looks_at_object(camera: CameraPose, plan: Plan, reach_mm: float) -> bool:
    """The camera's axis meets a wall within ``reach_mm``."""
    centre = camera.centre_mm[[0, 2]]
    pan = np.radians(camera.theta_deg)
    axis = np.array([-np.sin(pan), np.cos(pan)])
    return not plan.clear_between(centre, (centre + reach_mm * axis)[None])[0]


def limits_around(poses: Sequence[RigPose], margin_mm: float = 100.0) -> RigLimits:
    """Limits of a gantry that reaches all these poses, with the speeds of a small one (100 mm/s, 45 deg/s)."""

    def span(axis: str, margin: float, speed: float) -> AxisLimits:
        values = [getattr(pose, axis) for pose in poses]
        return AxisLimits(min(values) - margin, max(values) + margin, speed)

    x, y, z = (span(axis, margin_mm, 100.0) for axis in ("x_mm", "y_mm", "z_mm"))
    return RigLimits(x, y, z, AxisLimits(-180.0, 180.0, 45.0), AxisLimits(0.0, 1.0, 0.5), settle_s=0.3, exposure_s=0.05)


def draw_placement(rng: np.random.Generator, tilt_deg: float = 12.0, shift_mm: float = 250.0) -> Pose4:
    """A placement of the object in the rig frame: turned by 2 to ``tilt_deg`` degrees either way, and shifted."""
    turn = float(rng.uniform(2.0, tilt_deg) * rng.choice([-1.0, 1.0]))
    x, y, z = (float(v) for v in rng.uniform(-shift_mm, shift_mm, 3))
    return Pose4(turn, x, y, z)
