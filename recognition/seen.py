"""What one view contributes to matching, as arrays: the camera's known pose and the corners that were detected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose
from recognition.parts import DetectedPart

if TYPE_CHECKING:
    from recognition.detectors.edges import EdgeField

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEAST_CLASS_PROBABILITY = 0.02
"""A detection is never wholly excluded from a class with its number of corners: detectors confuse classes."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One view as matching needs it; D detections, C corners (padded by repeating the last), K classes.

    Attributes:
        camera: the camera in the rig frame (known from the move).
        image_size: width, height, px.
        group: which views share internals.
        zoom: the zoom setting, 0..1.
        corners_px: ``(D, C, 2)``.
        corner_count: ``(D,)``.
        sigma_px: ``(D,)`` sd of one corner coordinate.
        class_score: ``(D, K)``.
        likeness: ``(D,)`` how much each looks like a part beside the best of the view, 0..1.
        source: ``(D,)`` index of each in the detector's list.
        foremost: ``(D,)`` of the outlines that differ little from each, such as those within and without a reveal, the
            one that the detector likes best; itself if there is no better.
        edges: the picture prepared for a second look; ``None``: none is taken.
    """

    camera: CameraPose
    image_size: tuple[int, int]
    group: int
    zoom: float
    corners_px: FloatArray = field(repr=False)
    corner_count: IntArray = field(repr=False)
    sigma_px: FloatArray = field(repr=False)
    class_score: FloatArray = field(repr=False)
    likeness: FloatArray = field(repr=False)
    source: IntArray = field(repr=False)
    foremost: IntArray = field(repr=False)
    edges: EdgeField | None = field(default=None, repr=False)

    @property
    def count(self) -> int:
        """Number of detections."""
        return len(self.corner_count)

    @property
    def centre_px(self) -> FloatArray:
        """``(D, 2)`` middle of the bounding box."""
        return np.asarray((self.corners_px.max(axis=1) + self.corners_px.min(axis=1)) / 2)

    @property
    def size_px(self) -> FloatArray:
        """``(D, 2)`` bounding box."""
        return np.asarray(np.ptp(self.corners_px, axis=1))

    @property
    def camera_row(self) -> FloatArray:
        """``(4,)`` theta (radians), cx, cy, cz."""
        return np.array([np.radians(self.camera.theta_deg), *self.camera.centre_mm])


def see(
    parts: Sequence[DetectedPart],
    camera: CameraPose,
    image_size: tuple[int, int],
    group: int,
    zoom: float,
    class_names: Sequence[str],
    corners: int,
    edges: EdgeField | None = None,
) -> Seen:
    """Gather a view's detections as arrays padded to ``corners`` corners."""
    source = [i for i, p in enumerate(parts) if 4 <= len(p.corners_px) <= corners]
    usable = [parts[i] for i in source]
    polygons = [
        np.concatenate([p.corners_px, np.repeat(p.corners_px[-1:], corners - len(p.corners_px), axis=0)])
        for p in usable
    ]
    corners_px = np.array(polygons).reshape(-1, corners, 2)
    corner_count = np.array([len(p.corners_px) for p in usable], dtype=np.int64)
    scores = np.array([[p.class_scores.get(name, 0.0) for name in class_names] for p in usable])
    class_score = scores.reshape(-1, len(class_names))
    return Seen(
        camera=camera,
        image_size=image_size,
        group=group,
        zoom=zoom,
        corners_px=corners_px,
        corner_count=corner_count,
        sigma_px=np.array([p.sigma_px for p in usable]),
        class_score=class_score,
        likeness=_likeness(np.array([p.confidence for p in usable])),
        source=np.array(source, dtype=np.int64),
        foremost=_foremost(corners_px, corner_count, class_score),
        edges=edges,
    )


def _likeness(confidence: FloatArray) -> FloatArray:
    """``(D,)`` confidences by that of the best."""
    return np.asarray(confidence / max(float(confidence.max(initial=0.0)), 1e-9))


_ALIKE = 0.15


def _foremost(corners_px: FloatArray, corner_count: IntArray, class_score: FloatArray) -> IntArray:
    """``(D,)`` the first of the outlines ``(D, C, 2)`` that differ little from each: by some share of its size at most.

    They have as many corners and the same likeliest class. The detector's best come first.
    """
    near = _ALIKE * np.ptp(corners_px, axis=1).min(axis=1, initial=np.inf)
    likeliest = class_score.argmax(axis=1) if class_score.shape[1] else np.zeros(len(corners_px))
    first = np.arange(len(corners_px))
    for k in range(len(corners_px) - 1, -1, -1):
        alike = np.abs(corners_px - corners_px[k]).max(axis=(1, 2)) <= near[k]
        alike &= (corner_count == corner_count[k]) & (likeliest == likeliest[k])
        first[alike] = k
    return np.minimum(first, np.arange(len(corners_px)))
