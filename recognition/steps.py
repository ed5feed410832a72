"""What the recognition loop tells those who watch it: one ``Step`` per view, and an ``Answer`` at the end.

The command line, the report, the event log and a replay all read these; none of them reaches into the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose
from recognition.parts import DetectedPart
from rig.hal import Frame, RigPose

FloatArray = npt.NDArray[np.float64]


class Outcome(StrEnum):
    """How a recognition ended."""

    RECOGNISED = "recognised"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    NOT_FOUND = "not_found"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class PartMatch:
    """A part that a hypothesis expects in the view, where it expects it, and which detection it takes for it.

    Attributes:
        part_id: id of the part in its object.
        predicted_px: ``(n, 2)`` projected corners.
        detection: index into the step's ``parts``, or ``None`` for a part that was expected but not found.
    """

    part_id: str
    predicted_px: FloatArray = field(repr=False)
    detection: int | None


@dataclass(frozen=True, slots=True)
class HypothesisSummary:
    """One hypothesis as shown to a person: object, place, probability and what it says of the present view.

    Attributes:
        object_id: the object.
        place: the part nearest to the image centre under this hypothesis, as a name for the place.
        probability: posterior probability of this configuration.
        camera: the camera's pose in the object frame at the present view.
        matches: expected parts of the present view; empty for all but the leading hypotheses.
    """

    object_id: str
    place: str
    probability: float
    camera: CameraPose
    matches: tuple[PartMatch, ...] = field(default=(), repr=False)


@dataclass(frozen=True, slots=True)
class BeliefSummary:
    """The belief after a view.

    Attributes:
        posterior: object id to probability; the key ``"unknown"`` is "none of these objects". Sums to 1.
        hypotheses_left: configurations that together hold 99.9 % of the probability ("none" not counted).
        entropy_bits: entropy of the belief over configurations.
        leaders: the most probable hypotheses, best first.
    """

    posterior: Mapping[str, float]
    hypotheses_left: int
    entropy_bits: float
    leaders: tuple[HypothesisSummary, ...]


@dataclass(frozen=True, slots=True)
class Move:
    """A chosen next view, and why in one sentence."""

    target: RigPose
    why: str
    gain_bits: float = 0.0
    cost_s: float = 0.0


@dataclass(frozen=True, slots=True)
class StepSeconds:
    """Wall time of one step, seconds."""

    detect: float
    update: float
    plan: float


@dataclass(frozen=True, slots=True)
class Step:
    """One view: the picture, what was found in it, the belief after it, and the move chosen (``None``: the end)."""

    index: int
    frame: Frame
    parts: tuple[DetectedPart, ...] = field(repr=False)
    belief: BeliefSummary
    move: Move | None
    seconds: StepSeconds


@dataclass(frozen=True, slots=True)
class Answer:
    """The end of a recognition.

    Attributes:
        outcome: how it ended.
        object_id: the object, if recognised.
        candidates: what is left when it is not recognised: "object at place" descriptions, most probable first.
        posterior: object id to probability, ``"unknown"`` included.
        pose: the camera in the object frame at the last view (of the leading hypothesis); ``None`` if there is none.
        pose_sd: standard deviations by the keys theta_deg, x_mm, y_mm, z_mm.
        unobservable: names of directions that the views do not determine.
        why: one sentence: why the run ended so.
        travel_mm: path length of the gantry; rotation_deg: summed pan.
        pose_sure: whether the pose is as sure as asked, if recognised; else ``None``.
    """

    outcome: Outcome
    object_id: str | None
    candidates: tuple[str, ...]
    posterior: Mapping[str, float]
    pose: CameraPose | None
    pose_sd: Mapping[str, float]
    unobservable: tuple[str, ...]
    why: str
    travel_mm: float
    rotation_deg: float
    pose_sure: bool | None = None
