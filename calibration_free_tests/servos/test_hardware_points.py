"""The points of facts/hardware.md that servos must show, each on the wire-level emulator; numbers as there."""

from __future__ import annotations

import dataclasses
import termios
from collections.abc import Callable

import pytest
import serial

from calibration_free_tests.servos.workbench import MODE_NUMBER, Workbench, pan_settings, zoom_settings
from drivers.dynamixel import DynamixelAxis, DynamixelBus, move_together, statuses
from drivers.dynamixel.answers import NoAnswerError
from drivers.serial_link import LinkLostError
from drivers.serial_ports import resolve_port
from rig.devices import Motion
from rig.errors import HardwareError, UnreachableError
from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.servo import ENCODER, Servo
from sim_backends.faults import Fault, FaultKind, Side

GONE = [OSError(5, "Input/output error"), serial.SerialException("device gone"), termios.error(5, "Input/output error")]


def bytes_sent(bench: Workbench) -> bytes:
    return b"".join(data for _, data in bench.line.written)


@dataclasses.dataclass
class Adapter:
    device: str
    serial_number: str | None = None
    vid: int | None = 0x0403
    pid: int | None = 0x6014


def test_point_4_two_adapters_that_could_be_meant_are_an_error() -> None:
    twins = [Adapter("/dev/ttyUSB0", "A1"), Adapter("/dev/ttyUSB1", "A1")]
    with pytest.raises(HardwareError, match=r"/dev/ttyUSB0, /dev/ttyUSB1.*by-path"):
        resolve_port("A1", lambda: twins)
    assert resolve_port("A2", lambda: [*twins, Adapter("/dev/ttyUSB2", "A2")]) == "/dev/ttyUSB2"


class GantryPort:
    """A port with a gantry controller on it."""

    def __init__(self) -> None:
        self.answer = b""
        self.in_waiting = 0

    def read(self, size: int = 1) -> bytes:
        taken, self.answer = self.answer[:size], self.answer[size:]
        return taken

    def write(self, data: bytes) -> int:
        self.answer += b"Grbl 1.1h ['$' for help]\r\n"
        return len(data)

    def close(self) -> None:
        """Nothing to close."""


class TickingClock:
    """Each look at it takes a millisecond."""

    now = 0.0

    def now_s(self) -> float:
        self.now += 1e-3
        return self.now

    def sleep_s(self, seconds: float) -> None:
        self.now += seconds


def test_point_5_a_gantry_on_the_servos_port_is_noticed() -> None:
    clock = TickingClock()
    bus = DynamixelBus("swapped", 1_000_000, clock, open_port=lambda name, baud: GantryPort())
    with pytest.raises(HardwareError, match="gantry controller does: are the ports of gantry and servos swapped"):
        DynamixelAxis(pan_settings(port="swapped"), clock, bus=bus).connect()


@pytest.mark.parametrize("mode", ["extended", "position", "current_based"])
def test_point_8_a_move_returns_only_once_at_rest_at_the_goal(mode: str) -> None:
    travel = {"lower_deg": -150.0, "upper_deg": 150.0}
    bench = Workbench(pan_settings(mode=mode, role=travel))
    axis = bench.ready()
    began_s = bench.clock.now_s()
    assert axis.move_to(120.0) == pytest.approx(120.0, abs=0.05)
    assert bench.angle_deg() == pytest.approx(120.0, abs=0.05)
    assert bench.clock.now_s() - began_s > 120.0 / 30.0
    bench.clock.sleep_s(1.0)
    assert bench.angle_deg() == pytest.approx(120.0, abs=0.05)
    assert bench.monitor.violations == []


def test_point_8_gear_and_sign_are_those_of_the_axis() -> None:
    bench = Workbench(pan_settings(role={"gear_ratio": 3.0, "sign": -1}))
    axis = bench.ready()
    axis.move_to(-40.0)
    assert bench.servo.shaft_ticks == pytest.approx(2048 + 3 * 40 * 4096 / 360, abs=1)


@pytest.mark.parametrize("wish", [float("nan"), float("inf"), 300.01, -300.01])
def test_point_14_a_wish_outside_the_travel_is_refused_before_a_byte_is_sent(wish: float) -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    before = bytes_sent(bench)
    with pytest.raises(UnreachableError, match=r"pan servo 1 on bus: .* is outside -300 .. 300"):
        axis.move_to(wish)
    with pytest.raises(UnreachableError):
        axis.reference(wish)
    assert bytes_sent(bench) == before


