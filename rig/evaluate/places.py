"""Whether an answer has the place right, whatever it says of the distance: by the parts that it claims to see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from recognition.layout import part_of
from recognition.modelbase import PartClass
from recognition.steps import Step
from rig.hal import RigPose
from sim_backends.rendered_rig import RenderedRig
from sim_backends.sightlines import Sightlines

FloatArray = npt.NDArray[np.float64]


def place_right(rig: RenderedRig, classes: Sequence[PartClass], steps: Sequence[Step]) -> bool:
    """Whether the leading hypothesis has the true part at the centre of the last view, or claims mostly true parts."""
    leaders = steps[-1].belief.leaders
    if not leaders:
        return False
    there = part_at_centre(rig, classes, steps[-1].frame.rig_pose)
    return leaders[0].place == there or names_parts_right(rig, steps)


def names_parts_right(rig: RenderedRig, steps: Sequence[Step]) -> bool:
    """Whether most parts that the leading hypothesis claims to see in the last view are those that are there."""
    step = steps[-1]
    leaders = step.belief.leaders
    claims = [match for match in leaders[0].matches if match.detection is not None] if leaders else []
    true = {part.id: part.corners_px for part in rig.parts(step.frame.rig_pose)}
    hits = 0
    for claim in claims:
        assert claim.detection is not None
        there = true.get(claim.part_id)
        if there is not None:
            gap = np.abs(middle(step.parts[claim.detection].corners_px) - middle(there))
            hits += bool((gap < np.ptp(there, axis=0) / 2).all())
    return hits > len(claims) / 2


def part_at_centre(rig: RenderedRig, classes: Sequence[PartClass], pose: RigPose) -> str | None:
    """The part nearest to the image centre, which need not show whole: what a hypothesis calls its place."""
    truth, (width, height) = rig.truth(pose), rig.size
    sightlines = Sightlines(rig.scene.object_model, classes)
    # As the recogniser's summary looks for it.
    pairs = sightlines.seen([truth.camera_in_object], [truth.internals], rig.size, margin_px=-0.5 * width, least_px=2.0)
    if len(pairs.part) == 0:
        return None
    away = np.linalg.norm(pairs.corners_px.mean(axis=1) - np.array([width, height]) / 2, axis=1)
    return part_of(sightlines.layout, int(pairs.part[away.argmin()])).id


def middle(corners_px: FloatArray) -> FloatArray:
    """``(2,)`` middle of the bounding box of ``(n, 2)`` corners."""
    return np.asarray((corners_px.max(axis=0) + corners_px.min(axis=0)) / 2)
