"""Whatever two clients command on emulated wires, and whatever breaks meanwhile: three things never happen.

No frame is given out with a wrong pose; no move is commanded while unhomed, in alarm or out of limits (judges at the
devices' end of each wire decide); no command takes longer than its bound. The simple devices of test_any_order.py
know no bytes; here are the real drivers, so also lost answers, resets, and sticks in the wire.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from calibration_free_tests.gantry.simulated_bench import BOTH, name_of
from calibration_free_tests.guard.wired import BUS, GANTRY, Judged, config
from rig.errors import HardwareError, RigError
from rig.guard import State
from rig.guard.states import ACTIVITIES
from rig.hal import RigPose
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.faults import Fault, FaultKind, Side
from sim_backends.grbl_emulator.dialects import GRBL_1_1, GRBLHAL, Dialect

LONGEST_S = 400.0
"""Of a whole command: homing's own deadline of 180 s, and the time-outs and STOPs of all devices after it."""
START = RigPose(5.0, 85.0, 10.0, 0.0, 0.0)
WIRE = [FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.FLIP, FaultKind.GARBLE, FaultKind.SPLIT, FaultKind.DELAY]
DEVICE = [FaultKind.BANNER, FaultKind.ALARM, FaultKind.UNPLUG, FaultKind.HANG, FaultKind.POWER_CYCLE]
SERVO = [FaultKind.UNPLUG, FaultKind.HANG, FaultKind.OVERHEAT, FaultKind.POWER_CYCLE, FaultKind.STUCK_AXIS]

within = st.builds(
    RigPose, st.floats(0, 120), st.floats(0, 90), st.floats(0, 60), st.floats(-60, 60), st.floats(0.0, 1.0)
)
beyond = st.builds(
    lambda pose, axis, value: replace(pose, **{axis: value}),
    within,
    st.sampled_from(["x_mm", "y_mm", "z_mm", "theta_deg", "zoom"]),
    st.sampled_from([float("nan"), float("inf"), -1e300, -70.0, 130.0]),
)
poses = within | within | within | beyond
steps = st.dictionaries(
    st.sampled_from(["dx_mm", "dy_mm", "dz_mm", "dtheta_deg", "dzoom"]),
    st.sampled_from([0.05, -1.5, 7.0, -40.0, 500.0, float("nan")]),
    min_size=1,
    max_size=2,
)
delays = st.sampled_from([0.0, 0.003, 0.05, 0.3, 1.0, 2.0])
WHATEVER = ["stop", "hold", "home", "release", "resume", "status", "capture", "unlock", "close"]


class OnTheWire(RuleBasedStateMachine):
    """One client commands; the other, and the world, act in the middle of it: on the simulated clock."""

    @initialize(
        dialect=st.sampled_from([GRBL_1_1, GRBLHAL]), approach=st.booleans(), start_delay_s=st.sampled_from([0.0, 0.03])
    )
    def set_up(self, dialect: Any, approach: bool, start_delay_s: float) -> None:
        self.judged = Judged(dialect, approach=approach, start_delay_s=start_delay_s)
        self.guard, self.clock = self.judged.guard, self.judged.clock
        self.judged.ready()
        self.judged.move_to(START)

    def attempt(self, command: Callable[[], Any]) -> None:
        """An error of ours is an answer, any other is a bug."""
        with suppress(RigError):
            command()

    def timed(self, command: Callable[[], Any]) -> None:
        begun_s = self.clock.now_s()
        self.attempt(command)
        assert self.clock.now_s() - begun_s < LONGEST_S
        assert self.guard.running == ""
        assert self.guard.state not in ACTIVITIES

    def later(self, delay_s: float, command: Callable[[], Any]) -> None:
        self.judged.later(delay_s, lambda: self.attempt(command))

    # One client.

    @rule(pose=poses)
    def move(self, pose: RigPose) -> None:
        self.timed(lambda: self.judged.move_to(pose))

    @rule(pose=within)
    def move_and_look(self, pose: RigPose) -> None:
        self.timed(lambda: self.judged.move_to(pose))
        self.timed(self.judged.capture)

    @rule(step=steps)
    def jog(self, step: dict[str, float]) -> None:
        self.timed(lambda: self.guard.jog(**step))

    @rule()
    def capture(self) -> None:
        self.timed(self.judged.capture)

    @rule(name=st.sampled_from([*WHATEVER, "connect"]))
    def command(self, name: str) -> None:
        self.timed(getattr(self.guard, name))

    @rule(axis=st.sampled_from(["theta_deg", "zoom"]))
    def reboot(self, axis: str) -> None:
        self.timed(lambda: self.guard.reboot(axis))

    @rule()
    def recover(self) -> None:
        for name in ("release", "resume", "close"):
            self.timed(getattr(self.guard, name))
        self.timed(self.judged.ready)
        self.timed(lambda: self.judged.move_to(START))

    # Another, in the middle of what the first one does.

    @rule(delay_s=delays, name=st.sampled_from(WHATEVER))
    def other(self, delay_s: float, name: str) -> None:
        self.later(delay_s, getattr(self.guard, name))

    @rule(delay_s=delays, pose=poses, step=steps)
    def other_moves(self, delay_s: float, pose: RigPose, step: dict[str, float]) -> None:
        self.later(delay_s, lambda: self.guard.move_to(pose))
        self.later(delay_s + 0.1, lambda: self.guard.jog(**step))

    # The world.

    @rule(delay_s=delays, kind=st.sampled_from(DEVICE), number=st.sampled_from([1, 2, 3, 9]), seconds=delays)
    def controller_fails(self, delay_s: float, kind: FaultKind, number: int, seconds: float) -> None:
        self.judged.strike(GANTRY, Fault(kind, at_s=self.clock.now_s() + delay_s, number=number, seconds=seconds))

    @rule(delay_s=delays, kind=st.sampled_from(SERVO), number=st.integers(0, 1), seconds=delays)
    def servo_fails(self, delay_s: float, kind: FaultKind, number: int, seconds: float) -> None:
        self.judged.strike(BUS, Fault(kind, at_s=self.clock.now_s() + delay_s, number=number, seconds=seconds))

    @rule(
        delay_s=delays,
        port=st.sampled_from([GANTRY, BUS]),
        side=st.sampled_from(list(Side)),
        kind=st.sampled_from(WIRE),
        count=st.sampled_from([1, 3, 20]),
        mask=st.integers(1, 255),
    )
    def wire_fails(self, delay_s: float, port: str, side: Side, kind: FaultKind, count: int, mask: int) -> None:
        fault = Fault(kind, side, at_s=self.clock.now_s() + delay_s, count=count, mask=mask, seconds=0.1)
        self.judged.strike(port, fault)

    @rule(delay_s=delays, kind=st.sampled_from(list(CameraFaultKind)), seconds=delays)
    def camera_fails(self, delay_s: float, kind: CameraFaultKind, seconds: float) -> None:
        self.judged.bench.camera.faults.append(CameraFault(kind, self.clock.now_s() + delay_s, seconds))

    @rule()
    def replug(self) -> None:
        self.judged.replug()

    @rule(seconds=st.sampled_from([0.02, 0.5, 5.0]))
    def time_passes(self, seconds: float) -> None:
        self.clock.sleep_s(seconds)

    # What must hold.

    @invariant()
    def nothing_forbidden_was_commanded_and_no_pose_was_wrong(self) -> None:
        if hasattr(self, "judged"):
            assert self.judged.violations == []

    def teardown(self) -> None:
        if hasattr(self, "judged"):
            self.attempt(self.guard.close)
            assert self.judged.violations == []


