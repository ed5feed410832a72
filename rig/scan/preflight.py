"""What is known of a scan before anything moves: that every pose can be reached, how long it takes, and if it fits."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Protocol, runtime_checkable

from rig.errors import InputError, UnreachableError
from rig.hal import Rig, RigPose
from rig.imagegrid.entry import pose_key

LINE_BYTES = 1024
"""What a picture's line and its rounding up to whole blocks take at most, about."""
SPARE_BYTES = 64 * 1024 * 1024
"""Left free on the disk: others write there too."""
GROWTH = 1.25
"""How much larger than the first picture others may be: a bare wall compresses better than a façade."""


@runtime_checkable
class Preflights(Protocol):
    """A rig that checks whole plans itself: limits, keep-out volumes, and the ways between the poses."""

    def preflight(self, poses: Sequence[RigPose]) -> None:
        """Return if all poses can be reached in this order.

        Raises:
            UnreachableError: one cannot; names axis, value and limit.
        """
        ...


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a scan will take.

    Attributes:
        frames: pictures that are to be taken.
        seconds: of motion, settling and exposure.
        bytes_needed: of disk, with a margin.
        bytes_free: of disk.
    """

    frames: int
    seconds: float
    bytes_needed: int
    bytes_free: int


def preflight(rig: Rig, poses: Sequence[RigPose]) -> None:
    """Refuse a scan of which any pose cannot be reached. Nothing moves.

    Args:
        rig: is asked: by its own `preflight` if it has one, otherwise if its nearest reachable pose is the pose itself.
        poses: all that the rig will be sent to, approaches included.

    Raises:
        UnreachableError: names the first pose that cannot be reached, why, and how many there are.
    """
    if isinstance(rig, Preflights):
        rig.preflight(poses)
        return
    refused = [reason for pose in poses if (reason := _unreachable(rig, pose)) is not None]
    if refused:
        raise UnreachableError(f"{len(refused)} of {len(poses)} poses cannot be reached. The first: {refused[0]}")


def _unreachable(rig: Rig, pose: RigPose) -> str | None:
    try:
        near = rig.nearest(pose)
    except UnreachableError as error:
        return str(error)
    if pose_key(near) == pose_key(pose):
        return None
    return f"{pose}; the nearest that can be is {near}. Change the plan, or its overshoot"


def travel_seconds(rig: Rig, poses: Iterable[RigPose]) -> float:
    """Seconds of motion, settling and exposure from where the rig stands through all the poses."""
    return sum(rig.travel_s(start, end) for start, end in pairwise((rig.pose, *poses)))


def estimate(rig: Rig, frames: int, legs: Sequence[RigPose], picture_bytes: float, folder: Path) -> Estimate:
    """What a scan will take.

    Args:
        rig: for the speeds, and for where it begins.
        frames: pictures that are to be taken.
        legs: all that the rig will be sent to, approaches included.
        picture_bytes: of one picture, encoded.
        folder: where they go; need not be there yet.
    """
    there = next(f for f in (folder, *folder.absolute().parents) if f.exists())
    return Estimate(
        frames=frames,
        seconds=travel_seconds(rig, legs),
        bytes_needed=round(frames * (GROWTH * picture_bytes + LINE_BYTES)),
        bytes_free=shutil.disk_usage(there).free,
    )


def refuse_small_disk(expected: Estimate, folder: Path) -> None:
    """Refuse a scan that does not fit.

    Raises:
        InputError: tells what is needed and what is free.
    """
    needed = expected.bytes_needed + SPARE_BYTES if expected.frames else 0
    if needed > expected.bytes_free:
        raise InputError(
            f"{expected.frames} pictures need {size_words(needed)}, and {size_words(expected.bytes_free)} are free",
            where=str(folder),
            remedy="Free some space, name a folder on another disk, or store JPEG (`picture: {format: jpg}`)",
        )


def size_words(count: float) -> str:
    """A number of bytes, for people."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def time_words(seconds: float) -> str:
    """A span of time, for people."""
    minutes = round(seconds / 60)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"
