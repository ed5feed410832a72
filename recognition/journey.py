"""What any recognition carries from view to view: the views, the way travelled, and where the rig may still look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.geometry import camera_in_rig
from recognition.parts import DetectedPart
from recognition.policies import Situation
from recognition.seen import Seen, see
from recognition.settings import RecogniserSettings
from recognition.tracking import World
from rig.hal import Frame, Rig, RigPose

if TYPE_CHECKING:
    from recognition.detectors.edges import EdgeField


class Journey:
    """The views of a run, and the rig's way between them.

    Attributes:
        views: all views so far, as matching takes them.
        path: the rig poses read back, in order; a return to an earlier one is added by ``came_back``.
    """

    def __init__(self, rig: Rig, world: World, settings: RecogniserSettings) -> None:
        self.views: list[Seen] = []
        self.path: list[RigPose] = []
        self._rig, self._world, self._settings = rig, world, settings
        self._rng = np.random.default_rng(settings.seed)
        self._commanded: list[RigPose] = []
        self._groups: dict[float, int] = {}

    @property
    def at_its_end(self) -> bool:
        """Whether as many views were taken as are allowed."""
        return len(self.views) >= self._settings.max_views

    def add(self, frame: Frame, parts: Sequence[DetectedPart], edges: EdgeField | None = None) -> Seen:
        """Add a view and return it; ``edges``: its picture prepared for second looks."""
        height, width = frame.image.shape[:2]
        layout = self._world.layout
        seen = see(
            parts,
            camera_in_rig(frame.rig_pose, self._settings.mount),
            (width, height),
            self._group(frame.rig_pose),
            frame.rig_pose.zoom,
            layout.class_names,
            layout.corners_mm.shape[1],
            edges,
        )
        self.views.append(seen)
        self.path.append(frame.rig_pose)
        self._commanded.append(frame.commanded)
        return seen

    def came_back(self, pose: RigPose) -> None:
        """Note that the rig returned to an earlier pose without a view."""
        self.path.append(pose)

    def fresh(self, here: RigPose) -> list[RigPose]:
        """Poses that can be reached from ``here`` and have not been taken."""
        poses = self._rig.reachable(here)
        taken = _same(poses, self._commanded)
        return [pose for pose, again in zip(poses, taken, strict=True) if not again]

    def situation(self, belief: Belief, here: RigPose, candidates: Sequence[RigPose], *, sure: bool) -> Situation:
        """All that a policy may know when it chooses among candidates from ``here``."""
        fixed = self._rig.internals_fixed_by_zoom
        return Situation(
            world=self._world,
            belief=belief,
            views=self.views,
            pose=here,
            visited=tuple(self.path),
            candidates=candidates,
            groups=[self._groups.get(round(p.zoom, 6)) if fixed else None for p in candidates],
            cost_s=np.array([self._rig.travel_s(here, p) for p in candidates]),
            sure=sure,
            mount=self._settings.mount,
            most=self._settings.effort.candidates,
            rng=self._rng,
        )

    def _group(self, pose: RigPose) -> int:
        """Views of one zoom setting share internals if the rig vouches for it; else each view has its own."""
        if not self._rig.internals_fixed_by_zoom:
            return len(self.views)
        return self._groups.setdefault(round(pose.zoom, 6), len(self._groups))


def _same(poses: Sequence[RigPose], others: Sequence[RigPose]) -> npt.NDArray[np.bool_]:
    """Whether each pose is one of the others, as nearly as a rig could tell."""
    a, b = _numbers(poses)[:, None], _numbers(others)[None]
    near = (np.abs(a[..., :3] - b[..., :3]) < _SAME_MM).all(axis=2) & (np.abs(a[..., 4] - b[..., 4]) < _SAME_ZOOM)
    turn = np.abs((a[..., 3] - b[..., 3] + 180.0) % 360.0 - 180.0)
    return np.asarray((near & (turn < _SAME_DEG)).any(axis=1))


def _numbers(poses: Sequence[RigPose]) -> npt.NDArray[np.float64]:
    return np.array([(p.x_mm, p.y_mm, p.z_mm, p.theta_deg, p.zoom) for p in poses]).reshape(-1, 5)


_SAME_MM, _SAME_DEG, _SAME_ZOOM = 0.5, 0.1, 1e-3
