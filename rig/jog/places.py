"""Poses as a person types them, and as they are shown."""

from __future__ import annotations

import math
from dataclasses import replace

from rig.errors import InputError
from rig.hal import AXES, RigPose

SHORT = {"x_mm": "x", "y_mm": "y", "z_mm": "z", "theta_deg": "theta", "zoom": "zoom"}
UNITS = {"x_mm": "mm", "y_mm": "mm", "z_mm": "mm", "theta_deg": "°", "zoom": ""}
_NAMES = {**{short: axis for axis, short in SHORT.items()}, **{axis: axis for axis in AXES}, "pan": "theta_deg"}
_REMEDY = "Type x=120,theta=15 (the other axes stay), or all five: x,y,z,theta,zoom; mm, degrees and zoom 0 to 1"


def typed_pose(text: str, at: RigPose) -> RigPose:
    """A pose as typed: ``x=120,theta=15``, the other axes as in ``at``; or ``x,y,z,theta[,zoom]``.

    Raises:
        InputError: it is neither.
    """
    words = [word.strip() for word in text.split(",")]
    if all("=" in word for word in words):
        return replace(at, **dict(_told(word) for word in words))
    if len(words) not in (4, 5) or any("=" in word for word in words):
        raise InputError(f"{text!r} is not a pose", remedy=_REMEDY)
    return replace(at, **{axis: _number(word) for axis, word in zip(AXES, words, strict=False)})


def typed_reference(text: str) -> tuple[str, float]:
    """Where an axis stands: ``theta=0`` or ``zoom=0.5``.

    Raises:
        InputError: it says something else.
    """
    axis, value = _told(text.strip())
    if axis not in ("theta_deg", "zoom"):
        raise InputError(f"{SHORT[axis]} is not referenced by hand", remedy="Home the gantry instead")
    return axis, value


def typed_servo(text: str) -> str:
    """The axis of a servo as typed: ``pan`` (or ``theta``), or ``zoom``.

    Raises:
        InputError: it is neither.
    """
    axis = _NAMES.get(text.strip().lower())
    if axis not in ("theta_deg", "zoom"):
        raise InputError(f"{text.strip()} is no servo", remedy="Type pan or zoom")
    return axis


def shown(pose: RigPose) -> str:
    """``x 120.000  y -30.000  z 10.000 mm  theta 15.000°  zoom 0.500``."""
    x, y, z = pose.x_mm, pose.y_mm, pose.z_mm
    return f"x {x:.3f}  y {y:.3f}  z {z:.3f} mm  theta {pose.theta_deg:.3f}°  zoom {pose.zoom:.3f}"


def _told(word: str) -> tuple[str, float]:
    name, _, value = word.partition("=")
    axis = _NAMES.get(name.strip().lower())
    if axis is None:
        raise InputError(f"{name.strip()!r} is no axis", remedy=_REMEDY)
    return axis, _number(value)


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise InputError(f"{word.strip()!r} is not a number", remedy=_REMEDY) from None
    if not math.isfinite(value):
        raise InputError(f"{word.strip()!r} is not a finite number", remedy=_REMEDY)
    return value