@pytest.mark.parametrize("dead", GONE, ids=lambda error: type(error).__name__)
def test_point_20_unplugging_in_mid_move_is_noticed_and_reconnecting_resumes_nothing(dead: Exception) -> None:
    bench = Workbench(pan_settings(watchdog_ms=200), dead=dead)
    axis = bench.ready()
    unplugged_s = bench.clock.now_s() + 1.0
    bench.clock.call_at(unplugged_s, bench.line.unplug)
    with pytest.raises(LinkLostError, match=r"Connect again|connect again"):
        axis.move_to(200.0)
    assert bench.clock.now_s() - unplugged_s < 1.0
    bench.clock.sleep_s(1.0)
    stopped_deg = bench.angle_deg()
    assert stopped_deg < 60.0  # the bus watchdog halted it
    with pytest.raises(LinkLostError):
        axis.status()
    with pytest.raises(HardwareError, match="cannot be opened"):
        axis.connect()
    bench.line.plug_in()
    goals = bench.monitor.goals
    axis.connect()
    with pytest.raises(HardwareError, match="bus watchdog"):
        axis.move_to(0.0)
    axis.enable()
    bench.clock.sleep_s(3.0)
    assert bench.angle_deg() == pytest.approx(stopped_deg, abs=0.2)
    assert bench.monitor.goals == goals
    assert bench.monitor.violations == []


def test_point_21_hung_servos_are_a_time_out_not_a_hang() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    hung_s = bench.clock.now_s() + 1.0
    bench.clock.call_at(hung_s, lambda: setattr(bench.emulated, "hung_until_s", 1e9))
    with pytest.raises(NoAnswerError, match=r"no answer from servo 1.*could not be switched off"):
        axis.move_to(200.0)
    assert bench.clock.now_s() - hung_s < 1.0
    with pytest.raises(NoAnswerError, match="servo 1 does not answer"):
        axis.status()


@pytest.mark.parametrize(
    ("register", "value", "complaint"),
    [
        (table.MODEL_NUMBER, 1060, r"is a XL430-W250, and the bench file says XM430-W350"),
        (table.OPERATING_MODE, 3, r"its operating mode is 3, and extended is 4"),
        (table.SERVO_ID, 9, r"servo 1 does not answer"),
        (table.DRIVE_MODE, 8, r"torque on by goal update"),
        (table.DRIVE_MODE, 4, r"time-based profile"),
        (table.HOMING_OFFSET, -500, r"its homing offset is -500"),
        (table.STARTUP, 3, r"its startup configuration is 3"),
        (table.RETURN_LEVEL, 0, r"status return level \(address 68\) to 2"),
    ],
)
def test_point_23_another_servo_or_setup_than_told_is_refused(
    register: table.Register, value: int, complaint: str
) -> None:
    bench = Workbench(pan_settings())
    bench.servo.memory[register] = value
    with pytest.raises(HardwareError, match=complaint):
        bench.axis.connect()
    with pytest.raises(LinkLostError, match="not connected"):
        bench.axis.move_to(10.0)


def test_point_23_model_and_place_are_told_and_nothing_moves_before_torque_was_enabled() -> None:
    bench = Workbench(pan_settings())
    identity = bench.axis.connect()
    assert (identity.kind, identity.version, identity.where) == ("XM430-W350", "45", "bus id 1")
    bench.axis.reference(0.0)
    assert not bench.axis.status().torque
    with pytest.raises(HardwareError, match="torque has not been enabled"):
        bench.axis.move_to(10.0)
    bench.axis.enable()
    bench.servo.write(64, b"\x00")
    with pytest.raises(HardwareError, match="torque is off"):
        bench.axis.move_to(10.0)
    assert bench.monitor.goals == 0


@pytest.mark.parametrize("goal", [-131073, 50_000, 2048])
def test_point_24_enabling_torque_moves_nothing_whatever_goal_was_left(goal: int) -> None:
    bench = Workbench(pan_settings(), shaft_ticks=1234.0)
    bench.axis.connect()
    bench.axis.reference(-71.0)
    bench.servo.write(116, (goal % 2**32).to_bytes(4, "little"))
    status = bench.axis.enable()
    bench.clock.sleep_s(3.0)
    assert status.torque
    assert bench.servo.shaft_ticks == 1234.0
    assert bench.monitor.violations == []


