"""What the guard lets through, what it refuses, and what it does when things go wrong."""

from __future__ import annotations

import gc
import math
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.guard.sample import MODEL, RULES, START, TRAVEL, Bench, at, bench, homed
from calibration_free_tests.rigs.conformance import RigConformance
from rig.devices import Motion, Picture
from rig.errors import HardwareError, UnreachableError
from rig.guard import BusyError, HeldError, RefusedError, State, StoppedError, link, table_markdown
from rig.hal import AXES, Rig, RigPose

SAFETY = Path(__file__).parents[2] / "docs" / "safety.md"
FREE = replace(RULES, keep_out=())
ONE_SIDED = replace(FREE, overshoot={"x_mm": 2.0, "theta_deg": -1.0})
ELSEWHERE = at(x_mm=-100.0)


def in_a_moment(made: Bench, action: Callable[[], Any], seconds: float = 0.3) -> None:
    """Do something in the midst of what comes next."""
    made.clock.call_at(made.clock.now_s() + seconds, action)


class TestAGuardedRigIsARig(RigConformance):
    @pytest.fixture
    def rig(self) -> Rig:
        return homed(FREE).guard


class TestAGuardedRigThatTakesUpItsPlayIsARig(RigConformance):
    @pytest.fixture
    def rig(self) -> Rig:
        made = bench(ONE_SIDED)
        made.guard.connect()
        made.guard.home()
        made.guard.move_to(START)
        return made.guard


def test_the_table_of_states_is_the_one_in_the_documentation() -> None:
    assert table_markdown() in SAFETY.read_text(encoding="utf-8")


# Connecting and homing.


def test_connecting_moves_nothing_homes_nothing_and_enables_no_torque() -> None:
    made = bench()
    assert set(made.guard.connect()) == {"gantry", "pan", "zoom", "camera"}
    assert made.guard.state is State.UNHOMED
    assert (made.motions, made.pan.torque, made.zoom.torque) == ([], False, False)


def test_every_device_that_does_not_connect_is_told_and_the_others_are_closed() -> None:
    made = bench()
    made.pan.unplug()
    made.camera.unplug()
    with pytest.raises(HardwareError, match=r"(?s)2 of 4 devices cannot be connected.*pan: .*no such port.*camera: "):
        made.guard.connect()
    assert made.guard.state is State.DISCONNECTED
    assert not any(device.connected for device in made.devices)


def test_a_failed_start_tells_who_could_not_follow_its_torque_policy(monkeypatch: pytest.MonkeyPatch) -> None:  # 32
    made = bench()
    made.camera.unplug()

    def fail() -> None:
        raise HardwareError("torque could not be released")

    monkeypatch.setattr(made.pan, "close", fail)
    with pytest.raises(HardwareError, match=r"(?s)camera: .*pan, closing again: torque could not be released"):
        made.guard.connect()


def test_before_homing_nothing_moves_and_the_remedy_is_told() -> None:
    made = bench()
    made.guard.connect()
    asks: list[Callable[[], Any]] = [lambda: made.guard.move_to(START), made.guard.capture]
    for ask in asks:
        with pytest.raises(RefusedError, match=r"not possible while unhomed .*Home it first"):
            ask()
    with pytest.raises(RefusedError, match="not known"):
        _ = made.guard.pose
    assert made.motions == []


def test_a_short_jog_before_homing_needs_the_leave_of_the_bench_file() -> None:
    without, made = bench(), bench(replace(RULES, unhomed_jog_mm=5.0))
    for each in (without, made):
        each.guard.connect()
    with pytest.raises(UnreachableError, match=r"dx_mm = 1 is more than 0"):
        without.guard.jog(dx_mm=1.0)
    assert made.guard.jog(dy_mm=5.0) is None
    assert made.motions == [("jog", State.JOGGING)]
    assert made.gantry.place_mm == pytest.approx((0.0, 5.0, 0.0))
    for step in (5.1, -5.1, math.nan, math.inf):
        with pytest.raises(UnreachableError, match=r"more than 5, .*unhomed_jog_mm.*Home it first"):
            made.guard.jog(dx_mm=step)
    with pytest.raises(RefusedError, match="only the gantry"):
        made.guard.jog(dtheta_deg=1.0)
    assert len(made.motions) == 1


