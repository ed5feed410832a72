"""A simulated bench on simulated time, put together by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from drivers.combined import CombinedRig
from drivers.stopping_all import one_after_another
from rig.devices import Clock, Triple
from rig.guard import Box, Event, Guard, Offers, Rules, State
from rig.hal import AxisLimits, RigLimits, RigPose
from sim_backends.simple_devices import (
    SimpleAxis,
    SimpleAxisSettings,
    SimpleCamera,
    SimpleCameraSettings,
    SimpleGantry,
    SimpleGantrySettings,
)
from sim_backends.simulated_clock import SimulatedClock

TRAVEL = RigLimits(
    AxisLimits(-200.0, 200.0, 100.0),
    AxisLimits(-150.0, 150.0, 100.0),
    AxisLimits(0.0, 250.0, 100.0),
    AxisLimits(-90.0, 90.0, 30.0),
    AxisLimits(0.0, 1.0, 0.5),
    settle_s=0.3,
    exposure_s=0.05,
)
MODEL = Box("model", (-50.0, -50.0, 100.0), (50.0, 50.0, 200.0), 20.0)
RULES = Rules(TRAVEL, keep_out=(MODEL,), offers=Offers(step_mm=60.0, step_deg=30.0, reach=1))


class Shifted:
    """A machine whose x runs against the rig's, with its zero in a corner."""

    def to_machine(self, place_mm: Triple) -> Triple:
        x, y, z = place_mm
        return (250.0 - x, y + 200.0, z)

    def to_rig(self, machine_mm: Triple) -> Triple:
        x, y, z = machine_mm
        return (250.0 - x, y - 200.0, z)

    def to_axis(self, theta_deg: float) -> float:
        return 10.0 - theta_deg

    def to_theta(self, axis_deg: float) -> float:
        return 10.0 - axis_deg


@dataclass
class Bench:
    """The devices, the guard, and what the guard's state has gone through."""

    clock: Any
    gantry: SimpleGantry
    pan: SimpleAxis
    zoom: SimpleAxis
    camera: SimpleCamera
    rig: CombinedRig
    guard: Guard
    transitions: list[tuple[State, Event, State]]
    motions: list[tuple[str, State]]

    @property
    def devices(self) -> tuple[SimpleGantry | SimpleAxis | SimpleCamera, ...]:
        return (self.gantry, self.pan, self.zoom, self.camera)


def bench(rules: Rules = RULES, clock: Clock | None = None, **others: Any) -> Bench:
    """A bench that is not connected; ``motions`` tells in which state of the guard each motion began."""
    clock = clock or SimulatedClock()
    stops = others.pop("stops", one_after_another)
    gantry = SimpleGantry(SimpleGantrySettings(homing=others.pop("homing", "required")), clock)
    pan = SimpleAxis(SimpleAxisSettings(lower=-100.0, upper=110.0), clock)
    zoom = SimpleAxis(SimpleAxisSettings(lower=0.0, upper=1.0, speed_per_s=0.5), clock)
    camera = SimpleCamera(SimpleCameraSettings(), clock)
    rig = CombinedRig(gantry, {"theta_deg": pan, "zoom": zoom}, camera, Shifted(), clock, stops=stops)
    transitions: list[tuple[State, Event, State]] = []
    guard = Guard(rig, rules, clock, seen=lambda *what: transitions.append(what), **others)
    made = Bench(clock, gantry, pan, zoom, camera, rig, guard, transitions, [])
    for device in (gantry, pan, zoom):
        device.on_motion = lambda kind, target: made.motions.append((kind, guard.state))
    return made


def homed(rules: Rules = RULES, **others: Any) -> Bench:
    """A bench that is connected, homed, and has been sent into its limits."""
    made = bench(rules, **others)
    made.guard.connect()
    made.guard.home()
    made.guard.move_to(START)
    return made


START = RigPose(-180.0, -140.0, 10.0, 0.0, 0.0)


def at(**axes: float) -> RigPose:
    """The start, some axes elsewhere."""
    return replace(START, **axes)