def test_point_24_a_servo_that_is_turned_by_hand_meanwhile_is_not_held() -> None:
    bench = Workbench(pan_settings())
    bench.axis.connect()
    bench.axis.reference(0.0)
    bench.clock.call_at(bench.clock.now_s() + 0.006, lambda: bench.servo.turn_by_hand(300.0))
    with pytest.raises(HardwareError, match="was turned by"):
        bench.axis.enable()
    assert not bench.servo.torque


@pytest.mark.parametrize("mode", ["extended", "position", "current_based"])
def test_point_25_a_servo_that_reboots_is_flagged_and_not_driven_before_it_is_referenced(mode: str) -> None:
    bench = Workbench(pan_settings(mode=mode, role={"lower_deg": -150.0, "upper_deg": 150.0}))
    axis = bench.ready()
    axis.move_to(100.0)
    bench.servo.power_cycle(bench.clock.now_s())
    bench.clock.sleep_s(1.0)
    status = axis.status()
    assert (status.referenced, status.position) == (False, None)
    assert "has rebooted" in status.trouble
    for drive in (lambda: axis.move_to(0.0), axis.enable):
        with pytest.raises(HardwareError, match="has rebooted"):
            drive()
    assert axis.reference(100.0).position == pytest.approx(100.0, abs=0.1)
    axis.enable()
    axis.move_to(0.0)
    assert bench.angle_deg() == pytest.approx(0.0, abs=0.1)
    assert bench.monitor.violations == []


def test_point_25_a_reboot_while_nobody_was_connected_is_known_too() -> None:
    bench = Workbench(pan_settings())
    bench.ready().move_to(-290.0)
    bench.axis.close()
    other = DynamixelAxis(pan_settings(), bench.clock, bus=bench.make_bus())
    other.connect()
    assert other.status().position == pytest.approx(-290.0, abs=0.1)  # it had power all the time
    other.close()
    bench.servo.power_cycle(bench.clock.now_s())
    bench.clock.sleep_s(1.0)
    bench.axis.connect()
    assert bench.axis.status().position is None
    with pytest.raises(HardwareError, match="since its power was off"):
        bench.axis.enable()


def test_point_25_a_reboot_in_mid_move_ends_the_move() -> None:
    bench = Workbench(pan_settings(), script=[Fault(FaultKind.POWER_CYCLE, at_s=2.0)])
    axis = bench.ready()
    with pytest.raises(HardwareError, match=r"rebooted|no answer"):
        axis.move_to(200.0)
    assert bench.angle_deg() < 60.0
    assert bench.monitor.violations == []


def test_point_25_referencing_finds_the_turn_and_refuses_what_the_servo_contradicts() -> None:
    bench = Workbench(pan_settings(), shaft_ticks=2048.0 - 3072.0)
    bench.axis.connect()
    assert bench.axis.reference(-250.0).position == pytest.approx(-270.0)
    assert bench.angle_deg() == pytest.approx(-270.0)
    with pytest.raises(HardwareError, match=r"cannot stand at -135: the nearest place by its own count is -270"):
        bench.axis.reference(-135.0)


@pytest.mark.parametrize(
    ("strike", "word"),
    [
        (lambda servo: setattr(servo, "temperature_c", 95.0), "overheating"),
        (lambda servo: servo.jam(1e9), r"overload|is stuck"),
        (lambda servo: servo.fail(ENCODER), "encoder"),
        (lambda servo: setattr(servo, "voltage_v", 6.0), "input voltage"),
    ],
    ids=["heat", "overload", "encoder", "voltage"],
)
def test_point_26_a_hardware_error_names_the_servo_and_halts(strike: Callable[[Servo], None], word: str) -> None:
    bench = Workbench(pan_settings(stuck_s=5.0))
    axis = bench.ready()
    bench.clock.call_at(bench.clock.now_s() + 1.0, lambda: strike(bench.servo))
    with pytest.raises(HardwareError, match=rf"pan servo 1 on bus.*({word})"):
        axis.move_to(200.0)
    halted = bench.angle_deg()
    bench.clock.sleep_s(2.0)
    assert bench.angle_deg() == pytest.approx(halted, abs=0.05)
    assert axis.status().motion is Motion.ALARM
    for drive in (lambda: axis.move_to(0.0), axis.enable):
        with pytest.raises(HardwareError, match="then reboot it"):
            drive()
    assert bytes_sent(bench).count(b"\x03\x00\x08") == 0  # no reboot by itself
    assert bench.monitor.violations == []