def test_where_the_gantry_is_homed_a_servo_without_a_place_takes_no_rule_away() -> None:
    made = homed(replace(RULES, unhomed_jog_mm=50.0))
    made.guard.move_to(at(x_mm=0.0, y_mm=0.0, z_mm=50.0))
    made.pan.reboot()
    assert made.guard.status().state is State.UNHOMED
    stood = made.gantry.place_mm
    with pytest.raises(UnreachableError, match="leads through the keep-out box 'model'"):
        made.guard.jog(dz_mm=50.0)
    made.guard.jog(dy_mm=50.0)
    made.guard.jog(dy_mm=50.0)
    made.guard.jog(dy_mm=50.0)
    with pytest.raises(UnreachableError, match="y_mm = 200 is outside"):
        made.guard.jog(dy_mm=50.0)
    assert made.gantry.place_mm == pytest.approx((stood[0], stood[1] + 150.0, stood[2]))


@pytest.mark.parametrize("how", ["stop", "hold"])
def test_a_stop_that_falls_between_two_devices_lets_the_next_not_begin(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:  # 19
    made = homed(FREE)
    move = made.gantry.move_to

    def then_stopped(*place: float) -> tuple[float, float, float]:
        back = move(*place)
        made.guard.stop("a person") if how == "stop" else made.guard.hold()
        return back

    monkeypatch.setattr(made.gantry, "move_to", then_stopped)
    before = made.pan.status().position
    with pytest.raises((StoppedError, HeldError)):
        made.guard.move_to(replace(ELSEWHERE, theta_deg=40.0))
    assert made.pan.status().position == before


def test_homing_makes_poses_possible_and_failed_homing_loses_them() -> None:
    made = homed()
    assert made.guard.state is State.IDLE
    in_a_moment(made, lambda: made.gantry.raise_alarm(9), 1.0)
    with pytest.raises(HardwareError, match="ALARM:9"):
        made.guard.home()
    assert made.guard.state is State.ALARM
    assert made.guard.glance().pose is None
    with pytest.raises(RefusedError, match="alarm"):
        made.guard.move_to(START)
    made.guard.home()
    assert made.guard.move_to(START) == START


def test_after_homing_that_failed_a_gantry_that_still_says_homed_is_not_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # 13
    made = homed()

    def fail() -> None:
        raise HardwareError("the switch was not found")

    monkeypatch.setattr(made.gantry, "home", fail)
    with pytest.raises(HardwareError, match="switch was not found"):
        made.guard.home()
    assert made.guard.unlock() is State.UNHOMED


# Limits, at the device's end of the wire.


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e6, -1e6])
@pytest.mark.parametrize("ask", ["move_to", "jog", "preflight", "nearest"])
def test_what_is_out_of_limits_is_refused_before_anything_is_sent(axis: str, value: float, ask: str) -> None:
    made = homed()
    before, stood = len(made.motions), made.guard.pose
    wish = replace(START, **{axis: value})
    asks: dict[str, Callable[[], Any]] = {
        "move_to": lambda: made.guard.move_to(wish),
        "jog": lambda: made.guard.jog(**{f"d{axis}": value}),
        "preflight": lambda: made.guard.preflight([START, wish]),
        "nearest": lambda: made.guard.nearest(wish),
    }
    with pytest.raises(UnreachableError, match=axis):
        asks[ask]()
    assert (len(made.motions), made.guard.pose, made.guard.state) == (before, stood, State.IDLE)


def test_jogs_keep_to_the_limits_and_out_of_the_boxes() -> None:
    made = homed()
    made.guard.move_to(RigPose(-180.0, 0.0, 150.0, 0.0))
    before = len(made.motions)
    with pytest.raises(UnreachableError, match=r"through the keep-out box 'model'"):
        made.guard.jog(dx_mm=300.0)
    with pytest.raises(UnreachableError, match=r"x_mm = -230 is outside"):
        made.guard.jog(dx_mm=-50.0)
    assert len(made.motions) == before
    after = made.guard.jog(dx_mm=100.0, dtheta_deg=5.0)
    assert after == RigPose(-80.0, 0.0, 150.0, 5.0)


