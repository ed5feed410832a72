"""What goes wrong with an emulated camera, and when."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass


class CameraFaultKind(enum.Enum):
    """What can go wrong."""

    FREEZE = "freeze"
    """Frames come, but all show the last one before it, byte for byte."""
    BLACK = "black"
    """Frames come, but no light: noise alone."""
    OVER_EXPOSED = "over-exposed"
    """Frames come eight times too bright."""
    DROPPED = "dropped"
    """Frames are exposed, and lost on the way."""
    HANG = "hang"
    """Nothing comes; a read waits."""
    UNPLUG = "unplug"
    """Reads fail at once; opening too."""
    WRONG_SIZE = "wrong size"
    """Frames come in half the size."""


@dataclass(frozen=True, slots=True)
class CameraFault:
    """One fault: from when, and for how long.

    Attributes:
        kind: what goes wrong.
        at_s: begin, seconds on the emulator's clock.
        seconds: how long it lasts; 0: for good.
    """

    kind: CameraFaultKind
    at_s: float
    seconds: float = 0.0

    @property
    def until_s(self) -> float:
        """When it is over."""
        return self.at_s + self.seconds if self.seconds > 0.0 else math.inf


def at_work(faults: Sequence[CameraFault], kind: CameraFaultKind, now_s: float) -> bool:
    """Whether a fault of that kind is at work at that time."""
    return any(fault.kind is kind and fault.at_s <= now_s < fault.until_s for fault in faults)
