"""Simulated gantry, axis and camera that behave like devices but speak no wire: they take time, fail and go away.

Each has hands (`unplug`, `raise_alarm`, `get_stuck` ...) for whoever plays the fault, and tells an `on_motion` hook
whenever something begins to move. Time passes on the clock that they were given, a little at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from rig.devices import AxisStatus, Clock, GantryStatus, Identity, Motion, Picture, StopReport, Triple
from rig.errors import HardwareError, UnreachableError
from rig.hal import Image

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

TICK_S = 0.02
KEEP_POSITION = (2,)
"""Alarms after which the position is still known: a target beyond the soft limits."""


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class SimpleGantrySettings(_Strict):
    """Travel in machine coordinates, mm, and how long things take; ``trusted``: believed homed on connecting."""

    lower_mm: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    upper_mm: tuple[Finite, Finite, Finite] = (500.0, 400.0, 300.0)
    speed_mm_per_s: Positive = 100.0
    home_s: Positive = 5.0
    homing: Literal["required", "trusted"] = "required"

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if any(lo >= hi for lo, hi in zip(self.lower_mm, self.upper_mm, strict=True)):
            raise ValueError("lower_mm should be below upper_mm on every axis")
        return self


class SimpleAxisSettings(_Strict):
    """Travel and speed of one axis, in degrees or zoom 0..1."""

    lower: Finite = -180.0
    upper: Finite = 180.0
    speed_per_s: Positive = 30.0
    torque_at_stop: Literal["hold", "release"] = "hold"


class SimpleCameraSettings(_Strict):
    """Size and rate of the pictures."""

    width_px: Annotated[int, Field(ge=8, le=4096)] = 64
    height_px: Annotated[int, Field(ge=8, le=4096)] = 48
    frame_rate_hz: Positive = 25.0


@dataclass
class _Course:
    """A straight motion, or homing, until it ends or is broken off."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    seconds: float
    begun_s: float

    def at(self, now_s: float) -> tuple[float, ...]:
        share = min(1.0, (now_s - self.begun_s) / self.seconds) if self.seconds > 0.0 else 1.0
        return tuple(a + share * (b - a) for a, b in zip(self.start, self.end, strict=True))


class _Device:
    """A link that can be unplugged, motion that takes time, and a STOP that ends it."""

    def __init__(self, name: str, clock: Clock) -> None:
        self.name, self.clock = name, clock
        self.connected, self.plugged = False, True
        self.on_motion: Callable[[str, tuple[float, ...]], None] = lambda kind, target: None
        self.motion = Motion.IDLE
        self.stops = 0
        self.stuck = False
        self.status_age_s = 0.0
        self.stop_is_lost = False
        self._broken = ""

    def unplug(self) -> None:
        """Pull the plug: motion ends, and the link is gone until it is plugged in and connected again."""
        self.plugged = False
        self._broken = f"{self.name}: the link is gone. Check the cable, then connect again"

    def replug(self) -> None:
        """Plug it in again; nobody is connected by that."""
        self.plugged = True

    def get_stuck(self, stuck: bool = True) -> None:
        """Something is in the way: nothing moves, whatever is commanded."""
        self.stuck = stuck

    def close(self) -> None:
        """Release the link."""
        self.connected = False

    def _open(self) -> None:
        if not self.plugged:
            raise HardwareError(f"{self.name}: there is no such port. Plug it in")
        self.connected, self._broken = True, ""

    def _refuse_unlinked(self) -> None:
        if self._broken or not self.connected:
            raise HardwareError(self._broken or f"{self.name}: not connected. Connect first")

    def _run(self, kind: str, course: _Course, motion: Motion, place: Callable[[tuple[float, ...]], None]) -> None:
        """Let a motion happen; whatever breaks it off leaves the device where it was by then."""
        stops = self.stops
        self.on_motion(kind, course.end)
        self.motion = motion
        try:
            while not self.stuck and self.clock.now_s() < course.begun_s + course.seconds:
                self.clock.sleep_s(min(TICK_S, course.begun_s + course.seconds - self.clock.now_s()))
                if self.stops != stops:
                    raise HardwareError(f"{self.name}: stopped by STOP. Release it before moving again")
                if self._broken:
                    raise HardwareError(self._broken)
                place(course.at(self.clock.now_s()))
        finally:
            if self.motion is motion:
                self.motion = Motion.IDLE
        if self.stuck:
            raise HardwareError(f"{self.name}: it does not move. Look what is in its way")

    def _stopped(self, position_kept: bool) -> StopReport:
        self.stops += 1
        if self.stop_is_lost or not self.plugged:
            return StopReport(None, confirmed=False, position_kept=False, trouble="STOP could not be sent: no link")
        return StopReport(self.clock.now_s(), confirmed=True, position_kept=position_kept)


