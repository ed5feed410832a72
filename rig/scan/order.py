"""The order in which a scan goes from place to place, and how it comes to each: to and fro, or always from one side."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from rig.guard.ways import Play, arrived, legs
from rig.hal import RigPose


@dataclass(frozen=True, slots=True)
class OneSided:
    """An axis whose every value is approached from the same side, so that its backlash always lies on that side.

    Attributes:
        axis: ``x_mm``, ``y_mm``, ``z_mm``, ``theta_deg`` or ``zoom``.
        side: from where: ``below`` means that the last motion rises.
        overshoot: how far to go past a value before coming back to it, in the axis's unit; more than the backlash.
    """

    axis: str
    side: Literal["below", "above"]
    overshoot: float


def serpentine(axes: Sequence[tuple[str, Sequence[float]]], sides: Iterable[OneSided] = ()) -> list[RigPose]:
    """All combinations of the axes' values, each axis to and fro, so that no row begins with a long way back.

    Args:
        axes: every axis with its values, the one that changes least often first.
        sides: these axes are gone through in their own direction every time instead.
    """
    one_sided = {side.axis: side for side in sides}
    rows: list[tuple[float, ...]] = [()]
    for axis, values in axes:
        side = one_sided.get(axis)
        forth = sorted(values, reverse=side is not None and side.side == "above")
        back = forth if side is not None else forth[::-1]
        rows = [(*row, value) for number, row in enumerate(rows) for value in (back if number % 2 else forth)]
    return [RigPose(**dict(zip([axis for axis, _ in axes], row, strict=True))) for row in rows]


def at_every_zoom(poses: Iterable[RigPose], zooms: Sequence[float], sides: Iterable[OneSided] = ()) -> list[RigPose]:
    """Each pose at each zoom setting, in the poses' order; the zoom goes to and fro unless it is one-sided."""
    one_sided = next((side for side in sides if side.axis == "zoom"), None)
    forth = sorted(zooms, reverse=one_sided is not None and one_sided.side == "above")
    back = forth if one_sided is not None else forth[::-1]
    return [replace(pose, zoom=zoom) for n, pose in enumerate(poses) for zoom in (back if n % 2 else forth)]


def overshoot(sides: Iterable[OneSided]) -> dict[str, float]:
    """How far past each value its axis goes first, as `rig.guard` tells it: positive where it arrives rising."""
    return {side.axis: side.overshoot if side.side == "below" else -side.overshoot for side in sides}


def all_legs(poses: Iterable[RigPose], sides: Iterable[OneSided] = ()) -> Iterator[RigPose]:
    """Every pose that a scan will be sent to, approaches included, in order.

    Where the rig comes from is not known, so to the first pose every one-sided axis makes its approach.
    """
    past, play = overshoot(sides), None
    for pose in poses:
        yield from legs(play or Play(pose), pose, past)
        play = arrived(pose, past)
