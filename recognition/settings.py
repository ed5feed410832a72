"""What a user may choose about a recognition, as one frozen value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from recognition.geometry import Mount
from recognition.rates import DetectionRates
from rig.errors import InputError

Mode = Literal["graded", "paper"]


@dataclass(frozen=True, slots=True)
class BenchBounds:
    """Weak bounds that every bench has; they settle the scale that a single view leaves open (design §4).

    Attributes:
        distance_min_mm: no part that is seen is nearer to the camera than this.
        distance_max_mm: no part that is seen is farther from the camera than this.
        view_angle_min_deg: the lens's narrowest horizontal angle of view.
        view_angle_max_deg: the lens's widest horizontal angle of view.
        motion_sd_mm: standard deviation of the positions that the rig reads back, per axis.
        motion_sd_deg: standard deviation of the pans that the rig reads back. Both count in how sure a pose is told to
            be; the fit itself takes poses as read back.
    """

    distance_min_mm: float = 50.0
    distance_max_mm: float = 100_000.0
    view_angle_min_deg: float = 2.0
    view_angle_max_deg: float = 120.0
    motion_sd_mm: float = 0.0
    motion_sd_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_range("distance_mm", self.distance_min_mm, self.distance_max_mm, math.inf)
        _check_range("view_angle_deg", self.view_angle_min_deg, self.view_angle_max_deg, 180.0)
        for name, value in (("motion_sd_mm", self.motion_sd_mm), ("motion_sd_deg", self.motion_sd_deg)):
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{value} is no standard deviation", where=name, remedy="Give 0 or more")


@dataclass(frozen=True, slots=True)
class Effort:
    """How much work a step may take: more on cluttered photographs, less on clean views.

    Attributes:
        detections: detections of a view that are used at all, the detector's best: the last are bricks and panes.
        anchors: detections of a view that are tried as parts, the detector's best.
        per_part: detections that one part may be proposed for.
        focals: focal lengths tried for a proposal where the view leaves it open.
        proposals: (detection, part) pairs of the first view that become hypotheses.
        fresh: starts of a later view that are tried on all earlier views.
        tracked: hypotheses kept.
        refined: tracked hypotheses whose placement is refined with a new view, those first that match most of it.
        modes: image shifts tried for each tracked hypothesis in a new view.
        second_looks: leading hypotheses whose missed parts are looked for again along their outlines; 0: none.
        candidates: next views compared.
    """

    detections: int = 40
    anchors: int = 6
    per_part: int = 1
    focals: int = 3
    proposals: int = 2500
    fresh: int = 300
    tracked: int = 2500
    refined: int = 600
    modes: int = 1
    second_looks: int = 0
    candidates: int = 120

    @staticmethod
    def for_clutter(clutter: float) -> Effort:
        """What suits a detector with so many false detections a view."""
        if clutter <= 50.0:
            return Effort()
        return Effort(
            detections=1000,
            anchors=120,
            per_part=4,
            focals=3,
            proposals=600,
            fresh=200,
            tracked=300,
            modes=2,
            second_looks=40,
            candidates=120,
        )


@dataclass(frozen=True, slots=True)
class RecogniserSettings:
    """How to recognise.

    Attributes:
        mode: ``graded`` is the default likelihood of design §4, ``paper`` the paper to the letter.
        policy: name in the entry-point group ``rig.policies``.
        threshold: the run may end when one configuration holds this much probability, in (0, 1].
        max_views: views after which the run ends whatever is left.
        seed: of the random generator; the same seed gives the same run.
        detector: name in the entry-point group ``rig.detectors``.
        pose_sd_mm: go on until the camera's position is this sure, mm; ``None``: to 5 % of the distance to the parts.
        pose_sd_deg: go on until the camera's pan is this sure, degrees; ``None``: do not ask. Paper mode goes on
            for neither, but its answer tells whether they are met.
        bounds: what the bench knows about distances and the lens.
        mount: how the camera hangs on the rig.
        rates: how the detector behaves on this bench.
        effort: how much work a step may take.
        prior: file of a prior over places that was sampled off-line; ``None``: by area.

    Raises:
        InputError: a value is out of its range; names option, value and range.
    """

    mode: Mode = "graded"
    policy: str = "information"
    threshold: float = 0.99
    max_views: int = 12
    seed: int = 0
    detector: str = "segmentation"
    pose_sd_mm: float | None = None
    pose_sd_deg: float | None = None
    bounds: BenchBounds = field(default_factory=BenchBounds)
    mount: Mount = field(default_factory=Mount)
    rates: DetectionRates = field(default_factory=DetectionRates)
    effort: Effort = field(default_factory=Effort)
    prior: Path | None = None

    def __post_init__(self) -> None:
        if self.mode not in ("graded", "paper"):
            raise InputError(f"unknown mode {self.mode!r}", where="--mode", remedy="Choose graded or paper")
        if self.mode == "paper" and self.prior is not None:
            raise InputError(
                "paper mode has the paper's prior, by area", where="--prior", remedy="Leave it out, or take graded"
            )
        # `not (a <= v)` rather than `v < a`: NaN must not pass.
        if not 0.0 < self.threshold <= 1.0:
            raise InputError(
                f"{self.threshold} is not a probability above 0 and up to 1", where="--threshold", remedy="Try 0.99"
            )
        if not self.max_views >= 1:
            raise InputError(f"{self.max_views} views are too few", where="--max-views", remedy="Give 1 or more")
        if not self.seed >= 0:
            raise InputError(f"{self.seed} is negative", where="--seed", remedy="Give 0 or more")
        for name, value in (("--pose-sd-mm", self.pose_sd_mm), ("--pose-sd-deg", self.pose_sd_deg)):
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{value} is not a positive number", where=name, remedy="Give a value above 0")


def _check_range(name: str, lower: float, upper: float, limit: float) -> None:
    if not 0.0 < lower < upper <= limit:
        raise InputError(
            f"{lower}..{upper} is not a range of positive values in rising order",
            where=name,
            remedy=f"Give 0 < lower < upper{f' <= {limit:g}' if math.isfinite(limit) else ''}",
        )
