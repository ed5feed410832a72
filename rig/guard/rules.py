"""What a bench demands of every move: limits, keep-out boxes, approach, tolerances, homing. Values, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from rig.hal import AXES, AxisLimits, RigLimits

LINEAR = AXES[:3]

Homing = Literal["each_session", "remembered", "as_found"]


@dataclass(frozen=True, slots=True)
class Box:
    """A part of space that the mount's reference point stays out of; rig frame, mm.

    Attributes:
        name: for messages.
        lower, upper: opposite corners, the margin included.
        margin_mm: how much larger than the thing itself it has been made, for messages.
    """

    name: str
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    margin_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a pose that is read back may be from the one commanded, per axis."""

    mm: float = 0.05
    deg: float = 0.1
    zoom: float = 0.01

    def of(self, axis: str) -> float:
        """That of one axis, in its unit."""
        return {"theta_deg": self.deg, "zoom": self.zoom}.get(axis, self.mm)


@dataclass(frozen=True, slots=True)
class Offers:
    """The lattice of poses that a live rig offers as next views, counted from the axes' lower limits.

    Attributes:
        step_mm, step_deg: from one pose to the next.
        zooms: settings offered; empty: the ends of the zoom's travel.
        reach: steps to each side of where the rig stands.
    """

    step_mm: float = 40.0
    step_deg: float = 15.0
    zooms: tuple[float, ...] = ()
    reach: int = 2


@dataclass(frozen=True, slots=True)
class Rules:
    """All of it.

    Attributes:
        travel: where each axis may go and how fast; settling and exposure.
        keep_out: boxes that no move may touch.
        overshoot: axes that come to every place from one side, against backlash: how far they go past it first, in
            the axis's unit. Positive: they arrive rising, so they go below it first; negative: above.
        tolerance: between commanded and read back.
        stale_s: a status older than this blocks every move.
        homing: ``each_session``: nothing moves to a pose before `home` has succeeded since connecting.
            ``remembered``: that, unless the rig stands exactly where its last session left it homed. ``as_found``: the
            gantry's word is taken; an explicit override for machines that cannot home.
        unhomed_jog_mm: longest jog of a gantry that is not homed, along each axis; 0: none.
        internals_fixed_by_zoom: the camera's internals are the same whenever the zoom is the same.
        offers: next views.
    """

    travel: RigLimits
    keep_out: tuple[Box, ...] = ()
    overshoot: Mapping[str, float] = field(default_factory=dict)
    tolerance: Tolerance = Tolerance()
    stale_s: float = 1.0
    homing: Homing = "each_session"
    unhomed_jog_mm: float = 0.0
    internals_fixed_by_zoom: bool = False
    offers: Offers = Offers()

    @property
    def usable(self) -> RigLimits:
        """The travel less what the approaches against backlash need: every pose within can be come to."""
        x, y, z, theta, zoom = (_less(getattr(self.travel, axis), self.overshoot.get(axis, 0.0)) for axis in AXES)
        return replace(self.travel, x_mm=x, y_mm=y, z_mm=z, theta_deg=theta, zoom=zoom)


def _less(limit: AxisLimits, past: float) -> AxisLimits:
    return replace(limit, lower=limit.lower + max(past, 0.0), upper=limit.upper + min(past, 0.0))
