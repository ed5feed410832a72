"""A rig whose pictures are blank, and a detector that knows the truth: what remains is the paper's reasoning alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from recognition.modelbase import ModelBase
from recognition.modelbase_io import load_model_base
from recognition.parts import DetectedPart
from recognition.rates import DetectionRates
from recognition.settings import BenchBounds, RecogniserSettings
from rig.hal import Frame, Image, RigPose
from sim_backends.rendered_rig import RenderedRig
from sim_backends.simulate import FRACTION_SHOWN, draw_scene
from sim_backends.viewpoints import limits_around, viewing_poses

SETTINGS = RecogniserSettings(
    mode="paper",
    policy="paper",
    threshold=1.0,
    bounds=BenchBounds(60, 2000, 15, 70),
    rates=DetectionRates(found=0.97, clutter=0.2, corner_sd_px=0.5),
)


class BlankRig(RenderedRig):
    """Takes blank pictures, and notes every pose that it is sent to."""

    visited: list[RigPose]

    def capture(self) -> Frame:
        return Frame(np.zeros((*self.size[::-1], 3), dtype=np.uint8), self.pose, self.pose, "blank", 0)

    def move_to(self, pose: RigPose) -> RigPose:
        self.visited.append(pose)
        return super().move_to(pose)


class TrueDetector:
    """Finds the parts that the rig's present view wholly shows, exactly; ``change`` may tamper with what it says."""

    def __init__(
        self, rig: BlankRig, change: Callable[[int, list[DetectedPart]], list[DetectedPart]] | None = None
    ) -> None:
        self.rig, self.change, self.view = rig, change or (lambda _, parts: parts), -1

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        self.view += 1
        whole = [p for p in self.rig.parts() if p.fully_in_frame and p.visible_fraction > FRACTION_SHOWN]
        return self.change(self.view, [DetectedPart(p.corners_px, {p.part_class: 1.0}, 0.1) for p in whole])


def architecture() -> ModelBase:
    return load_model_base("architecture")


def blank_rig(base: ModelBase, object_id: str, seed: int, distance_mm: float = 200.0) -> BlankRig:
    """A rig at a random view that shows a DW4 part."""
    scene = draw_scene(base, object_id, seed)
    poses = viewing_poses(scene.object_model, scene.object_in_rig, (distance_mm,))
    rig = BlankRig(scene, limits_around(poses), poses, seed=seed)
    rng = np.random.default_rng(seed)
    for k in rng.permutation(len(poses)):
        shown = rig.parts(poses[k])
        if shown and all(p.part_class == "DW4" and p.fully_in_frame and p.cos_incidence > 0.9 for p in shown):
            break
    rig.visited = []
    rig.move_to(poses[k])
    return rig
