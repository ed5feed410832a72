"""What a run comes to: the result object, the answer of a run cut short, and the outlines kept for the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any

from recognition.modelbase import ModelBase
from recognition.steps import Answer, Outcome, Step
from rig.run.events import SCHEMA, finish_event, finite

POSE_KEYS = ("theta_deg", "x_mm", "y_mm", "z_mm")


def aborted_answer(steps: Sequence[Step], why: str) -> Answer:
    """The honest answer of a run that was cut short after these steps: what was believed then, nothing recognised."""
    travel_mm, rotation_deg = travelled(steps)
    belief = steps[-1].belief if steps else None
    leaders = belief.leaders if belief else ()
    return Answer(
        outcome=Outcome.ABORTED,
        object_id=None,
        candidates=tuple(f"{leader.object_id} at {leader.place}" for leader in leaders),
        posterior=dict(belief.posterior) if belief else {},
        pose=leaders[0].camera if leaders else None,
        pose_sd={},
        unobservable=(),
        why=why,
        travel_mm=travel_mm,
        rotation_deg=rotation_deg,
    )


def travelled(steps: Sequence[Step]) -> tuple[float, float]:
    """Path length of the gantry, mm, and summed pan, degrees, over the views taken."""
    poses = [step.frame.rig_pose for step in steps]
    pairs = list(pairwise(poses))
    travel = sum(math.dist((a.x_mm, a.y_mm, a.z_mm), (b.x_mm, b.y_mm, b.z_mm)) for a, b in pairs)
    return float(travel), float(sum(abs(b.theta_deg - a.theta_deg) for a, b in pairs))


def result_object(steps: Sequence[Step], answer: Answer) -> dict[str, Any]:
    """The object that ``--json`` prints (design §8); ``null`` stands for what is unknown or unbounded."""
    views = [
        {
            "rig_pose": asdict(step.frame.rig_pose),
            "parts_found": len(step.parts),
            "hypotheses_left": step.belief.hypotheses_left,
            "entropy_bits": step.belief.entropy_bits,
            "seconds": asdict(step.seconds),
            "why": answer.why if step.move is None else step.move.why,
        }
        for step in steps
    ]
    event = finish_event(answer)
    keys = ("outcome", "object", "candidates", "posterior", "pose", "pose_sd", "unobservable")
    # A run cut short has no covariance: every key is there all the same, as null.
    pose_sd = {key: answer.pose_sd.get(key) for key in POSE_KEYS} if answer.pose else None
    tail = {
        "pose_sd": pose_sd,
        "views": views,
        "travel_mm": answer.travel_mm,
        "rotation_deg": answer.rotation_deg,
        "pose_sure": answer.pose_sure,
    }
    result: dict[str, Any] = finite({key: event[key] for key in keys} | tail)
    return result


def outlines(models: ModelBase) -> dict[str, Any]:
    """The walls and parts of all objects, corners to 0.1 mm: what the report needs to draw its plans."""
    return {
        "schema": SCHEMA,
        "name": models.name,
        "objects": [
            {
                "id": item.id,
                "faces": [{"id": face.id, "corners_mm": face.corners_mm.round(1).tolist()} for face in item.faces],
                "parts": [
                    {
                        "id": part.id,
                        "class": part.part_class,
                        "face": part.face,
                        "corners_mm": part.corners_mm.round(1).tolist(),
                    }
                    for part in item.parts
                ],
            }
            for item in models.objects
        ],
    }