def test_moves_go_where_the_rig_frame_says() -> None:
    made = homed()
    seen: list[tuple[float, ...]] = []
    made.gantry.on_motion = lambda kind, target: seen.append(target)
    made.pan.on_motion = lambda kind, target: seen.append(target)
    assert made.guard.move_to(RigPose(100.0, -140.0, 10.0, 45.0, 0.0)) == made.guard.pose
    assert seen == [(150.0, 60.0, 10.0), (-35.0,)]


def test_one_device_moves_at_a_time_and_only_those_that_must() -> None:
    made = homed()
    before = len(made.motions)
    began_s = made.clock.now_s()
    made.guard.jog(dtheta_deg=30.0)
    assert [kind for kind, _ in made.motions[before:]] == ["turn"]
    made.guard.move_to(at(x_mm=-80.0, zoom=0.5))
    assert made.clock.now_s() - began_s >= 1.0 + 1.0 + 1.0 + 1.0 - 0.01


def test_a_preflight_sends_nothing_and_knows_where_the_rig_stands() -> None:
    made = homed(replace(RULES, keep_out=(MODEL,)))
    made.guard.move_to(RigPose(-180.0, 0.0, 150.0, 0.0))
    before = len(made.motions)
    with pytest.raises(UnreachableError, match="pose 1 of 1: the way"):
        made.guard.preflight([RigPose(180.0, 0.0, 150.0, 0.0)])
    made.guard.preflight([RigPose(-180.0, 0.0, 50.0, 0.0), RigPose(180.0, 0.0, 50.0, 0.0)])
    assert len(made.motions) == before


# One-sided approach (34).


def test_a_one_sided_approach_comes_to_every_place_from_its_own_side() -> None:  # 34
    made = homed(ONE_SIDED)
    places: list[float] = []
    angles: list[float] = []
    made.gantry.on_motion = lambda kind, target: places.append(250.0 - target[0])
    made.pan.on_motion = lambda kind, target: angles.append(10.0 - target[0])
    made.guard.move_to(at(x_mm=0.0, theta_deg=20.0))
    made.guard.move_to(at(x_mm=-50.0, theta_deg=-20.0))
    made.guard.jog(dx_mm=-5.0)
    made.guard.move_to(at(x_mm=-40.0, theta_deg=-20.0))
    # The jog went the wrong way, so that nothing is known of the play after it, though the move goes the right way.
    assert without_repeats(places) == [0.0, -52.0, -50.0, -55.0, -42.0, -40.0]
    assert without_repeats(angles) == [21.0, 20.0, -20.0, -19.0, -20.0]


def without_repeats(values: list[float]) -> list[float]:
    """A leg of another axis sends this one to where it stands."""
    rounded = [round(value, 6) for value in values]
    return [value for before, value in zip([None, *rounded], rounded, strict=False) if value != before]


# Read back, stand still, be fresh.