TestOnTheWire = OnTheWire.TestCase
TestOnTheWire.settings = settings(
    max_examples=20,
    stateful_step_count=20,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
)


@pytest.mark.soak
@pytest.mark.timeout(0)
def test_two_clients_on_the_wire_for_long() -> None:
    from hypothesis.stateful import run_state_machine_as_test

    run_state_machine_as_test(
        OnTheWire, settings=settings(TestOnTheWire.settings, max_examples=1000, stateful_step_count=60)
    )


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_the_judges_see_what_they_are_there_for(dialect: Any) -> None:
    judged = Judged(dialect)
    judged.ready()
    judged.move_to(START)
    judged.capture()
    assert (judged.violations, judged.frames) == ([], 1)
    judged.bench.gantry.mechanics.axes[0].carriage_mm += 0.06
    judged.clock.sleep_s(1.0)
    judged.capture()
    assert "frame says" in judged.violations.pop()
    judged.wrong.clear()
    port = judged.guard._rig.gantry._session.link._port  # past guard and driver
    port.write(b"$J=G21G90G53X50.000F1000.0\n")
    judged.clock.sleep_s(1.0)
    assert any("out of limits" in str(violation) for violation in judged.violations)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("number", [1, 2])
def test_an_alarm_while_a_picture_is_taken_drops_it_and_shows_code_and_remedy(
    dialect: Dialect, number: int
) -> None:  # 16
    judged = Judged(dialect)
    judged.ready()
    judged.move_to(START)
    judged.strike(GANTRY, Fault(FaultKind.ALARM, at_s=judged.clock.now_s() + 0.25, number=number))
    with pytest.raises(HardwareError, match=rf"ALARM:{number}\b.*\. .*([Hh]ome|[Uu]nlock)"):
        judged.capture()
    assert judged.guard.state is State.ALARM
    if number == 1:
        with pytest.raises(HardwareError, match=r"[Hh]ome"):
            judged.guard.unlock()
        judged.guard.home()
    else:
        judged.guard.unlock()
    judged.move_to(START)
    judged.capture()
    assert judged.violations == []


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("approach", [True, False])
def test_a_one_sided_approach_removes_the_backlash_of_the_machine(dialect: Dialect, approach: bool) -> None:  # 34
    judged = Judged(dialect, approach=approach)
    judged.bench.gantry.mechanics.axes[0].backlash_mm = 0.4
    judged.ready()
    places = []
    for before in (20.0, 100.0, 80.0):
        judged.guard.move_to(replace(START, x_mm=before))
        judged.guard.move_to(replace(START, x_mm=60.0))
        places.append(judged.bench.pose.x_mm)
    # Which place it is, is for calibration to tell; that it is one place, whatever came before, is the approach's work.
    spread_mm = max(places) - min(places)
    assert spread_mm == pytest.approx(0.0 if approach else 0.4, abs=0.005)
    assert judged.guard.state is State.IDLE


def test_the_bench_of_these_tests_has_its_keep_out_box_and_approach() -> None:
    file = config(approach=True).file
    assert dict(file.rules.overshoot) == {"x_mm": 1.0}  # type: ignore[union-attr]  # a live file
