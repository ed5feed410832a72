"""Compiles the inner loops before they are needed, on a small recognition of made-up corners.

Once after an installation this takes some twenty seconds, later less than one. Done beforehand, it is in no view's
time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, camera_in_rig, project
from recognition.modelbase import Face, ModelBase, ObjectModel, Part, PartClass
from recognition.parts import DetectedPart
from recognition.recogniser import recognise
from recognition.settings import RecogniserSettings
from rig.hal import AxisLimits, Frame, Image, RigLimits, RigPose, travel_seconds

_INTERNALS = np.array([700.0, 702.0, 322.0, 236.0])
_SIZE = (640, 480)
_POSES = tuple(RigPose(x, y, -330.0, 0.0) for x, y in ((120.0, 100.0), (240.0, 100.0), (240.0, 180.0)))


def warm_up() -> None:
    """Compile, or load what was compiled before."""
    base = ModelBase((_wall("one", (2, 5)), _wall("other", (3, 7))), (PartClass("window", 4),), "warming up")
    rig = _Rig(base.objects[0])
    for _ in recognise(rig, base, RecogniserSettings(max_views=len(_POSES)), detector=rig):
        pass


def _wall(name: str, missing: Sequence[int]) -> ObjectModel:
    """A wall at z = 0 with four by three windows, some missing."""
    parts = []
    for number in range(12):
        if number not in missing:
            x, y = 30.0 + 80.0 * (number % 4), 30.0 + 90.0 * (number // 4)
            corners = [[x, y, 0.0], [x + 40.0, y, 0.0], [x + 40.0, y + 55.0, 0.0], [x, y + 55.0, 0.0]]
            parts.append(Part(str(number), "window", np.array(corners), "front"))
    outline = np.array([[0.0, 0, 0], [360, 0, 0], [360, 300, 0], [0, 300, 0]])
    return ObjectModel(name, tuple(parts), (Face("front", outline),))


class _Rig:
    """A rig before a wall, and the detector that sees what it stands before; its pictures are empty."""

    internals_fixed_by_zoom = False

    def __init__(self, wall: ObjectModel) -> None:
        self._wall, self.pose = wall, _POSES[0]
        still = AxisLimits(-1000.0, 1000.0, 100.0)
        self.limits = RigLimits(still, still, still, AxisLimits(-90.0, 90.0, 45.0), AxisLimits(0.0, 1.0, 1.0), 0.1, 0.1)

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        return _POSES

    def nearest(self, wish: RigPose) -> RigPose:
        return wish

    def move_to(self, pose: RigPose) -> RigPose:
        self.pose = pose
        return pose

    def capture(self) -> Frame:
        image: Image = np.zeros((_SIZE[1], _SIZE[0]), dtype=np.uint8)
        return Frame(image, self.pose, self.pose, "none", 0, 0.0)

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        return travel_seconds(self.limits, start, end)

    def close(self) -> None:
        pass

    def __enter__(self) -> _Rig:
        return self

    def __exit__(self, *exc: Any) -> None:
        pass

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        camera = camera_in_rig(self.pose)
        corners = [_pixels(part.corners_mm, camera) for part in self._wall.parts]
        seen = [px for px in corners if (px > 4.0).all() and (px < np.array(_SIZE) - 5.0).all()]
        return [DetectedPart(px, {"window": 0.95}, 0.3) for px in seen]


def _pixels(points_mm: npt.NDArray[np.float64], camera: CameraPose) -> npt.NDArray[np.float64]:
    to_camera = camera.to_camera()
    return project(points_mm @ to_camera.rotation.T + to_camera.translation_mm, _INTERNALS)