@pytest.mark.parametrize(("axis", "off"), [("x_mm", 0.06), ("theta_deg", 0.11), ("zoom", 0.011)])
def test_a_place_that_reads_back_wrong_stops_everything(  # 30
    axis: str, off: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = homed()
    stops = [device.stops for device in (made.gantry, made.pan, made.zoom)]
    device = {"x_mm": made.gantry, "theta_deg": made.pan, "zoom": made.zoom}[axis]
    rightly = device.move_to
    wrongly = {
        "x_mm": lambda x, y, z: (x + off, y, z),
        "theta_deg": lambda value: value + off,
        "zoom": lambda value: value + off,
    }[axis]
    monkeypatch.setattr(device, "move_to", wrongly)
    with pytest.raises(HardwareError, match=rf"{axis} was commanded to .* and reads back .*more than .* off"):
        made.guard.move_to(at(x_mm=-100.0, theta_deg=30.0, zoom=0.5))
    assert [d.stops for d in (made.gantry, made.pan, made.zoom)] == [count + 1 for count in stops]
    assert made.guard.state is State.ALARM
    monkeypatch.setattr(device, "move_to", rightly)
    with pytest.raises(RefusedError, match="not possible while alarm"):
        made.guard.move_to(START)
    assert "the last move failed" in made.guard.glance().troubles[0]
    made.guard.unlock()
    assert made.guard.move_to(START) == START


def test_within_the_tolerance_is_good_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    made = homed()
    monkeypatch.setattr(made.gantry, "move_to", lambda x, y, z: (x + 0.04, y, z))
    made.guard.move_to(ELSEWHERE)
    assert made.guard.state is State.IDLE


@pytest.mark.parametrize("who", ["gantry", "pan"])
def test_a_stuck_axis_fails_by_name_and_nothing_is_captured_after_it(who: str) -> None:  # 30
    made = homed()
    getattr(made, who).get_stuck()
    with pytest.raises(HardwareError, match=f"{who}: .*does not move"):
        made.guard.move_to(at(x_mm=-100.0, theta_deg=30.0))
    with pytest.raises(RefusedError, match="alarm"):
        made.guard.capture()


def test_a_picture_is_exposed_after_settling_and_after_it_was_asked_for() -> None:  # 33
    made = homed()
    made.guard.move_to(ELSEWHERE)
    arrived_s = made.clock.now_s()
    frame = made.guard.capture()
    assert frame.exposed_at_s > arrived_s + TRAVEL.settle_s
    assert (frame.rig_pose, frame.commanded) == (made.guard.pose, ELSEWHERE)
    made.clock.sleep_s(10.0)
    asked_s = made.clock.now_s()
    assert made.guard.capture().exposed_at_s > asked_s
    assert made.clock.now_s() - asked_s < 0.1


@pytest.mark.parametrize("what", ["alarm", "moved", "turned", "stop", "unplug", "restart"])
def test_a_picture_is_dropped_if_the_rig_did_not_stand_still_and_in_order(what: str) -> None:  # 16
    made = homed()
    made.guard.move_to(ELSEWHERE)
    x, y, z = made.gantry.place_mm
    happens: dict[str, Callable[[], Any]] = {
        "alarm": lambda: made.gantry.raise_alarm(1),
        "moved": lambda: setattr(made.gantry, "place_mm", (x + 0.06, y, z)),
        "turned": lambda: setattr(made.pan, "angle", made.pan.angle + 0.11),
        "stop": lambda: made.guard.stop("a test"),
        "unplug": made.zoom.unplug,
        "restart": made.gantry.restart,
    }
    ends = {"alarm": State.ALARM, "moved": State.IDLE, "turned": State.IDLE, "stop": State.STOPPED}
    ends |= {"unplug": State.DISCONNECTED, "restart": State.UNHOMED}
    in_a_moment(made, happens[what], 0.1)
    with pytest.raises(HardwareError):
        made.guard.capture()
    assert made.guard.state is ends[what]


@pytest.mark.parametrize("who", ["gantry", "pan", "zoom"])
@pytest.mark.parametrize("old_s", [0.9, 1.1, 1e9])
def test_a_stale_status_blocks_every_move_and_is_shown_as_stale(who: str, old_s: float) -> None:  # 12
    made = homed()
    getattr(made, who).status_age_s = old_s
    before = len(made.motions)
    if old_s < 1.0:
        made.guard.move_to(ELSEWHERE)
        return
    asks: list[Callable[[], Any]] = [lambda: made.guard.move_to(START), made.guard.home, made.guard.capture]
    for ask in [*asks, lambda: made.guard.jog(dx_mm=1.0)]:
        with pytest.raises(HardwareError, match=r"the status is .* s old, more than 1 s\. Nothing was sent"):
            ask()
    assert made.guard.status().stale
    assert len(made.motions) == before


@pytest.mark.parametrize("motion", [Motion.MOVING, Motion.HELD, Motion.UNKNOWN])
def test_a_rig_that_somebody_else_moves_is_not_moved(motion: Motion) -> None:
    made = homed()
    before = len(made.motions)
    made.gantry.motion = motion
    with pytest.raises(HardwareError, match=f"gantry is {motion.value}"):
        made.guard.move_to(ELSEWHERE)
    assert len(made.motions) == before


def test_status_in_mid_move_asks_nobody_and_says_how_old_it_is() -> None:
    made = homed()
    seen: list[Any] = []
    in_a_moment(made, lambda: seen.append(made.guard.status()), 1.5)
    made.guard.move_to(at(x_mm=100.0))
    (status,) = seen
    assert status.state is State.MOVING
    assert "a move to x_mm 100" in status.running
    assert (status.age_s, status.stale) == (pytest.approx(1.5, abs=0.05), True)
    after = made.guard.status()
    assert (after.state, after.running, after.stale, after.troubles) == (State.IDLE, "", False, ())
    assert after.pose == made.guard.pose


def test_one_command_runs_at_a_time_and_a_second_is_told_which() -> None:
    made = homed()
    guard, refused = made.guard, []
    asks = [lambda: guard.move_to(START), lambda: guard.jog(dx_mm=1.0), guard.home, guard.capture, guard.connect]
    asks += [guard.unlock, guard.resume, guard.release, lambda: guard.reference("zoom", 0.5)]

    def others() -> None:
        for ask in asks:
            with pytest.raises(BusyError, match="the rig is busy: a move to"):
                ask()
            refused.append(ask)

    in_a_moment(made, others)
    guard.move_to(ELSEWHERE)
    assert len(refused) == len(asks)


@pytest.mark.parametrize("state", [State.IDLE, State.UNHOMED, State.HELD, State.ALARM])
def test_a_camera_that_was_lost_is_connected_again_by_itself(state: State, monkeypatch: pytest.MonkeyPatch) -> None:
    made = bench() if state is State.UNHOMED else homed()
    if state is State.UNHOMED:
        made.guard.connect()
    made.camera.unplug()
    if state is State.IDLE:
        with pytest.raises(HardwareError, match=r"camera: .*then connect again"):
            made.guard.capture()
    if state is State.HELD:
        made.guard.hold()
    if state is State.ALARM:
        made.gantry.raise_alarm(2)
        made.guard.status()
    assert made.guard.state is state
    with pytest.raises(HardwareError, match=r"camera: .*no such port"):
        made.guard.connect()
    made.camera.replug()
    known, motions = made.guard.glance().pose, len(made.motions)
    for device in (made.gantry, made.pan, made.zoom):
        for touch in ("connect", "close", "stop"):
            monkeypatch.setattr(device, touch, lambda: pytest.fail("only the camera is to be touched"))
    assert made.guard.connect()["camera"].kind == "simulated camera"
    assert (made.guard.state, made.guard.glance().pose, len(made.motions)) == (state, known, motions)
    if state is State.IDLE:
        assert made.guard.capture().rig_pose == known


# Faults.


@pytest.mark.parametrize("who", ["gantry", "pan", "zoom"])
def test_a_device_that_goes_away_ends_in_disconnected_and_reconnecting_resumes_nothing(who: str) -> None:  # 20
    made = homed()
    device = getattr(made, who)
    in_a_moment(made, device.unplug)
    with pytest.raises(HardwareError, match=f"{who}: .*link is gone"):
        made.guard.move_to(at(x_mm=-150.0, theta_deg=30.0, zoom=1.0))
    assert made.guard.state is State.DISCONNECTED
    with pytest.raises(RefusedError, match="Connect it first"):
        made.guard.move_to(START)
    device.replug()
    before = len(made.motions)
    made.guard.connect()
    assert (made.guard.state, len(made.motions)) == (State.UNHOMED, before)


def test_one_mute_servo_gives_a_partial_status_that_names_it() -> None:  # 28
    made = homed()
    made.pan.unplug()
    status = made.guard.status()
    assert status.state is State.DISCONNECTED
    assert status.rig is not None
    assert status.rig.gantry is not None
    assert set(status.rig.axes) == {"zoom"}
    assert [trouble for trouble in status.troubles if trouble.startswith("pan: ")]


def test_an_alarm_needs_a_person_and_the_way_out_depends_on_it() -> None:  # 16, 17
    made = homed()
    in_a_moment(made, lambda: made.gantry.raise_alarm(2))
    with pytest.raises(HardwareError, match="ALARM:2"):
        made.guard.move_to(ELSEWHERE)
    for ask in (lambda: made.guard.move_to(ELSEWHERE), made.guard.capture, lambda: made.guard.jog(dx_mm=1.0)):
        with pytest.raises(RefusedError, match=r"not possible while alarm.*unlock it or home it"):
            ask()
    assert any("ALARM:2" in trouble for trouble in made.guard.status().troubles)
    assert made.guard.unlock() is State.IDLE
    made.gantry.raise_alarm(1)
    assert made.guard.status().state is State.ALARM
    with pytest.raises(HardwareError, match="Home it"):
        made.guard.unlock()
    made.guard.home()
    assert made.guard.move_to(START) == START


def test_a_restart_that_nobody_asked_for_loses_home() -> None:  # 3
    made = homed()
    in_a_moment(made, made.gantry.restart)
    with pytest.raises(HardwareError):
        made.guard.move_to(ELSEWHERE)
    made.guard.status()
    with pytest.raises((RefusedError, HardwareError)):
        made.guard.move_to(ELSEWHERE)
    assert made.guard.glance().pose is None


def test_a_servo_that_has_rebooted_is_flagged_and_not_driven_until_it_is_referenced() -> None:  # 25
    made = homed()
    made.pan.lose_power()
    with pytest.raises(RefusedError, match="unhomed"):
        made.guard.move_to(ELSEWHERE)
    with pytest.raises(HardwareError, match="theta_deg: the servo has let go by itself"):
        made.guard.home()
    assert made.guard.home() is None
    assert (made.guard.state, made.pan.torque) == (State.UNHOMED, False)
    with pytest.raises(UnreachableError, match="theta_deg = 400"):
        made.guard.reference("theta_deg", 400.0)
    with pytest.raises(RefusedError, match=r"no axis 'focus' to reference. It has theta_deg, zoom"):
        made.guard.reference("focus", 0.0)
    assert made.guard.reference("theta_deg", 5.0) is State.IDLE
    assert made.guard.pose.theta_deg == pytest.approx(5.0)
    made.guard.move_to(START)


def test_a_hot_servo_is_an_alarm_that_names_it_and_is_never_rebooted_by_itself() -> None:  # 26
    made = homed()
    made.pan.overheat()
    with pytest.raises(HardwareError, match="pan: overheated"):
        made.guard.move_to(ELSEWHERE)
    assert made.pan.overheated
    assert made.guard.state is State.ALARM


def test_a_servo_that_has_let_go_by_itself_is_not_taken_again_silently() -> None:
    made = homed()
    made.pan.torque = False
    before = len(made.motions)
    with pytest.raises(HardwareError, match="theta_deg: the servo has let go by itself"):
        made.guard.move_to(ELSEWHERE)
    assert (len(made.motions), made.pan.torque) == (before, False)
    made.guard.move_to(ELSEWHERE)
    assert made.pan.torque


# Hold and resume.


def test_a_hold_keeps_the_position_and_nothing_moves_until_it_is_resumed() -> None:
    made = homed()
    in_a_moment(made, made.guard.hold, 1.0)
    with pytest.raises(HeldError, match="held before it had ended"):
        made.guard.move_to(at(x_mm=180.0))
    assert made.guard.state is State.HELD
    assert START.x_mm < made.guard.pose.x_mm < 180.0
    before = len(made.motions)
    asks: list[Callable[[], Any]] = [lambda: made.guard.move_to(START), made.guard.home, made.guard.capture]
    for ask in [*asks, lambda: made.guard.jog(dx_mm=1.0)]:
        with pytest.raises(HeldError, match="Resume it first"):
            ask()
    assert made.guard.resume() is State.IDLE
    made.clock.sleep_s(5.0)
    assert len(made.motions) == before
    made.guard.move_to(START)


def test_a_hold_between_the_legs_of_a_move_sends_no_further_leg() -> None:
    made = homed(ONE_SIDED)
    made.guard.move_to(at(x_mm=0.0))
    before = len(made.motions)
    made.gantry.on_motion = lambda kind, target: (
        made.motions.append((kind, made.guard.state)) or in_a_moment(made, made.guard.hold, 0.5)
    )
    with pytest.raises(HeldError):
        made.guard.move_to(at(x_mm=-100.0))
    assert len(made.motions) == before + 1


def test_a_hold_that_falls_between_two_legs_sends_no_further_leg(monkeypatch: pytest.MonkeyPatch) -> None:
    made = homed(ONE_SIDED)
    legs: list[RigPose] = []
    rightly = made.rig.move_to

    def then_hold(leg: RigPose) -> RigPose:
        legs.append(leg)
        back = rightly(leg)
        made.guard.hold()
        return back

    monkeypatch.setattr(made.rig, "move_to", then_hold)
    with pytest.raises(HeldError):
        made.guard.move_to(at(x_mm=-190.0))
    assert [leg.x_mm for leg in legs] == [-192.0]
    assert made.guard.state is State.HELD


def test_a_hold_lets_the_picture_in_hand_be_finished() -> None:
    made = homed()
    made.guard.move_to(ELSEWHERE)
    in_a_moment(made, made.guard.hold, 0.1)
    assert made.guard.capture().rig_pose == made.guard.pose
    assert made.guard.state is State.HELD


def test_a_hold_in_homing_leaves_the_rig_unhomed_and_free_to_home() -> None:
    made = homed()
    in_a_moment(made, made.guard.hold, 1.0)
    with pytest.raises(HeldError):
        made.guard.home()
    assert made.guard.state is State.HELD
    assert made.guard.resume() is State.UNHOMED
    made.guard.home()
    made.guard.move_to(START)


def test_python_collects_no_garbage_while_anything_moves() -> None:
    made = homed()
    collecting: dict[State, bool] = {}
    for asks in (lambda: made.guard.move_to(ELSEWHERE), lambda: made.guard.jog(dy_mm=1.0), made.guard.capture):
        in_a_moment(made, lambda: collecting.setdefault(made.guard.state, gc.isenabled()), 0.001)
        asks()
        assert gc.isenabled()
    assert collecting == {State.MOVING: False, State.JOGGING: False, State.CAPTURING: True}


def test_a_hold_at_rest_touches_no_torque() -> None:
    made = homed()
    made.guard.hold()
    assert (made.pan.torque, made.pan.stops, made.gantry.stops) == (True, 0, 0)


# Leaving.


def test_leaving_closes_all_devices_and_entering_connects() -> None:  # 32
    made = bench()
    with made.guard as guard:
        guard.home()
        assert made.pan.torque
    assert made.guard.state is State.DISCONNECTED
    assert not any(device.connected for device in made.devices)
    assert not made.pan.torque


def test_a_torque_policy_that_could_not_be_followed_is_told_at_the_end() -> None:  # 32
    made = homed()
    made.pan.unplug()
    with pytest.raises(HardwareError, match=r"(?s)1 of 4 devices did not close.*pan: .*torque could not be released"):
        made.guard.close()
    assert not any(device.connected for device in made.devices)
    made.guard.close()


def test_a_camera_that_hangs_does_not_keep_the_bench_from_being_closed(monkeypatch: pytest.MonkeyPatch) -> None:  # 32
    made = homed()
    asked, freed = threading.Event(), threading.Event()

    def hang(after_s: float) -> Picture:
        asked.set()
        assert freed.wait(30.0)
        raise HardwareError("no picture came")

    monkeypatch.setattr(made.camera, "capture", hang)
    monkeypatch.setattr(link, "PATIENCE_S", 0.05)

    def capture() -> None:
        with suppress(HardwareError):
            made.guard.capture()

    capturing = threading.Thread(target=capture)
    capturing.start()
    assert asked.wait(30.0)
    with pytest.raises(HardwareError, match=r"a capture does not end: all devices were closed under it\. Look at"):
        made.guard.close()
    assert not any(device.connected for device in made.devices)
    assert not made.pan.torque
    freed.set()
    capturing.join(30.0)
    assert made.guard.state is State.DISCONNECTED
    made.guard.close()


def test_an_interrupt_in_mid_move_stops_everything_before_it_is_passed_on() -> None:  # 32
    made = homed()
    stops = made.gantry.stops

    def interrupt() -> None:
        raise KeyboardInterrupt

    in_a_moment(made, interrupt, 1.0)
    with pytest.raises(KeyboardInterrupt):
        made.guard.move_to(at(x_mm=180.0))
    assert made.gantry.stops > stops
    stood = made.gantry.place_mm
    made.clock.sleep_s(5.0)
    assert made.gantry.place_mm == stood
    assert made.guard.running == ""