def test_point_26_a_reboot_on_request_clears_the_error_and_loses_the_reference() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    bench.servo.temperature_c = 95.0
    assert axis.status().motion is Motion.ALARM
    bench.servo.temperature_c = 30.0
    status = axis.reboot()
    assert (status.motion, status.referenced, status.torque) == (Motion.IDLE, False, False)
    axis.reference(0.0)
    axis.enable()
    assert axis.move_to(10.0) == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(
    "fault",
    [
        {"kind": FaultKind.DROP, "count": 3},
        {"kind": FaultKind.FLIP, "mask": 0x10},
        {"kind": FaultKind.GARBLE, "count": 8},
        {"kind": FaultKind.DUPLICATE, "count": 30},
        {"kind": FaultKind.SPLIT, "seconds": 0.003},
        {"kind": FaultKind.DELAY, "seconds": 0.02},
    ],
    ids=lambda fault: fault["kind"].value,
)
def test_point_27_garbled_packets_are_read_again_and_writes_are_checked(fault: dict[str, object], side: Side) -> None:
    script = [Fault(side=side, at_s=0.5 + 0.15 * n, **fault) for n in range(16)]  # type: ignore[arg-type]
    bench = Workbench(pan_settings(), script=script)
    axis = bench.ready()
    bench.clock.sleep_s(0.49 - bench.clock.now_s())
    assert axis.move_to(60.0) == pytest.approx(60.0, abs=0.1)
    assert len(bench.line.wire.fired) >= 14
    assert bench.angle_deg() == pytest.approx(60.0, abs=0.05)
    assert bench.monitor.violations == []


def echo_answers(bench: Workbench, after_s: float) -> None:
    """Let each answer come once more, so long after it began."""
    begun_answers, copies = bench.emulated.take_output, []

    def begun_and_copied() -> list[tuple[float, bytes]]:
        begun = begun_answers()
        fresh = [(at_s + after_s, data) for at_s, data in begun if (at_s, data) not in copies]
        copies.extend(fresh)
        bench.emulated._replies.extend(fresh)
        return begun

    bench.emulated.take_output = begun_and_copied  # type: ignore[method-assign]


def test_point_27_doubled_answers_are_never_taken_for_later_ones() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    echo_answers(bench, after_s=1.4e-3)  # just behind the answer, which takes 1.2 ms: after the next question
    for wish in (20.0, -20.0):
        assert axis.move_to(wish) == pytest.approx(wish, abs=0.1)
        assert bench.angle_deg() == pytest.approx(wish, abs=0.1)
    bench.servo.write(64, b"\x00")
    for _ in range(20):
        axis.status()
        bench.servo.turn_by_hand(50.0)
        assert axis.status().position == pytest.approx(bench.angle_deg(), abs=0.1)


def test_point_27_a_goal_that_was_lost_is_not_sent_again_to_a_servo_that_has_rebooted() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    write = bench.servo.write

    def reboot_at_the_goal(address: int, data: bytes) -> int:
        if address != table.GOAL_POSITION.address:
            return write(address, data)
        bench.servo.power_cycle(bench.clock.now_s())
        bench.servo._booted_s = 0.0  # it is back at once
        return 0

    bench.servo.write = reboot_at_the_goal  # type: ignore[method-assign]
    with pytest.raises(HardwareError, match="has rebooted"):
        axis.move_to(50.0)
    assert bench.monitor.violations == []


def test_point_27_what_the_servo_does_not_take_is_an_error() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    bench.servo.write = lambda address, data: 0  # type: ignore[method-assign]  # acknowledges and forgets
    with pytest.raises(HardwareError, match="bus watchdog is 0 after 3 attempts to make it 10"):
        axis.move_to(10.0)
    assert bench.angle_deg() == pytest.approx(0.0, abs=0.1)


def test_point_27_a_goal_whose_bytes_look_like_a_header_round_trips() -> None:
    # -131073 ticks are the bytes FF FF FD FF.
    gear = 120.0
    bench = Workbench(pan_settings(role={"gear_ratio": gear, "zero_ticks": 0}), shaft_ticks=0.0)
    bench.servo.memory[table.VELOCITY_LIMIT] = 2047
    axis = bench.ready()
    wish = -131073 * 360.0 / 4096.0 / gear
    assert axis.move_to(wish) == pytest.approx(wish, abs=1e-6)
    assert bench.servo.shaft_ticks == -131073
    assert axis.status().position == pytest.approx(wish, abs=1e-6)
    assert b"\xff\xff\xfd\xfd\xff" in bytes_sent(bench)


