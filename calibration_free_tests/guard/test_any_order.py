"""Whatever two clients command and whatever the devices do meanwhile: nothing moves that must not, nothing hangs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from calibration_free_tests.guard.sample import RULES, START, TRAVEL, bench
from rig.errors import RigError
from rig.guard import TABLE, State
from rig.guard.states import ACTIVITIES, IN_MOTION
from rig.hal import AXES, RigPose

LONGEST_COMMAND_S = 60.0

values = st.one_of(
    st.floats(-260.0, 260.0),
    st.sampled_from([-90.0, 90.0, 0.0, 0.5, 1.0, float("nan"), float("inf"), 1e300]),
)
reasonable = st.tuples(
    st.floats(-200.0, 200.0), st.floats(-150.0, 150.0), st.floats(0.0, 250.0), st.floats(-90.0, 90.0), st.floats(0, 1)
)
poses = st.builds(RigPose, values, values, values, values, values) | st.builds(lambda v: RigPose(*v), reasonable)
small = st.fixed_dictionaries({"dx_mm": st.sampled_from([-1.0, 5.0, 50.0])}, optional={"dtheta_deg": st.just(-10.0)})
wild = st.fixed_dictionaries({f"d{axis}": st.sampled_from([0.1, -50.0, 300.0, float("nan")]) for axis in AXES})
steps = small | wild
delays = st.sampled_from([0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 6.0])
devices = st.integers(0, 3)


class TwoClients(RuleBasedStateMachine):
    """The second client, and the world, act while the first one's command is under way: on the simulated clock."""

    @initialize(
        overshoot=st.sampled_from([{}, {"x_mm": 1.0, "theta_deg": -2.0}]), unhomed_jog_mm=st.sampled_from([0, 5])
    )
    def set_up(self, overshoot: dict[str, float], unhomed_jog_mm: float) -> None:
        rules = replace(RULES, overshoot=overshoot, unhomed_jog_mm=unhomed_jog_mm)
        self.bench = bench(rules)
        self.guard, self.clock = self.bench.guard, self.bench.clock
        self.violations: list[str] = []
        self.command_now: object = None
        self.bench.gantry.on_motion = self.gantry_moves
        for axis, device in (("theta_deg", self.bench.pan), ("zoom", self.bench.zoom)):
            device.on_motion = lambda kind, target, axis=axis: self.axis_moves(axis, target[0])
        self.attempt(self.guard.connect)
        self.attempt(self.guard.home)
        self.attempt(lambda: self.guard.move_to(START))

    def gantry_moves(self, kind: str, target: tuple[float, ...]) -> None:
        self.moves(kind)
        gantry = self.bench.gantry
        if kind == "move" and not gantry.homed:
            self.violations.append("a move while unhomed")
        if gantry.homed and kind != "home":
            x, y, z = self.bench.rig._placement.to_rig((target[0], target[1], target[2]))
            for axis, value in zip(AXES, (x, y, z), strict=False):
                self.within(axis, value)

    def axis_moves(self, axis: str, target: float) -> None:
        self.moves("turn")
        self.within(axis, 10.0 - target if axis == "theta_deg" else target)

    def moves(self, kind: str) -> None:
        if self.guard.state not in IN_MOTION:
            self.violations.append(f"{kind} while {self.guard.state.value}")
        # All devices are asked before a command's first motion. What goes wrong with one while another moves is
        # noticed when its own turn comes, or at the end.
        before, self.command_now = self.command_now, self.guard._machine._running
        if self.command_now is before:
            return
        if self.bench.gantry.alarm is not None:
            self.violations.append(f"{kind} in alarm {self.bench.gantry.alarm}")
        if not all(device.plugged for device in (self.bench.gantry, self.bench.pan, self.bench.zoom)):
            self.violations.append(f"{kind} while unplugged")

    def within(self, axis: str, value: float) -> None:
        limit = getattr(TRAVEL, axis)
        if not limit.lower - 1e-6 <= value <= limit.upper + 1e-6:
            self.violations.append(f"{axis} sent to {value}")

    def attempt(self, command: Callable[[], Any]) -> None:
        """What a client does: an error of ours is an answer, any other is a bug."""
        with suppress(RigError):
            command()

    def timed(self, command: Callable[[], Any]) -> None:
        begun_s = self.clock.now_s()
        self.attempt(command)
        assert self.clock.now_s() - begun_s < LONGEST_COMMAND_S
        assert self.guard.running == ""
        assert self.guard.state not in ACTIVITIES

    def later(self, delay_s: float, command: Callable[[], Any]) -> None:
        self.clock.call_at(self.clock.now_s() + delay_s, lambda: self.attempt(command))

    # The first client.

    @rule(pose=poses)
    def move(self, pose: RigPose) -> None:
        self.timed(lambda: self.guard.move_to(pose))

    @rule(step=steps)
    def jog(self, step: dict[str, float]) -> None:
        self.timed(lambda: self.guard.jog(**step))

    @rule()
    def capture(self) -> None:
        self.timed(self.guard.capture)

    @rule(name=st.sampled_from(["home", "connect", "close", "status", "unlock", "resume", "release", "stop", "hold"]))
    def command(self, name: str) -> None:
        self.timed(getattr(self.guard, name))

    @rule(axis=st.sampled_from(["theta_deg", "zoom", "x_mm"]), value=st.sampled_from([0.0, 1.0, 45.0, 200.0]))
    def reference(self, axis: str, value: float) -> None:
        self.timed(lambda: self.guard.reference(axis, value))

    @rule(axis=st.sampled_from(["theta_deg", "zoom", "x_mm"]))
    def reboot(self, axis: str) -> None:
        self.timed(lambda: self.guard.reboot(axis))

    @rule()
    def recover(self) -> None:
        """What a person does once everything has gone wrong."""
        for device in self.bench.devices:
            device.replug()
            device.get_stuck(False)
        for name in ("release", "resume", "close", "connect"):
            self.attempt(getattr(self.guard, name))
        for axis in ("theta_deg", "zoom"):
            self.attempt(lambda axis=axis: self.guard.reboot(axis))
            self.attempt(lambda axis=axis: self.guard.reference(axis, 0.5))
        for name in ("unlock", "home"):
            self.attempt(getattr(self.guard, name))
        self.attempt(lambda: self.guard.move_to(START))

    # The second client, in the middle of what the first one does.

    @rule(delay_s=delays, name=st.sampled_from(["stop", "hold", "home", "release", "resume", "status", "capture"]))
    def other(self, delay_s: float, name: str) -> None:
        self.later(delay_s, getattr(self.guard, name))

    @rule(delay_s=delays, pose=poses, step=steps)
    def other_moves(self, delay_s: float, pose: RigPose, step: dict[str, float]) -> None:
        self.later(delay_s, lambda: self.guard.move_to(pose))
        self.later(delay_s + 0.1, lambda: self.guard.jog(**step))

    # The world.

    @rule(delay_s=delays, device=devices)
    def unplug(self, delay_s: float, device: int) -> None:
        self.later(delay_s, self.bench.devices[device].unplug)

    @rule(delay_s=delays, device=devices)
    def replug(self, delay_s: float, device: int) -> None:
        self.later(delay_s, self.bench.devices[device].replug)

    @rule(delay_s=delays, number=st.sampled_from([1, 2, 9]))
    def alarm(self, delay_s: float, number: int) -> None:
        self.later(delay_s, lambda: self.bench.gantry.raise_alarm(number))

    @rule(delay_s=delays)
    def restart(self, delay_s: float) -> None:
        self.later(delay_s, self.bench.gantry.restart)

    @rule(delay_s=delays, which=st.sampled_from(["lose_power", "overheat", "get_stuck"]))
    def servo_fails(self, delay_s: float, which: str) -> None:
        self.later(delay_s, getattr(self.bench.pan, which))

    @rule(seconds=st.floats(0.0, 10.0))
    def time_passes(self, seconds: float) -> None:
        self.clock.sleep_s(seconds)

    # What must hold.

    @invariant()
    def nothing_moved_that_must_not(self) -> None:
        assert getattr(self, "violations", []) == []

    @invariant()
    def every_transition_is_in_the_table(self) -> None:
        rows = {(row.source, row.event): row.targets for row in TABLE}
        for source, event, target in getattr(self, "bench", bench()).transitions:
            assert target in rows[source, event]

    @invariant()
    def a_latched_stop_is_seen(self) -> None:
        if hasattr(self, "guard") and self.guard._machine.stop_note:
            assert self.guard.state is State.STOPPED


TestTwoClients = TwoClients.TestCase
TestTwoClients.settings = settings(
    max_examples=150, stateful_step_count=40, deadline=None, suppress_health_check=list(HealthCheck)
)
