"""The events of a run as JSON objects, and back: one line of ``events.jsonl`` each (docs/formats.md).

Numbers are written so that reading them back gives the same bits; what is not finite becomes ``null``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from recognition.geometry import CameraPose
from recognition.parts import DetectedPart
from recognition.steps import Answer, BeliefSummary, HypothesisSummary, Move, Outcome, PartMatch, Step, StepSeconds
from rig.hal import AXES, Frame, Image, RigPose

Event = dict[str, Any]
SCHEMA = 1


def view_event(step: Step, file: str, sha256: str, why: str) -> Event:
    """A picture was taken: where it is kept, where the rig stood, and why this view."""
    frame = step.frame
    height, width = frame.image.shape[:2]
    return {
        "kind": "view",
        "view": step.index,
        "file": file,
        "sha256": sha256,
        "name": frame.name,
        "width": width,
        "height": height,
        "rig_pose": asdict(frame.rig_pose),
        "commanded": asdict(frame.commanded),
        "sequence": frame.sequence,
        "exposed_at_s": frame.exposed_at_s,
        "why": why,
    }


def parts_event(step: Step) -> Event:
    """What was found in the picture; ``corners_px`` in full-size pixels of the picture."""
    parts = [
        {
            "corners_px": part.corners_px.tolist(),
            "class_scores": dict(part.class_scores),
            "sigma_px": part.sigma_px,
            "confidence": part.confidence,
        }
        for part in step.parts
    ]
    return {"kind": "parts", "view": step.index, "parts": parts, "why": describe_parts(step.parts)}


def belief_event(step: Step) -> Event:
    """What is believed after the picture."""
    belief = step.belief
    return {
        "kind": "belief",
        "view": step.index,
        "posterior": dict(belief.posterior),
        "hypotheses_left": belief.hypotheses_left,
        "entropy_bits": belief.entropy_bits,
        "leaders": [_leader(leader) for leader in belief.leaders],
        "seconds": asdict(step.seconds),
        "why": describe_belief(belief),
    }


def move_event(index: int, move: Move) -> Event:
    """The next view was chosen."""
    return {
        "kind": "move",
        "view": index,
        "target": asdict(move.target),
        "gain_bits": move.gain_bits,
        "cost_s": move.cost_s,
        "why": move.why,
    }


def finish_event(answer: Answer) -> Event:
    """The run ended."""
    return {
        "kind": "finish",
        "outcome": answer.outcome.value,
        "object": answer.object_id,
        "candidates": list(answer.candidates),
        "left": answer.left,
        "posterior": dict(answer.posterior),
        "pose": None if answer.pose is None else asdict(answer.pose),
        "pose_sd": dict(answer.pose_sd),
        "unobservable": list(answer.unobservable),
        "travel_mm": answer.travel_mm,
        "rotation_deg": answer.rotation_deg,
        "pose_sure": answer.pose_sure,
        "why": answer.why,
    }


def step_of(view: Event, parts: Event, belief: Event, image: Image) -> Step:
    """The step that wrote these events, its move left out.

    Raises:
        KeyError, TypeError, ValueError: an event lacks a field, or a field is not what it should be.
    """
    frame = Frame(
        image=image,
        rig_pose=rig_pose_of(view["rig_pose"]),
        commanded=rig_pose_of(view["commanded"]),
        name=str(view["name"]),
        sequence=int(view["sequence"]),
        exposed_at_s=float(view["exposed_at_s"]),
    )
    return Step(
        index=int(view["view"]),
        frame=frame,
        parts=tuple(_part_of(part) for part in parts["parts"]),
        belief=_belief_of(belief),
        move=None,
        seconds=StepSeconds(**{name: float(belief["seconds"][name]) for name in ("detect", "update", "plan")}),
    )


def move_of(event: Event) -> Move:
    """The move that wrote this event; raises as ``step_of`` does."""
    target = rig_pose_of(event["target"])
    return Move(target, str(event["why"]), float(event["gain_bits"]), float(event["cost_s"]))


def answer_of(event: Event) -> Answer:
    """The answer that wrote this ``finish`` event; raises as ``step_of`` does."""
    pose = event["pose"]
    return Answer(
        outcome=Outcome(event["outcome"]),
        object_id=None if event["object"] is None else str(event["object"]),
        candidates=tuple(str(name) for name in event["candidates"]),
        posterior=_numbers(event["posterior"]),
        pose=None if pose is None else _camera_of(pose),
        # What is unbounded was written as null.
        pose_sd={str(k): math.inf if v is None else float(v) for k, v in event["pose_sd"].items()},
        unobservable=tuple(str(name) for name in event["unobservable"]),
        why=str(event["why"]),
        travel_mm=float(event["travel_mm"]),
        rotation_deg=float(event["rotation_deg"]),
        # Runs kept before these were noted do not say.
        pose_sure=None if event.get("pose_sure") is None else bool(event["pose_sure"]),
        left=int(event.get("left", 0)),
    )


def finite(value: Any) -> Any:
    """``value`` as JSON can hold it: numbers that are not finite become ``None``, tuples become lists."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.generic):
        return finite(value.item())
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value


