"""Switches a camera's automatics off and says what the device did not let: exposure, white balance, focus, gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.camera_settings import CameraSettings

_EXPOSURE_UNITS_PER_S = 1e4  # V4L2 counts exposure in 100 microseconds
_MANUAL_EXPOSURE = 1.0  # V4L2_EXPOSURE_MANUAL
_SLACK = 0.05


class Controls(Protocol):
    """What OpenCV's captures have: controls by number."""

    def set(self, prop: int, value: float) -> bool:
        """Set one; False: refused."""
        ...

    def get(self, prop: int) -> float:
        """Read one; -1 or 0 where the device has none."""
        ...


@dataclass(frozen=True, slots=True)
class Lock:
    """What became of one control.

    Attributes:
        name: ``exposure``, ``white_balance``, ``focus`` or ``gain``.
        held: it keeps the value that was meant.
        value: as read back, s, K, or the device's own unit; ``None``: it cannot be read.
        trouble: what the device did not let, for people; empty where it is held.
    """

    name: str
    held: bool
    value: float | None
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class _Control:
    name: str
    value_prop: int
    automatic_prop: int | None
    manual: float
    told: float | None
    units: float = 1.0


def lock_controls(device: Controls, settings: CameraSettings) -> tuple[Lock, ...]:
    """Lock what the bench does not leave automatic, at the told values or those that the automatics have found."""
    return tuple(_lock(device, control) for control in _controls(settings) if control.name not in settings.automatic)


def _controls(settings: CameraSettings) -> list[_Control]:
    import cv2

    controls = [
        _Control(
            "exposure",
            cv2.CAP_PROP_EXPOSURE,
            cv2.CAP_PROP_AUTO_EXPOSURE,
            _MANUAL_EXPOSURE,
            settings.exposure_s,
            _EXPOSURE_UNITS_PER_S,
        ),
        _Control("white_balance", cv2.CAP_PROP_WB_TEMPERATURE, cv2.CAP_PROP_AUTO_WB, 0.0, settings.white_balance_k),
        _Control("focus", cv2.CAP_PROP_FOCUS, cv2.CAP_PROP_AUTOFOCUS, 0.0, settings.focus),
    ]
    if settings.gain is not None:
        controls.append(_Control("gain", cv2.CAP_PROP_GAIN, None, 0.0, settings.gain))
    return controls


def _lock(device: Controls, control: _Control) -> Lock:
    found = device.get(control.value_prop)
    meant = found if control.told is None else control.told * control.units
    switched = control.automatic_prop is None or device.set(control.automatic_prop, control.manual)
    # Many devices fall back to an old manual value when the automatic goes off, so the value is set after it.
    taken = device.set(control.value_prop, meant)
    got = device.get(control.value_prop)
    if not switched and not taken:
        return Lock(control.name, held=False, value=None, trouble="the device offers no such control")
    value = got / control.units
    if control.automatic_prop is not None and device.get(control.automatic_prop) != control.manual:
        return Lock(control.name, held=False, value=value, trouble="the device keeps its automatic on")
    if not taken or abs(got - meant) > max(1.0, _SLACK * abs(meant)):
        wanted = f"{meant / control.units:g}"
        return Lock(control.name, held=False, value=value, trouble=f"the device holds {value:g} instead of {wanted}")
    return Lock(control.name, held=True, value=value)
