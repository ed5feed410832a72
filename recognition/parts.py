"""What detectors return: parts seen in one picture, with ordered corners and class scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from rig.hal import Image

if TYPE_CHECKING:
    from recognition.modelbase import PartClass

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DetectedPart:
    """A part found in a picture.

    Attributes:
        corners_px: ``(n, 2)`` u, v of the corners in the order of the part-class (for four corners: top-left,
            top-right, bottom-right, bottom-left as seen in the picture). Pixel (0, 0) is the centre of the top-left
            pixel.
        class_scores: part-class name to probability; sums to at most 1, the rest being "none of these".
        sigma_px: standard deviation of one corner coordinate, pixels.
        confidence: 0..1, how much this looks like a part at all (contrast, straightness of its edges).
    """

    corners_px: FloatArray = field(repr=False)
    class_scores: Mapping[str, float]
    sigma_px: float
    confidence: float = 1.0

    @property
    def part_class(self) -> str:
        """The most probable part-class."""
        return max(self.class_scores, key=lambda name: self.class_scores[name])


class Detector(Protocol):
    """Finds parts in a picture. Knows the part-classes, nothing of objects, poses or internals."""

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        """Return the parts found in an ``(h, w)`` or ``(h, w, 3)`` 8-bit picture, best first."""
        ...


class DetectorFactory(Protocol):
    """What the entry-point group ``rig.detectors`` holds: makes a detector for the part-classes of a model base."""

    def __call__(self, classes: Sequence[PartClass]) -> Detector:
        """Return a detector that knows these classes."""
        ...
