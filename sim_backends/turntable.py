"""A bench with one axis: the camera looks from afar at an object that turns on its rotary, the whole of it in view.

To the object it is all one whether it turns or the camera goes round it: the rig's only moving axis is its rotary, and
the camera hangs on it by an arm as long as the distance, looking at the rotary's axis.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from recognition.geometry import Pose4
from recognition.modelbase import ObjectModel
from rig.hal import AxisLimits, RigLimits, RigPose
from sim_backends.internals_policy import FixedByZoom
from sim_backends.renderer import DEFAULT_SIZE
from sim_backends.viewpoints import limits_around

FloatArray = npt.NDArray[np.float64]

STEP_DEG = 15.0
_FILLED = 0.8
"""Share of the picture's width or height that the object fills at most: its place and the internals may be off."""


def distance_mm(things: Iterable[ObjectModel]) -> float:
    """From the rotary's axis to the camera, so that the whole of any of the objects is in view, however turned."""
    return max(_distance_mm(thing) for thing in things)


def _distance_mm(thing: ObjectModel) -> float:
    low, high = _extent(thing)
    inner = FixedByZoom()
    radius = float(np.hypot(*(high - low)[[0, 2]])) / 2
    across = 2.0 * radius * inner.f_wide_px / (_FILLED * DEFAULT_SIZE[0])
    upwards = float((high - low)[1]) * inner.f_wide_px / (_FILLED * DEFAULT_SIZE[1])
    return radius + max(across, upwards)


def placed(thing: ObjectModel, rng: np.random.Generator) -> Pose4:
    """Object -> rig: its middle near the rotary's axis, turned anyhow."""
    low, high = _extent(thing)
    turn = float(rng.uniform(-180.0, 180.0))
    off = rng.uniform(-0.02, 0.02, 3) * _distance_mm(thing)
    return Pose4.of(turn, off - Pose4(turn, 0.0, 0.0, 0.0).rotation @ ((low + high) / 2))


def poses() -> list[RigPose]:
    """All settings of the rotary."""
    return [RigPose(0.0, 0.0, 0.0, float(turn)) for turn in np.arange(-180.0, 180.0, STEP_DEG)]


def limits() -> RigLimits:
    """Only the rotary moves."""
    still = AxisLimits(0.0, 0.0, 100.0)
    return replace(limits_around(poses()), x_mm=still, y_mm=still, z_mm=still, zoom=AxisLimits(0.0, 0.0, 0.5))


def _extent(thing: ObjectModel) -> tuple[FloatArray, FloatArray]:
    points = np.concatenate([part.corners_mm for part in thing.parts])
    return points.min(axis=0), points.max(axis=0)
