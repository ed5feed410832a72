"""A rendered rig whose views are tampered with on purpose, and a detector that misses what it should have seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from recognition.detectors import load_detector
from recognition.geometry import camera_in_object, camera_in_rig
from recognition.modelbase import ModelBase
from recognition.parts import DetectedPart
from rig.hal import Frame, Image, RigPose
from sim_backends.clutter import Tree
from sim_backends.rendered_rig import RenderedRig
from sim_backends.renderer import PartTruth
from sim_backends.simulate import FRACTION_SHOWN

_NO_PART_MM = 200.0
"""How far away a tree's wall is taken to be where the view shows no part."""


class StagedRig(RenderedRig):
    """A rendered rig whose later views may be tampered with: at another zoom than asked for, or with a tree before it.

    ``tree_in``: numbers of the views, from 1, in front of which a tree stands. ``zoom_of``: view number to the zoom
    that it is taken at, whatever was asked for.
    """

    tree_in: frozenset[int] = frozenset()
    zoom_of: dict[int, float]
    view = 0

    def begin(self, pose: RigPose) -> None:
        """Stand at the first view."""
        self.view = 1
        super().move_to(pose)

    def move_to(self, pose: RigPose) -> RigPose:
        """Move to the next view's pose, at the zoom staged for that view."""
        self.view += 1
        return super().move_to(self._at_zoom(pose))

    def capture(self) -> Frame:
        """The picture, with a tree in front where one is staged."""
        clear = self._scene
        if self.view in self.tree_in:
            self._scene = replace(clear, clutter=(*clear.clutter, self._tree()))
        try:
            return super().capture()
        finally:
            self._scene = clear

    def _at_zoom(self, pose: RigPose) -> RigPose:
        if self.view not in self.zoom_of:
            return pose
        other = replace(pose, zoom=self.zoom_of[self.view])
        self._offered |= {other}
        return other

    def _tree(self) -> Tree:
        """A tree half-way to the wall that hides about the right third of the picture."""
        camera = camera_in_object(camera_in_rig(self.pose), self.scene.object_in_rig)
        pan = np.radians(camera.theta_deg)
        ahead, right = np.array([-np.sin(pan), 0.0, np.cos(pan)]), np.array([np.cos(pan), 0.0, np.sin(pan)])
        centres = {part.id: part.centre_mm for part in self.scene.object_model.parts}
        away = [float(np.linalg.norm(centres[p.id] - camera.centre_mm)) for p in self.parts()] or [_NO_PART_MM]
        distance = 0.55 * float(np.median(away))
        half = distance * 0.5 * self.size[0] / self.truth().internals.fx
        radius = 0.4 * half
        crown = camera.centre_mm + distance * ahead + 0.65 * half * right
        height = 4.0 * radius
        foot = crown + np.array([0.0, height - radius, 0.0])
        return Tree((float(foot[0]), float(foot[1]), float(foot[2])), height, radius, seed=self.view)


class HalfBlindDetector:
    """The default detector, which from the second view on misses the part next nearest to the centre."""

    def __init__(self, rig: StagedRig, base: ModelBase) -> None:
        self.rig, self.inner = rig, load_detector("segmentation", base.classes)

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        """What the default detector finds, but for one part."""
        found = self.inner.detect(image)
        if self.rig.view < 2:
            return found
        centre = (np.array(self.rig.size) - 1) / 2
        shown = sorted(whole(self.rig.parts()), key=lambda p: float(np.linalg.norm(p.corners_px.mean(axis=0) - centre)))
        return [d for d in found if not any(_inside(d, part) for part in shown[1:2])]


def _inside(detection: DetectedPart, part: PartTruth) -> bool:
    middle = detection.corners_px.mean(axis=0)
    return bool(((middle > part.corners_px.min(axis=0)) & (middle < part.corners_px.max(axis=0))).all())


def whole(shown: Sequence[PartTruth]) -> list[PartTruth]:
    """Parts that a view shows wholly."""
    return [p for p in shown if p.fully_in_frame and p.visible_fraction >= FRACTION_SHOWN and p.cos_incidence > 0.3]