class SimpleGantry(_Device):
    """A `rig.devices.LiveGantry`."""

    Settings = SimpleGantrySettings

    def __init__(self, settings: SimpleGantrySettings, clock: Clock) -> None:
        super().__init__("simulated gantry", clock)
        self.settings = settings
        self.homed = False
        self.alarm: int | None = None
        self.place_mm: Triple = settings.lower_mm

    def raise_alarm(self, number: int) -> None:
        """An alarm: motion ends; most alarms lose the position."""
        self.alarm, self.motion = number, Motion.ALARM
        self.homed = self.homed and number in KEEP_POSITION
        self._broken = self._broken or f"{self.name}: ALARM:{number}. Look what is wrong, then unlock or home it"

    def restart(self) -> None:
        """The controller restarts by itself: the position is lost."""
        self.homed, self.alarm, self.motion = False, None, Motion.IDLE
        self._broken = "" if self.plugged else self._broken
        self.stops += 1

    def connect(self) -> Identity:
        """See `LiveGantry`."""
        self._open()
        self.homed = self.settings.homing == "trusted" and self.alarm is None
        return Identity("simulated gantry", "1", "nowhere")

    def status(self) -> GantryStatus:
        """See `LiveGantry`."""
        if self.alarm is None or not self.plugged:
            self._refuse_unlinked()
        trouble = f"ALARM:{self.alarm}" if self.alarm is not None else "" if self.homed else "not homed"
        return GantryStatus(
            self.motion,
            self.place_mm if self.homed else None,
            self.homed,
            self.clock.now_s() - self.status_age_s,
            self.alarm,
            trouble,
        )

    def home(self) -> GantryStatus:
        """See `LiveGantry`."""
        if self.alarm is not None and self.plugged:
            self.alarm, self.motion, self._broken = None, Motion.IDLE, ""
        self._refuse_unlinked()
        self.homed = False
        end = self.settings.lower_mm
        course = _Course(self.place_mm, end, self.settings.home_s, self.clock.now_s())
        self._run("home", course, Motion.HOMING, self._stand_at)
        self.homed = True
        return self.status()

    def move_to(self, x_mm: float, y_mm: float, z_mm: float) -> Triple:
        """See `LiveGantry`."""
        self._refuse_outside((x_mm, y_mm, z_mm))
        self._refuse_unlinked()
        if not self.homed:
            raise HardwareError(f"{self.name}: not homed. Home it first (`rig home`)")
        self._go("move", (x_mm, y_mm, z_mm), Motion.MOVING)
        return self.place_mm

    def jog(self, dx_mm: float, dy_mm: float, dz_mm: float) -> Triple:
        """See `LiveGantry`."""
        x, y, z = self.place_mm
        target = (x + dx_mm, y + dy_mm, z + dz_mm)
        if self.homed:
            self._refuse_outside(target)
        self._refuse_unlinked()
        self._go("jog", target, Motion.JOGGING)
        return self.place_mm

    def unlock(self) -> GantryStatus:
        """See `LiveGantry`."""
        if self.alarm not in (None, *KEEP_POSITION):
            raise HardwareError(f"{self.name}: ALARM:{self.alarm} has lost the position. Home it (`rig home`)")
        self.alarm, self.motion = None, Motion.IDLE
        self._broken = "" if self.plugged else self._broken
        return self.status()

    def stop(self) -> StopReport:
        """See `LiveGantry`."""
        # Homing that is broken off leaves no position.
        return self._stopped(self.motion is not Motion.HOMING)

    def _go(self, kind: str, target: Triple, motion: Motion) -> None:
        course = _Course(self.place_mm, target, math.dist(self.place_mm, target) / self.settings.speed_mm_per_s,
                         self.clock.now_s())  # fmt: skip
        self._run(kind, course, motion, self._stand_at)
        self.place_mm = target

    def _stand_at(self, place: tuple[float, ...]) -> None:
        x, y, z = place
        self.place_mm = (x, y, z)

    def _refuse_outside(self, target: Triple) -> None:
        for axis, value, lo, hi in zip("xyz", target, self.settings.lower_mm, self.settings.upper_mm, strict=True):
            if not (math.isfinite(value) and lo - 1e-6 <= value <= hi + 1e-6):
                raise UnreachableError(f"{self.name}: {axis} = {value:g} is outside {lo:g} .. {hi:g}")


