"""Looks at the camera's newest picture at a modest rate, in its own thread, and says how sharp and bright it is."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rig.devices import Picture
from rig.errors import RigError
from rig.hal import Image
from rig.jog.measures import Exposure, exposure, sharpness

EVERY_S = 0.25
LARGEST_PX = 640
_REMEMBERED = 60


@dataclass(frozen=True, slots=True)
class Look:
    """A picture as it is shown.

    Attributes:
        small: no side longer than `LARGEST_PX`; ``(h, w)`` grey or ``(h, w, 3)`` BGR.
        sequence: the camera's number of it.
        exposed_at_s: monotonic.
        sharpness: see `rig.jog.measures.sharpness`, of the whole picture.
        exposure: of the whole picture.
        course: the sharpness of the last pictures, oldest first, this one included.
    """

    small: Image = field(repr=False)
    sequence: int
    exposed_at_s: float
    sharpness: float
    exposure: Exposure
    course: tuple[float, ...]


class Looker:
    """Keeps a `Look` at the newest picture. A context manager; everything heavy is done in its thread.

    Args:
        latest: the camera's newest picture (`rig.guard.Guard.latest`); any thread.
        every_s: real time between two looks.
    """

    def __init__(self, latest: Callable[[], Picture | None], *, every_s: float = EVERY_S) -> None:
        self._latest, self._every_s = latest, every_s
        self._course: deque[float] = deque(maxlen=_REMEMBERED)
        self._look: Look | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="jog picture", daemon=True)

    @property
    def look(self) -> Look | None:
        """The newest; ``None``: no picture has come."""
        return self._look

    def refresh(self) -> None:
        """Look once, if there is a picture that was not looked at."""
        try:
            picture = self._latest()
        except RigError:
            # Why the camera gives none is told by the guard's status; what is shown has its age beside it.
            return
        if picture is None or (self._look is not None and self._look.sequence == picture.sequence):
            return
        self._course.append(sharpness(picture.image))
        self._look = Look(
            small=shrunk(picture.image, LARGEST_PX),
            sequence=picture.sequence,
            exposed_at_s=picture.exposed_at_s,
            sharpness=self._course[-1],
            exposure=exposure(picture.image),
            course=tuple(self._course),
        )

    def __enter__(self) -> Looker:
        self._thread.start()
        return self

    def __exit__(self, *exc: Any) -> None:
        self._ended.set()
        self._thread.join()

    def _follow(self) -> None:
        while not self._ended.wait(self._every_s):
            self.refresh()


def shrunk(image: Image, largest_px: int) -> Image:
    """The picture, made smaller where a side is longer than that."""
    import cv2
    import numpy as np

    height, width = image.shape[:2]
    scale = largest_px / max(height, width)
    if scale >= 1.0:
        return image
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
