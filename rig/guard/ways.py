"""Whether poses, and the straight ways between them, may be gone: limits, keep-out boxes, approaches. All pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

from rig.errors import UnreachableError
from rig.guard.rules import LINEAR, Box, Rules
from rig.hal import AXES, AxisLimits, RigLimits, RigPose

Point = tuple[float, float, float]
_SAME = 1e-9
_OUTWARDS = 1e-6


def refuse_outside(pose: RigPose, limits: RigLimits, what: str = "", *, axes: Sequence[str] = AXES) -> None:
    """Refuse a pose that is not finite or beyond a limit on any of the axes. Nothing is ever clipped.

    Raises:
        UnreachableError: names axis, value and limit.
    """
    for axis in axes:
        value, limit = getattr(pose, axis), getattr(limits, axis)
        # Written so that a value which is not a number is outside.
        if not (math.isfinite(value) and limit.lower - _SAME <= value <= limit.upper + _SAME):
            raise UnreachableError(
                f"{what}{axis} = {value:g} is outside {limit.lower:g} .. {limit.upper:g}. "
                "Choose a pose within the limits"
            )


def refuse_inside(pose: RigPose, boxes: Iterable[Box]) -> None:
    """Refuse a pose in a keep-out box.

    Raises:
        UnreachableError: names the box.
    """
    for box in boxes:
        if _depth(_point(pose), box) >= 0.0:
            raise UnreachableError(f"{_words(pose)} lies within {_box_words(box)}. Choose a pose outside it")


def refuse_way(start: RigPose, end: RigPose, boxes: Iterable[Box]) -> None:
    """Refuse a straight way that touches a keep-out box. One that begins inside may only lead out.

    Raises:
        UnreachableError: names the box.
    """
    for box in boxes:
        if _touches(_point(start), _point(end), box):
            raise UnreachableError(
                f"the way from {_words(start)} to {_words(end)} leads through {_box_words(box)}. "
                "Go round it by way of another pose"
            )


@dataclass(frozen=True, slots=True)
class Play:
    """What is known of the backlash: where the rig was last sent, and the axes whose play is taken up there."""

    at: RigPose
    taken_up: frozenset[str] = frozenset()


def legs(play: Play, target: RigPose, overshoot: Mapping[str, float]) -> list[RigPose]:
    """The straight moves to a pose: there, or first past it on the axes that would arrive from the wrong side."""
    past = {}
    for axis, beyond in overshoot.items():
        gap = getattr(target, axis) - getattr(play.at, axis)
        still_taken_up = axis in play.taken_up and gap * math.copysign(1.0, beyond) >= -_SAME
        if beyond and not still_taken_up:
            past[axis] = getattr(target, axis) - beyond
    return [replace(target, **past), target] if past else [target]


def arrived(target: RigPose, overshoot: Mapping[str, float]) -> Play:
    """What is known once all legs to a pose are done."""
    return Play(target, frozenset(axis for axis, beyond in overshoot.items() if beyond))


def plan(rules: Rules, play: Play, target: RigPose) -> list[RigPose]:
    """The checked moves to a pose.

    Raises:
        UnreachableError: the pose is outside the limits or in a keep-out box, or its way touches one.
    """
    refuse_outside(target, rules.usable)
    refuse_inside(target, rules.keep_out)
    ways = legs(play, target, rules.overshoot)
    for leg in ways:
        refuse_outside(leg, rules.travel)
    for start, end in pairwise((play.at, *ways)):
        refuse_way(start, end, rules.keep_out)
    return ways


def preflight(rules: Rules, play: Play | None, poses: Sequence[RigPose]) -> None:
    """Refuse a whole plan of which any pose, or any way between two, is not allowed.

    Args:
        rules: of the bench.
        play: where the rig stands; ``None``: not known, so the way to the first pose is checked when it is gone.
        poses: in the order in which they will be gone to.

    Raises:
        UnreachableError: names the first such pose by its number in the plan, and the reason.
    """
    for number, pose in enumerate(poses, start=1):
        try:
            plan(rules, play or Play(pose), pose)
        except UnreachableError as error:
            raise UnreachableError(f"pose {number} of {len(poses)}: {error}") from error
        play = arrived(pose, rules.overshoot)


def seconds(limits: RigLimits, start: RigPose, end: RigPose) -> float:
    """Travel of gantry, pan and zoom one after the other, settling and exposure included."""
    took = {axis: abs(getattr(end, axis) - getattr(start, axis)) / getattr(limits, axis).speed_per_s for axis in AXES}
    gantry = max(took[axis] for axis in LINEAR)
    return float(gantry + took["theta_deg"] + took["zoom"] + limits.settle_s + limits.exposure_s)


def _point(pose: RigPose) -> Point:
    return (pose.x_mm, pose.y_mm, pose.z_mm)


def _words(pose: RigPose) -> str:
    return f"({pose.x_mm:g}, {pose.y_mm:g}, {pose.z_mm:g}) mm"


def _box_words(box: Box) -> str:
    margin = f", its margin of {box.margin_mm:g} mm included" if box.margin_mm else ""
    sides = ", ".join(f"{lo:g} .. {hi:g}" for lo, hi in zip(box.lower, box.upper, strict=True))
    return f"the keep-out box '{box.name}' ({sides} mm{margin})"


def _depth(point: Point, box: Box) -> float:
    """How deep inside a box a point is, mm; negative outside."""
    return min(min(p - lo, hi - p) for p, lo, hi in zip(point, box.lower, box.upper, strict=True))


def _touches(start: Point, end: Point, box: Box) -> bool:
    steps = [b - a for a, b in zip(start, end, strict=True)]
    depth = _depth(start, box)
    if depth >= 0.0:
        # The depth is concave along a straight way: if it falls at first it falls until the way has left the box,
        # and a straight way never comes back into a box that it has left.
        a_little_on = tuple(a + _OUTWARDS * step for a, step in zip(start, steps, strict=True))
        still = not any(steps)
        return not still and _depth((a_little_on[0], a_little_on[1], a_little_on[2]), box) >= depth
    enters, leaves = 0.0, 1.0
    for a, step, lo, hi in zip(start, steps, box.lower, box.upper, strict=True):
        if step == 0.0:
            if not lo <= a <= hi:
                return False
            continue
        near, far = sorted(((lo - a) / step, (hi - a) / step))
        enters, leaves = max(enters, near), min(leaves, far)
    return enters <= leaves


def offers(rules: Rules, near: RigPose) -> list[RigPose]:
    """The poses of the bench's lattice around one, as far as they may be gone to from there."""
    usable, lattice = rules.usable, rules.offers
    steps = (*[lattice.step_mm] * 3, lattice.step_deg)
    values = [
        _lattice_values(getattr(usable, axis), step, getattr(near, axis), lattice.reach)
        for axis, step in zip(AXES, steps, strict=False)
    ]
    zooms = [z for z in lattice.zooms if usable.zoom.lower <= z <= usable.zoom.upper]
    zooms = zooms or sorted({usable.zoom.lower, usable.zoom.upper})
    return [pose for pose in (RigPose(*place) for place in product(*values, zooms)) if _free(rules, near, pose)]


def _free(rules: Rules, start: RigPose, end: RigPose) -> bool:
    try:
        plan(rules, Play(start), end)
    except UnreachableError:
        return False
    return True


def _lattice_values(limit: AxisLimits, step: float, near: float, reach: int) -> list[float]:
    """The lattice's values of one axis (counted from its lower limit) around ``near``, within the limit."""
    home = round((near - limit.lower) / step)
    values = [limit.lower + (home + k) * step for k in range(-reach, reach + 1)]
    return [value for value in values if limit.lower <= value <= limit.upper + _SAME]