class SimpleAxis(_Device):
    """A `rig.devices.LiveAxis`."""

    Settings = SimpleAxisSettings

    def __init__(self, settings: SimpleAxisSettings, clock: Clock) -> None:
        super().__init__("simulated axis", clock)
        self.settings = settings
        self.referenced, self.torque = True, False
        self.overheated = False
        self.angle = min(max(0.0, settings.lower), settings.upper)

    def lose_power(self) -> None:
        """A power cut: torque is off, and the count of turns is lost."""
        self.referenced = self.torque = False
        self.stops += 1

    def overheat(self) -> None:
        """A hardware error: torque is off until it is rebooted."""
        self.overheated, self.torque, self.motion = True, False, Motion.ALARM
        self.stops += 1

    def connect(self) -> Identity:
        """See `LiveAxis`."""
        self._open()
        return Identity("simulated axis", "1", "nowhere")

    def status(self) -> AxisStatus:
        """See `LiveAxis`."""
        self._refuse_unlinked()
        trouble = "overheated. Let it cool, then reboot it" if self.overheated else ""
        trouble = trouble or ("" if self.referenced else "it has rebooted: say where it stands")
        return AxisStatus(
            self.motion,
            self.angle if self.referenced else None,
            self.referenced,
            self.clock.now_s() - self.status_age_s,
            torque=self.torque,
            temperature_c=85.0 if self.overheated else 30.0,
            voltage_v=12.0,
            load=0.0,
            trouble=trouble,
        )

    def enable(self) -> AxisStatus:
        """See `LiveAxis`."""
        self._refuse_unlinked()
        if self.overheated or not self.referenced:
            raise HardwareError(f"{self.name}: it cannot be enabled: {self.status().trouble}")
        self.torque = True
        return self.status()

    def move_to(self, position: float) -> float:
        """See `LiveAxis`."""
        self._refuse_outside(position)
        self._refuse_unlinked()
        if not (self.torque and self.referenced):
            raise HardwareError(f"{self.name}: torque is off. Enable it first")
        seconds = abs(position - self.angle) / self.settings.speed_per_s
        course = _Course((self.angle,), (position,), seconds, self.clock.now_s())
        self._run("turn", course, Motion.MOVING, self._stand_at)
        self.angle = position
        return self.angle

    def reference(self, position: float) -> AxisStatus:
        """See `LiveAxis`."""
        self._refuse_outside(position)
        self._refuse_unlinked()
        self.angle, self.referenced, self.torque = position, True, False
        return self.status()

    def reboot(self) -> AxisStatus:
        """See `LiveAxis`."""
        self._refuse_unlinked()
        self.overheated, self.motion = False, Motion.IDLE
        self.referenced = self.torque = False
        return self.status()

    def stop(self) -> StopReport:
        """See `LiveAxis`."""
        report = self._stopped(position_kept=True)
        if self.settings.torque_at_stop == "release" and report.confirmed:
            self.torque = False
        return report

    def close(self) -> None:
        """See `LiveAxis`; torque is released."""
        if self.connected and self._broken:
            self.connected = False
            raise HardwareError(f"{self.name}: torque could not be released. Switch its power off")
        if self.connected:
            self.torque = False
        self.connected = False

    def _stand_at(self, place: tuple[float, ...]) -> None:
        (self.angle,) = place

    def _refuse_outside(self, position: float) -> None:
        if not (math.isfinite(position) and self.settings.lower - 1e-6 <= position <= self.settings.upper + 1e-6):
            low, high = self.settings.lower, self.settings.upper
            raise UnreachableError(f"{self.name}: {position:g} is outside {low:g} .. {high:g}")


class SimpleCamera(_Device):
    """A `rig.devices.LiveCamera`: exposures begin at whole frame periods; ``scene`` paints them."""

    Settings = SimpleCameraSettings

    def __init__(self, settings: SimpleCameraSettings, clock: Clock) -> None:
        super().__init__("simulated camera", clock)
        self.settings = settings
        self.frozen = False
        self.scene: Callable[[int], Image] = self._numbered
        self._latest: Picture | None = None

    def connect(self) -> Identity:
        """See `LiveCamera`."""
        self._open()
        return Identity("simulated camera", "1", "nowhere")

    def capture(self, after_s: float) -> Picture:
        """See `LiveCamera`."""
        self._refuse_unlinked()
        sequence = math.floor(after_s * self.settings.frame_rate_hz) + 1
        begins_s = sequence / self.settings.frame_rate_hz
        # The frame is there once it is exposed: one period later.
        self.clock.sleep_s(max(0.0, begins_s + 1.0 / self.settings.frame_rate_hz - self.clock.now_s()))
        if self._broken:
            raise HardwareError(self._broken)
        if self.frozen:
            raise HardwareError(f"{self.name}: it is frozen. Unplug it and plug it in again")
        self._latest = Picture(self.scene(sequence), sequence, begins_s)
        return self._latest

    def latest(self) -> Picture | None:
        """See `LiveCamera`."""
        return self._latest

    def _numbered(self, sequence: int) -> Image:
        image = np.full((self.settings.height_px, self.settings.width_px), 128, np.uint8)
        image[0] = sequence % 256
        return image
