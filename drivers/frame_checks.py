"""Finds faults of pictures: black, over-exposed, frozen, of the wrong size. Sharpness is only told, never judged."""

from __future__ import annotations

import enum
import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from drivers.camera_settings import PictureLimits
from rig.errors import HardwareError
from rig.hal import Image

_LOOKED_AT_PX = 320
"""Pictures are thinned to about so many rows and columns: shares of pixels need no more."""
_HASHED_ROWS = 240
_FRAMES_BACK = 8


class PictureFault(enum.Enum):
    """Why a picture cannot be used."""

    BLACK = "black"
    OVER_EXPOSED = "over-exposed"
    FROZEN = "frozen"
    WRONG_SIZE = "of the wrong size"


REMEDIES = {
    PictureFault.BLACK: "Is the lens covered, the light off, or the exposure far too short?",
    PictureFault.OVER_EXPOSED: "Shorten exposure_s, lower the gain, or dim the light",
    PictureFault.FROZEN: "Unplug the camera, plug it in and connect again",
    PictureFault.WRONG_SIZE: "Does another program change the camera's settings? Connect again",
}


class BadFrameError(HardwareError):
    """The camera gives pictures, but none that can be used. ``faults`` are those of the last one."""

    def __init__(self, message: str, faults: tuple[PictureFault, ...]) -> None:
        self.faults = faults
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class PictureLook:
    """What a picture looks like.

    Attributes:
        size: width and height, pixels.
        mean_level: mean of all pixels and channels, 0..255.
        top_level: 99.5 % of the pixels are at or below this level in their brightest channel, 0..255.
        saturated_share: share of the pixels whose channels are all saturated, 0..1.
        sharpness: variance of the Laplacian of the grey picture; compare it only between pictures of one scene.
    """

    size: tuple[int, int]
    mean_level: float
    top_level: float
    saturated_share: float
    sharpness: float


def look_at(image: Image, limits: PictureLimits) -> PictureLook:
    """Measure a picture."""
    import cv2

    height, width = image.shape[:2]
    thinned = np.ascontiguousarray(image[:: max(1, height // _LOOKED_AT_PX), :: max(1, width // _LOOKED_AT_PX)])
    channels = cv2.split(thinned)
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    brightest, darkest = reduce(cv2.max, channels), reduce(cv2.min, channels)
    spread = cv2.meanStdDev(cv2.Laplacian(grey, cv2.CV_16S, ksize=1))[1]
    return PictureLook(
        size=(width, height),
        mean_level=float(thinned.mean()),
        top_level=float(
            np.searchsorted(np.bincount(brightest.ravel(), minlength=256).cumsum(), 0.995 * brightest.size)
        ),
        saturated_share=float((darkest >= limits.bright_level).mean()),
        sharpness=float(spread[0, 0]) ** 2,
    )


def faults_of(
    look: PictureLook, limits: PictureLimits, *, size: tuple[int, int] | None, repeats: bool
) -> tuple[PictureFault, ...]:
    """The faults of a picture that the bench does not allow, the one that explains most first.

    Args:
        look: of the picture.
        limits: of the bench.
        size: width and height that it should have; ``None``: any.
        repeats: it has the same bytes as one of the frames before it.
    """
    found = {
        PictureFault.WRONG_SIZE: size is not None and look.size != size,
        PictureFault.BLACK: look.top_level <= limits.black_level,
        PictureFault.OVER_EXPOSED: look.saturated_share > limits.bright_share,
        PictureFault.FROZEN: repeats,
    }
    return tuple(fault for fault, there in found.items() if there and fault.value not in limits.allow)


def told(look: PictureLook, limits: PictureLimits, faults: Sequence[PictureFault]) -> str:
    """The first fault in words, with value, limit and remedy."""
    value = {
        PictureFault.BLACK: f"99.5 % of it at or below level {look.top_level:.0f} (limit {limits.black_level:g})",
        PictureFault.OVER_EXPOSED: f"{look.saturated_share:.0%} saturated (limit {limits.bright_share:.0%})",
        PictureFault.FROZEN: "byte for byte an earlier one",
        PictureFault.WRONG_SIZE: f"{look.size[0]}x{look.size[1]}",
    }[faults[0]]
    return f"{faults[0].value}: {value}. {REMEDIES[faults[0]]}"


class RepeatWatch:
    """Notices frames with the same bytes as one of the last eight: a frozen camera, or a driver that serves its old
    buffers in turns. The noise of a sensor makes no two exposures alike."""

    def __init__(self) -> None:
        self._digests: deque[int] = deque(maxlen=_FRAMES_BACK)

    def repeats(self, image: Image) -> bool:
        """Whether this frame repeats an earlier one; remembers it."""
        rows = np.ascontiguousarray(image[:: max(1, image.shape[0] // _HASHED_ROWS)])
        digest = zlib.crc32(repr(image.shape).encode("ascii"), zlib.crc32(rows.data))
        seen = digest in self._digests
        self._digests.append(digest)
        return seen
