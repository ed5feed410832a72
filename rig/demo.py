"""The demonstration: an architecture model, rendered, and a first view that fits as many places as possible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recognition.modelbase import ModelBase
from recognition.modelbase_io import load_model_base
from rig.hal import RigPose
from sim_backends.internals_policy import ChangingInternals, FixedByZoom
from sim_backends.rendered_rig import RenderedRig
from sim_backends.scene import Scene
from sim_backends.viewpoints import draw_placement, limits_around, viewing_poses

MODELS = "architecture"
STAND_OFF_MM = (220.0,)
CANDIDATES = 80


@dataclass(frozen=True)
class Demonstration:
    """What is to be recognised, and from where.

    Attributes:
        rig: stands at ``start``; it renders what its camera sees, and the camera's internals change with every view.
        true_object: what stands in front of the rig; the recogniser is not told.
        parts_in_view: fully visible parts in the first view, by class.
    """

    rig: RenderedRig
    models: ModelBase
    start: RigPose
    true_object: str
    parts_in_view: Counter[str]


def prepare(seed: int) -> Demonstration:
    """Set one of the models up at an unknown place, and stand in front of a spot of it that tells little."""
    rng = np.random.default_rng(seed)
    models = load_model_base(MODELS)
    thing = models.objects[int(rng.integers(len(models.objects)))]
    placement = draw_placement(rng)
    poses = viewing_poses(thing, placement, STAND_OFF_MM)
    rig = RenderedRig(
        Scene(thing, placement),
        limits_around(poses),
        poses,
        internals=ChangingInternals(FixedByZoom(), f_sd=0.03, centre_sd_px=15.0),
        seed=seed,
    )
    start, seen = _most_ambiguous(rig, [poses[int(k)] for k in rng.permutation(len(poses))[:CANDIDATES]], models)
    rig.move_to(start)
    return Demonstration(rig, models, start, thing.id, seen)


def _most_ambiguous(rig: RenderedRig, poses: Sequence[RigPose], models: ModelBase) -> tuple[RigPose, Counter[str]]:
    """The pose whose fully visible parts are few and of common classes, so that most places fit the view."""
    common = Counter(part.part_class for thing in models.objects for part in thing.parts)
    total = common.total()
    best: tuple[float, RigPose, Counter[str]] | None = None
    for pose in poses:
        seen = Counter(p.part_class for p in rig.parts(pose) if p.fully_in_frame and p.visible_fraction > 0.9)
        if not seen:
            continue
        told_bits = sum(number * -np.log2(common[name] / total) + 1.0 * number for name, number in seen.items())
        if best is None or told_bits < best[0]:
            best = (float(told_bits), pose, seen)
    if best is None:
        return poses[0], Counter()
    return best[1], best[2]