def test_point_28_one_mute_servo_gives_the_others_and_is_named() -> None:
    bench = Workbench(pan_settings(), zoom_settings())
    for axis in bench.axes:
        axis.connect()
    pan, zoom = bench.axes
    bench.servos[0].mute_until_s = 1e9
    found = statuses(bench.axes)
    assert found[zoom].position == pytest.approx(zoom.settings.role.to_position(68.03), abs=0.01)
    assert (found[pan].motion, found[pan].position) == (Motion.UNKNOWN, None)
    assert "pan servo 1 on bus does not answer" in found[pan].trouble


def test_point_28_a_servo_that_falls_silent_halts_the_others() -> None:
    bench = Workbench(pan_settings(), zoom_settings())
    pan, zoom = bench.axes
    bench.ready()
    zoom.connect()
    zoom.enable()
    bench.clock.call_at(bench.clock.now_s() + 1.0, lambda: setattr(bench.servos[1], "mute_until_s", 1e9))
    with pytest.raises(HardwareError, match="no answer from servo 2"):
        move_together({pan: 250.0, zoom: 0.0})
    halted = bench.angle_deg(pan)
    assert halted < 60.0
    bench.clock.sleep_s(2.0)
    assert bench.angle_deg(pan) == pytest.approx(halted, abs=0.5)


def test_axes_of_one_bus_move_at_the_same_time() -> None:
    bench = Workbench(pan_settings(), zoom_settings())
    pan, zoom = bench.axes
    bench.ready()
    zoom.connect()
    zoom.enable()
    began_s = bench.clock.now_s()
    arrived = move_together({pan: 60.0, zoom: 0.25})
    assert bench.clock.now_s() - began_s < 3.0  # 2.5 s for the pan alone, 1.6 s for the ring
    assert (arrived[pan], arrived[zoom]) == (pytest.approx(60.0, abs=0.1), pytest.approx(0.25, abs=0.001))
    assert bench.angle_deg(zoom) == pytest.approx(30.0, abs=0.05)


@pytest.mark.parametrize("dead", GONE, ids=lambda error: type(error).__name__)
def test_point_29_after_any_exception_the_bus_is_usable_again(dead: Exception) -> None:
    bench = Workbench(pan_settings(), dead=dead)
    axis = bench.ready()
    for _ in range(3):
        bench.line.unplug()
        with pytest.raises(LinkLostError):
            axis.status()
        bench.line.plug_in()
        axis.connect()
        assert axis.status().position == pytest.approx(0.0)


def test_point_29_an_interrupt_within_the_sdk_leaves_the_bus_usable() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()

    def interrupt() -> None:
        raise KeyboardInterrupt

    bench.clock.call_at(bench.clock.now_s() + 1e-3, interrupt)
    with pytest.raises(KeyboardInterrupt):
        axis.status()
    assert axis.status().position == pytest.approx(0.0)


def test_point_30_a_stuck_servo_fails_the_move() -> None:
    bench = Workbench(pan_settings(), script=[Fault(FaultKind.STUCK_AXIS, at_s=1.5)])
    axis = bench.ready()
    with pytest.raises(HardwareError, match=r"pan servo 1 on bus is stuck: -\d+\.\d+° from where it was sent"):
        axis.move_to(200.0)
    assert bench.clock.now_s() < 3.5
    assert bench.servo.memory[table.GOAL_POSITION] == bench.servo.present  # it no longer pulls


def test_point_30_a_servo_that_stops_short_of_its_goal_is_no_arrival() -> None:
    bench = Workbench(pan_settings(tolerance_deg=0.1))
    axis = bench.ready()
    bench.clock.call_at(bench.clock.now_s() + 2.4, lambda: bench.servo.jam(1e9))
    with pytest.raises(HardwareError, match="is stuck"):
        axis.move_to(58.0)
    assert 50.0 < bench.angle_deg() < 57.9


def test_point_31_a_watchdog_trip_is_noticed_and_clearing_it_moves_nothing() -> None:
    bench = Workbench(pan_settings(watchdog_ms=100))
    axis = bench.ready()
    # The host is away for a second in mid-move, longer than the watchdog waits.
    bench.clock.call_at(bench.clock.now_s() + 1.0, lambda: bench.clock.sleep_s(1.0))
    with pytest.raises(HardwareError, match="stopped by its bus watchdog"):
        axis.move_to(200.0)
    stopped = bench.angle_deg()
    assert "bus watchdog" in axis.status().trouble
    with pytest.raises(HardwareError, match="bus watchdog"):
        axis.move_to(0.0)
    axis.enable()
    bench.clock.sleep_s(2.0)
    assert bench.angle_deg() == pytest.approx(stopped, abs=0.1)
    assert axis.move_to(0.0) == pytest.approx(0.0, abs=0.1)
    assert bench.monitor.violations == []


