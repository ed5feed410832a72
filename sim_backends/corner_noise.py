"""What a simulated detector makes of the corners that a view shows: misses, false parts, wrong classes, noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.modelbase import PartClass
from recognition.parts import DetectedPart
from rig.errors import InputError
from sim_backends.internals_policy import ChangingInternals, FixedByZoom, InternalsPolicy

FloatArray = npt.NDArray[np.float64]

SURE, UNSURE = 0.95, 0.3
"""Scores of the class on top, and of the true one where another is on top."""
_LEAST_SIGMA_PX = 0.1
_SIZE_SPREAD, _SLOPE_SD = 0.3, 0.05
"""Of false parts: sd of the logarithm of width and height beside a true part's, and of the slope of top and bottom."""
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

Shown = Sequence[tuple[str, FloatArray]]
"""What a view shows: the class of each part, and its corners ``(n, 2)`` in pixels."""


@dataclass(frozen=True, slots=True)
class CornerNoise:
    """How far a simulated view is from the perfect one.

    Attributes:
        missed: share of the visible parts that are not found.
        false_parts: false detections per part found.
        class_errors: share of the parts found on which another class is on top.
        corner_sd_px: sd of a corner coordinate.
        motion_theta_sd_deg: sd of the true pan about the one read back, drawn for each pose.
        motion_sd_mm: sd of the true position about the one read back, per axis.
        focal_sd: relative spread of the focal length from view to view; aspect_sd: of fy / fx.
        centre_sd_px: spread of the principal point from view to view. If all three are 0, only the zoom changes them.

    Raises:
        InputError: a value is out of its range.
    """

    missed: float = 0.0
    false_parts: float = 0.0
    class_errors: float = 0.0
    corner_sd_px: float = 0.0
    motion_theta_sd_deg: float = 0.0
    motion_sd_mm: float = 0.0
    focal_sd: float = 0.05
    aspect_sd: float = 0.02
    centre_sd_px: float = 40.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{value} is not a finite number from 0 up", where=name)
            if name in ("missed", "class_errors") and value > 1.0:
                raise InputError(f"{value} is not a share from 0 to 1", where=name)

    def internals(self, size: tuple[int, int]) -> InternalsPolicy:
        """The camera's inside, for pictures of that size."""
        base = FixedByZoom.for_size(size)
        if not (self.focal_sd or self.aspect_sd or self.centre_sd_px):
            return base
        return ChangingInternals(base, self.focal_sd, self.aspect_sd, self.centre_sd_px)


def detections(
    shown: Shown,
    classes: Sequence[PartClass],
    noise: CornerNoise,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[DetectedPart, ...]:
    """What a detector with such faults returns for a view, in random order, all with the same confidence.

    A class error puts another class with as many corners on top; where there is none, the detector is only unsure. A
    false part has any class, any place, about the size of a part found, and sides as steep as the picture's: upright.

    Args:
        shown: parts and corners.
        classes: of the model base.
        noise: the faults.
        size: of the picture, pixels.
        rng: the view's own.
    """
    found = []
    for name, corners in shown:
        # Drawn for every part, so that what becomes of one part does not depend on another's fate.
        missed, confused, pick = rng.random(3)
        jitter = rng.standard_normal(corners.shape)
        if missed < noise.missed:
            continue
        scores = _confused(name, len(corners), classes, pick) if confused < noise.class_errors else {name: SURE}
        found.append(_part(corners + noise.corner_sd_px * jitter, scores, noise))
    false = [_false_part(found, classes, noise, size, rng) for _ in range(rng.poisson(noise.false_parts * len(found)))]
    every = [*found, *false]
    return tuple(every[int(k)] for k in rng.permutation(len(every)))


def _part(corners: FloatArray, scores: dict[str, float], noise: CornerNoise) -> DetectedPart:
    return DetectedPart(corners, scores, max(noise.corner_sd_px, _LEAST_SIGMA_PX))


def _confused(name: str, corners: int, classes: Sequence[PartClass], pick: float) -> dict[str, float]:
    others = [c.name for c in classes if c.corner_count == corners and c.name != name]
    if not others:
        return {name: UNSURE}
    return {others[int(pick * len(others))]: 0.9 - UNSURE, name: UNSURE}


def _false_part(
    found: Sequence[DetectedPart],
    classes: Sequence[PartClass],
    noise: CornerNoise,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> DetectedPart:
    kind = classes[int(rng.integers(len(classes)))]
    like = np.ptp(found[int(rng.integers(len(found)))].corners_px, axis=0)
    box = np.minimum(like * np.exp(rng.normal(0.0, _SIZE_SPREAD, 2)), np.array(size) - 1.0)
    outline = (_SQUARE if kind.canonical is None else kind.canonical) - 0.5
    # Upright cameras see the sides of upright parts upright; top and bottom fan out.
    slopes = rng.normal(0.0, _SLOPE_SD, 2)
    slope = np.where(outline[:, 1] < 0, slopes[0], slopes[1])
    corners = outline * box + np.stack([np.zeros(len(outline)), slope * outline[:, 0] * box[0]], axis=1)
    low, high = -corners.min(axis=0), np.array(size) - 1.0 - corners.max(axis=0)
    return _part(corners + rng.uniform(np.minimum(low, high), high), {kind.name: SURE}, noise)
