"""How sharp a picture is and how it is exposed, in numbers that a person can steer by. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.hal import Image

DARK, BRIGHT = 2, 253
"""Grey values up to and from which a pixel tells nothing: black noise, and clipped."""
_MOST_BRIGHT, _MOST_DARK = 0.02, 0.5
_LEAST_MEAN, _MOST_MEAN = 0.1, 0.85


@dataclass(frozen=True, slots=True)
class Exposure:
    """How a picture is exposed.

    Attributes:
        mean: brightness, 0..1.
        dark: share of the pixels that are black, 0..1.
        bright: share of the pixels with a clipped channel, 0..1.
    """

    mean: float
    dark: float
    bright: float

    @property
    def verdict(self) -> str:
        """In a word, for people."""
        if self.bright > _MOST_BRIGHT or self.mean > _MOST_MEAN:
            return "over-exposed"
        return "too dark" if self.dark > _MOST_DARK or self.mean < _LEAST_MEAN else "good"


def sharpness(image: Image) -> float:
    """Standard deviation of the Laplacian, in percent of the mean brightness (after Pech-Pacheco et al., 2000).

    It rises up to the best focus. A share of the brightness, so that it does not change with the exposure; it does with
    what is seen: compare it only at one place and one zoom. 0 for a black picture.
    """
    import cv2

    grey = _grey(image)
    mean = float(grey.mean())
    return 100.0 * float(cv2.Laplacian(grey, cv2.CV_32F).std()) / mean if mean > 0.0 else 0.0


def exposure(image: Image) -> Exposure:
    """Brightness, and the shares of pixels at either end of the scale."""
    brightest = image if image.ndim == 2 else image.max(axis=2)
    return Exposure(
        mean=float(_grey(image).mean()) / 255.0,
        dark=float(np.count_nonzero(brightest <= DARK)) / brightest.size,
        bright=float(np.count_nonzero(brightest >= BRIGHT)) / brightest.size,
    )


def _grey(image: Image) -> Image:
    import cv2

    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