def describe_parts(parts: tuple[DetectedPart, ...]) -> str:
    """``12 parts found: 9 DW4, 3 OPEN.``"""
    if not parts:
        return "No part found; the empty view is evidence too."
    counts = Counter(part.part_class for part in parts)
    listed = ", ".join(f"{count} {name}" for name, count in counts.most_common())
    return f"{len(parts)} {'part' if len(parts) == 1 else 'parts'} found: {listed}."


def describe_belief(belief: BeliefSummary) -> str:
    """``122 hypotheses left (5.3 bits); castle leads with 63 %.``"""
    left = belief.hypotheses_left
    text = f"{left} {'hypothesis' if left == 1 else 'hypotheses'} left ({belief.entropy_bits:.1f} bits)"
    if not belief.posterior:
        return f"{text}."
    name = max(belief.posterior, key=lambda key: belief.posterior[key])
    leader = "none of the known objects" if name == "unknown" else name
    return f"{text}; {leader} leads with {100 * belief.posterior[name]:.0f} %."


def rig_pose_of(data: Mapping[str, Any]) -> RigPose:
    """The rig pose in an event; raises as ``step_of`` does."""
    return RigPose(*(float(data[axis]) for axis in AXES))


def _leader(leader: HypothesisSummary) -> Event:
    matches = [
        {"part_id": match.part_id, "predicted_px": match.predicted_px.tolist(), "detection": match.detection}
        for match in leader.matches
    ]
    return {
        "object": leader.object_id,
        "place": leader.place,
        "probability": leader.probability,
        "camera": asdict(leader.camera),
        "matches": matches,
    }


def _camera_of(data: Mapping[str, Any]) -> CameraPose:
    return CameraPose(*(float(data[key]) for key in ("theta_deg", "x_mm", "y_mm", "z_mm")))


def _part_of(data: Mapping[str, Any]) -> DetectedPart:
    return DetectedPart(
        corners_px=np.array(data["corners_px"], dtype=np.float64).reshape(-1, 2),
        class_scores=_numbers(data["class_scores"]),
        sigma_px=float(data["sigma_px"]),
        confidence=float(data["confidence"]),
    )


def _match_of(data: Mapping[str, Any]) -> PartMatch:
    detection = data["detection"]
    corners = np.array(data["predicted_px"], dtype=np.float64).reshape(-1, 2)
    return PartMatch(str(data["part_id"]), corners, None if detection is None else int(detection))


def _belief_of(event: Event) -> BeliefSummary:
    leaders = tuple(
        HypothesisSummary(
            object_id=str(leader["object"]),
            place=str(leader["place"]),
            probability=float(leader["probability"]),
            camera=_camera_of(leader["camera"]),
            matches=tuple(_match_of(match) for match in leader["matches"]),
        )
        for leader in event["leaders"]
    )
    return BeliefSummary(
        posterior=_numbers(event["posterior"]),
        hypotheses_left=int(event["hypotheses_left"]),
        entropy_bits=float(event["entropy_bits"]),
        leaders=leaders,
    )


def _numbers(data: Mapping[str, Any]) -> dict[str, float]:
    return {str(key): float(value) for key, value in data.items()}
