"""Whatever wire and servos do, no axis says that it has arrived where it has not, and nothing forbidden is sent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from calibration_free_tests.servos.workbench import Workbench, pan_settings, zoom_settings
from drivers.dynamixel import DynamixelAxis, move_together
from rig.devices import Motion
from rig.errors import HardwareError
from sim_backends.faults import FaultKind, random_script

KINDS = tuple(kind for kind in FaultKind if kind not in (FaultKind.BANNER, FaultKind.ALARM))
CALL_S = 45.0
"""The longest that any call may take on the simulated clock: 20 s of travel, half as much more, and the time-outs."""
ERROR_DEG = 0.1


class Person:
    """Drives a pan axis and a zoom ring at random, and does what the errors ask for."""

    def __init__(self, seed: int, *, faults: int, fault_every_s: float) -> None:
        self.rng = np.random.default_rng(seed)
        times_s = np.cumsum(self.rng.exponential(fault_every_s, faults))
        script = random_script(self.rng, [float(t) for t in times_s], KINDS)
        fine = {"tolerance_deg": 0.05, "poll_s": 0.05}
        self.bench = Workbench(pan_settings(**fine), zoom_settings(**fine), script=script)
        self.last_fault_s = float(times_s[-1])
        self.arrivals = 0
        self.longest_s = 0.0

    def work(self) -> None:
        """Move about until the last fault has struck."""
        self._make_all_ready()
        while self.bench.clock.now_s() < self.last_fault_s:
            try:
                self._timed(self._act)
            except HardwareError:
                self._make_all_ready()

    def _act(self) -> None:
        axis = self.bench.axes[int(self.rng.integers(2))]
        if self.rng.random() < 0.1:
            report = axis.stop()
            assert not report.confirmed or self._stands(axis), f"{axis.name} moves after a confirmed STOP"
            return
        together = self.rng.random() < 0.3
        wishes = {one: self._wish(one) for one in (self.bench.axes if together else [axis])}
        if together:
            move_together(wishes)
        else:
            axis.move_to(wishes[axis])
        for one, wish in wishes.items():
            off_deg = self.bench.angle_deg(one) - one.settings.role.to_angle_deg(wish)
            assert abs(off_deg) <= ERROR_DEG, f"{one.name} said that it had arrived and was {off_deg}° off"
        self.arrivals += len(wishes)

    def _wish(self, axis: DynamixelAxis) -> float:
        return float(self.rng.uniform(axis.settings.role.lower, axis.settings.role.upper))

    def _stands(self, axis: DynamixelAxis) -> bool:
        before_deg = self.bench.angle_deg(axis)
        self.bench.clock.sleep_s(0.05)
        return abs(self.bench.angle_deg(axis) - before_deg) < 0.01

    def _make_all_ready(self) -> None:
        for axis in self.bench.axes:
            for _ in range(200):
                try:
                    self._timed(lambda axis=axis: self._make_ready(axis))  # type: ignore[misc]  # bound at once
                    break
                except HardwareError:
                    self.bench.clock.sleep_s(0.5)
            else:
                raise AssertionError(f"{axis.name} did not become usable again")

    def _make_ready(self, axis: DynamixelAxis) -> None:
        """Reconnect, cool and reboot, reference where it is seen to stand, enable: what it needs of these."""
        try:
            status = axis.status()
        except HardwareError:
            axis.connect()
            status = axis.status()
        if status.motion is Motion.ALARM:
            self.bench.emulated.servo(axis.settings.id).temperature_c = 30.0
            status = axis.reboot()
        if not status.referenced:
            role = axis.settings.role
            seen = role.to_position(self.bench.angle_deg(axis))
            axis.reference(min(max(seen, role.lower), role.upper))
        axis.enable()

    def _timed(self, act: Callable[[], None]) -> None:
        began_s = self.bench.clock.now_s()
        try:
            act()
        finally:
            self.longest_s = max(self.longest_s, self.bench.clock.now_s() - began_s)


def check_run(seed: int, *, faults: int, fault_every_s: float) -> None:
    person = Person(seed, faults=faults, fault_every_s=fault_every_s)
    person.work()
    assert person.bench.monitor.violations == []
    assert person.longest_s < CALL_S
    assert person.arrivals > 0 or fault_every_s < 1.0


@pytest.mark.parametrize("seed", range(4))
def test_no_false_arrival_and_nothing_forbidden_under_random_faults(seed: int) -> None:
    check_run(seed, faults=60, fault_every_s=2.0)


def test_no_false_arrival_when_faults_follow_hard_on_each_other() -> None:
    check_run(4, faults=100, fault_every_s=0.4)


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(5))
def test_no_false_arrival_in_many_thousand_faults(seed: int) -> None:
    for run in range(50):
        check_run(1000 * seed + run + 100, faults=80, fault_every_s=(2.0, 0.6)[run % 2])