def test_point_31_the_watchdog_is_off_while_nothing_moves() -> None:
    bench = Workbench(pan_settings(watchdog_ms=100))
    axis = bench.ready()
    axis.move_to(10.0)
    bench.clock.sleep_s(60.0)  # a long exposure: nobody talks to the servo
    assert axis.status().trouble == ""
    assert axis.move_to(0.0) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(("policy", "held"), [("hold", True), ("release", False)])
def test_point_32_closing_follows_the_torque_policy(policy: str, held: bool) -> None:
    bench = Workbench(pan_settings(torque_at_close=policy))
    axis = bench.ready()
    axis.close()
    axis.close()
    assert bench.servo.torque is held


def test_point_32_a_policy_that_cannot_be_followed_is_reported_once() -> None:
    bench = Workbench(pan_settings(torque_at_close="release"))
    axis = bench.ready()
    bench.servo.mute_until_s = 1e9
    with pytest.raises(HardwareError, match=r"does not answer.*torque at close \(release\) is not as the bench file"):
        axis.close()
    axis.close()


@pytest.mark.parametrize(("policy", "held"), [("hold", True), ("release", False)])
def test_point_32_a_failed_start_follows_the_torque_policy(policy: str, held: bool) -> None:
    bench = Workbench(pan_settings(torque_at_failed_start=policy))
    bench.servo.memory[table.HOMING_OFFSET] = 10
    bench.servo.write(64, b"\x01")  # left so by a program before
    with pytest.raises(HardwareError, match="homing offset"):
        bench.axis.connect()
    assert bench.servo.torque is held


@pytest.mark.parametrize(("policy", "held"), [("hold", True), ("release", False)])
def test_point_32_a_stop_follows_the_torque_policy_and_ends_the_move(policy: str, held: bool) -> None:
    bench = Workbench(pan_settings(torque_at_stop=policy))
    axis = bench.ready()
    reports = []
    asked_s = bench.clock.now_s() + 2.0
    bench.clock.call_at(asked_s, lambda: reports.append(axis.stop()))
    with pytest.raises(HardwareError, match="was stopped"):
        axis.move_to(200.0)
    (report,) = reports
    assert report.confirmed
    assert report.position_kept
    assert report.trouble == ""
    assert report.sent_at_s is not None
    assert report.sent_at_s - asked_s < 0.05
    assert bench.servo.torque is held
    stopped = bench.angle_deg()
    bench.clock.sleep_s(2.0)
    assert bench.angle_deg() == pytest.approx(stopped, abs=0.1)
    assert bench.monitor.violations == []


def test_point_32_no_goal_follows_a_stop() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    goals = bench.monitor.goals
    bench.clock.call_at(bench.clock.now_s() + 3e-3, axis.stop)  # while the watchdog is being armed
    with pytest.raises(HardwareError, match="was stopped"):
        axis.move_to(200.0)
    assert bench.monitor.goals == goals
    assert axis.move_to(10.0) == pytest.approx(10.0, abs=0.1)  # to latch a STOP is the guard's


def test_point_32_a_stop_that_cannot_be_sent_says_so_and_never_raises() -> None:
    bench = Workbench(pan_settings())
    assert bench.axis.stop().sent_at_s is None
    axis = bench.ready()
    bench.line.unplug()
    report = axis.stop()
    assert (report.sent_at_s, report.confirmed) == (None, False)
    assert "connect again" in report.trouble.lower()


def test_point_32_a_mute_servo_is_told_to_let_go_and_the_stop_is_not_confirmed() -> None:
    bench = Workbench(pan_settings())
    axis = bench.ready()
    bench.servo.mute_until_s = bench.clock.now_s() + 3.0
    report = axis.stop()
    assert report.sent_at_s is not None
    assert not report.confirmed
    assert "could not be switched off" in report.trouble


def test_modes_of_the_bench_file_are_those_of_the_servo() -> None:
    for mode, number in MODE_NUMBER.items():
        bench = Workbench(pan_settings(mode=mode, role={"lower_deg": -90.0, "upper_deg": 90.0}))
        assert bench.servo.memory[table.OPERATING_MODE] == number
        bench.axis.connect()
