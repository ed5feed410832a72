"""A rig whose pictures are skipped: its detector returns the projected corners of what is in view, with its faults.

Staged as the rendered rig is, so that results compare: the same places of the object, poses, limits and internals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from recognition.geometry import CameraPose, Mount, camera_in_object, camera_in_rig
from recognition.layout import part_of
from recognition.modelbase import PartClass
from recognition.parts import DetectedPart
from recognition.visibility import Pairs
from rig.hal import Frame, Image, RigLimits, RigPose
from sim_backends.corner_noise import CornerNoise, detections
from sim_backends.rendered_rig import RenderedRig, ViewTruth
from sim_backends.renderer import DEFAULT_SIZE, PartTruth
from sim_backends.scene import Scene
from sim_backends.sightlines import Sightlines
from sim_backends.viewpoints import limits_around, viewing_poses

_MOTION, _DETECTOR = 2, 3
"""Purposes of a view's generators, beside those of the rendered rig."""


class CornerRig(RenderedRig):
    """A ``rig.hal.Rig`` before an object, and the detector of its views (give it to the recogniser as ``detector``).

    Frames carry an empty picture that takes no memory; second looks at pictures must be off. What a view shows and how
    it is disturbed depends on the seed and the pose read back alone, not on the views before it. Clutter of the scene
    hides nothing here.
    """

    def __init__(
        self,
        scene: Scene,
        limits: RigLimits,
        offers: Sequence[RigPose],
        classes: Sequence[PartClass],
        noise: CornerNoise | None = None,
        *,
        seed: int = 0,
        size: tuple[int, int] = DEFAULT_SIZE,
        mount: Mount | None = None,
    ) -> None:
        """Set the rig up.

        Args:
            scene: what stands in front of it.
            limits: travel and speeds.
            offers: the poses it can take, the first of which it stands at.
            classes: of the model base, for class errors and false parts.
            noise: of the views; ``None``: none but internals that change.
            seed: of everything drawn.
            size: of the pictures, pixels.
            mount: how the camera hangs, upright.
        """
        self._noise = noise or CornerNoise()
        super().__init__(
            scene, limits, offers, internals=self._noise.internals(size), seed=seed, size=size, mount=mount
        )
        self._classes = tuple(classes)
        self._sightlines = Sightlines(scene.object_model, self._classes)
        self._found: tuple[DetectedPart, ...] = ()

    def capture(self) -> Frame:
        """An empty picture from the present pose; ``detect`` tells what is in it."""
        self._found = self.detections()
        self._sequence += 1
        width, height = self._size
        empty: Image = np.broadcast_to(np.uint8(0), (height, width))
        name = f"corners-{self._sequence:04d}"
        return Frame(empty, self._pose, self._pose, name, self._sequence, self._clock_s)

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        """The parts of the last picture taken, whatever picture is given."""
        return self._found

    def detections(self, pose: RigPose | None = None) -> tuple[DetectedPart, ...]:
        """What the detector returns for a view from a pose."""
        at = pose or self._pose
        shown = [(part.part_class, part.corners_px) for part in self.parts(at)]
        return detections(shown, self._classes, self._noise, self._size, self._rng(at, _DETECTOR))

    def truth(self, pose: RigPose | None = None) -> ViewTruth:
        """For scoring only: where the camera really is when the rig reads back a pose, and its internals."""
        at = pose or self._pose
        camera = camera_in_object(self._true_camera(at), self._scene.object_in_rig)
        return ViewTruth(camera, self._policy.internals(at.zoom, self._rng(at, 0)))

    def parts(self, pose: RigPose | None = None) -> list[PartTruth]:
        """For scoring only: the parts that a view from a pose shows whole, with their true corners."""
        at = pose or self._pose
        truth = self.truth(at)
        pairs = self._sightlines.seen([truth.camera_in_object], [truth.internals], self._size)
        return [self._part_truth(pairs, row) for row in range(len(pairs.part))]

    def _part_truth(self, pairs: Pairs, row: int) -> PartTruth:
        index = int(pairs.part[row])
        part = part_of(self._sightlines.layout, index)
        corners = pairs.corners_px[row, : self._sightlines.layout.corner_count[index]]
        x, y = corners.T
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        return PartTruth(part.id, part.part_class, corners, True, 1.0, float(pairs.cosine[row]), float(np.sqrt(area)))

    def _true_camera(self, at: RigPose) -> CameraPose:
        """The camera in the rig frame: axes that can move are off by the motion error of this pose."""
        off = self._rng(at, _MOTION).standard_normal(4)
        off *= [self._noise.motion_sd_mm] * 3 + [self._noise.motion_theta_sd_deg]
        moved = {
            axis: getattr(at, axis) + float(error)
            for axis, error in zip(("x_mm", "y_mm", "z_mm", "theta_deg"), off, strict=True)
            if getattr(self._limits, axis).upper > getattr(self._limits, axis).lower
        }
        return camera_in_rig(replace(at, **moved), self._mount)


def corner_rig(
    scene: Scene,
    classes: Sequence[PartClass],
    noise: CornerNoise | None = None,
    *,
    distances_mm: Sequence[float],
    zooms: Sequence[float] = (0.0, 1.0),
    **options: Any,
) -> CornerRig:
    """A corner rig around a scene, at the stations of ``viewing_poses``; ``options`` as of `CornerRig`."""
    poses = viewing_poses(scene.object_model, scene.object_in_rig, distances_mm, zooms=zooms)
    return CornerRig(scene, limits_around(poses), poses, classes, noise, **options)
