"""Moves that are done when they are done, and that go where they are told. Numbers as in the list of behaviour."""

from __future__ import annotations

import math

import pytest

from calibration_free_tests.gantry.simulated_bench import ALL, BOTH, Bench, name_of
from drivers.grbl_replies import Garbage, parse_reply
from drivers.grbl_settings import GrblAxis
from rig.errors import HardwareError, UnreachableError
from sim_backends.faults import Fault, FaultKind, Side
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH, DEFAULTS, Eeprom
from sim_backends.grbl_emulator.machine import State

PLACE = (-100.0, -50.0, -20.0)


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
@pytest.mark.parametrize("start_delay_s", [0.0, 0.05])
def test_a_move_returns_only_when_it_is_at_rest_at_its_target(dialect: Dialect, start_delay_s: float) -> None:  # 8
    bench = Bench(dialect, start_delay_s=start_delay_s)
    gantry = bench.homed()
    for place in [PLACE, (-100.0, -50.0, -20.02), (-99.0, -50.0, -20.0), (-300.0, -250.0, -150.0)]:
        read = gantry.move_to(*place)
        assert bench.machine.state is State.IDLE
        assert not bench.machine.planner.running
        assert bench.truth == pytest.approx(place, abs=1e-6)
        assert read == pytest.approx(place, abs=0.002)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_an_idle_from_before_the_motion_is_not_taken_for_its_end(dialect: Dialect) -> None:  # 8
    bench = Bench(dialect, start_delay_s=0.08)
    gantry = bench.homed()
    gantry.move_to(*PLACE)
    near = (PLACE[0] + 0.04, PLACE[1], PLACE[2])  # within tolerance before it has begun
    gantry.move_to(*near)
    assert bench.truth == pytest.approx(near, abs=1e-6)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_lost_ok_ends_in_bounded_time_and_nothing_is_sent_again(dialect: Dialect) -> None:  # 9
    bench = Bench(dialect)
    gantry = bench.homed()
    began_s, lines = bench.clock.now_s(), len(bench.lines_written())
    bench.device.wire.add(Fault(FaultKind.DROP, Side.FROM_DEVICE, at_s=began_s, count=10_000))
    with pytest.raises(HardwareError, match="no valid status"):
        gantry.move_to(*PLACE)
    assert bench.clock.now_s() - began_s < 20.0
    assert len(bench.lines_written()) - lines <= 1
    assert not bench.machine.planner.running


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_only_the_ok_lost_means_stopped_with_the_position_kept(dialect: Dialect) -> None:  # 9
    bench = Bench(dialect)
    gantry = bench.homed()
    lines = len(bench.lines_written())
    swallow_next_ok(bench, b"ok\r\n")
    with pytest.raises(HardwareError, match=r"no answer to 'G21G90.*nothing was sent again"):
        gantry.move_to(-390.0, -290.0, -190.0)
    assert len(bench.lines_written()) == lines + 1
    assert bench.machine.state is State.IDLE
    assert gantry.status().homed
    assert gantry.move_to(*PLACE) == pytest.approx(PLACE)


def swallow_next_ok(bench: Bench, instead_of: bytes, by: bytes = b"") -> None:
    """The controller's next output of that text becomes another, once."""
    take, done = bench.machine.take_output, []

    def taken() -> list[tuple[float, bytes]]:
        out = take()
        for index, (at_s, data) in enumerate(out):
            if data == instead_of and not done:
                out[index] = (at_s, by)
                done.append(True)
        return out

    bench.machine.take_output = taken  # type: ignore[method-assign]  # the fault is in the machine's voice


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("answer", [b"ok\r\nok\r\n", b"o\r\n", b"k\r\n", b"ok", b"error:9\r\nok\r\n"])
def test_a_wrong_answer_stops_and_brings_back_into_step(dialect: Dialect, answer: bytes) -> None:  # 10
    bench = Bench(dialect)
    gantry = bench.homed()
    swallow_next_ok(bench, b"ok\r\n", answer)
    with pytest.raises(HardwareError):
        gantry.move_to(*PLACE)
    assert not bench.machine.planner.running
    assert b"!" in bench.bytes_written()
    assert gantry.status().homed
    for place in [(-120.0, -60.0, -30.0), PLACE]:
        assert gantry.move_to(*place) == pytest.approx(place)
    assert bench.monitor.violations == []


GARBLED = [
    b"<Idle|MPos:-100.000,-50.000,-20.0",
    b"<Idle|MPos:-900.000,-50.000,-20.000|FS:0,0>\r\n",
    b"<Idle|MPos:100.000,-50.000,-20.000|FS:0,0>\r\n",
    b"<Idle|MPos:-100.0,-50.000,-20.000|FS:0,0>\r\n",
    b"<Idme|MPos:-100.000,-50.000,-20.000|FS:0,0>\r\n",
    b"<Idle|MPos:-100.000,-50.000|FS:0,0>\r\n",
    b"<Idle|MPos:-100.000,-50.000,-20.000<Idle|FS:0,0>\r\n",
    b"\xff\x00garbage\r\n",
]


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("garbled", GARBLED)
def test_garbled_status_lines_are_dropped_and_the_position_never_jumps(dialect: Dialect, garbled: bytes) -> None:  # 11
    bench = Bench(dialect)
    gantry = bench.homed()
    gantry.move_to(*PLACE)
    take, left = bench.machine.take_output, [garbled]

    def taken() -> list[tuple[float, bytes]]:
        return [(at_s, left.pop() if left and data.startswith(b"<") else data) for at_s, data in take()]

    bench.machine.take_output = taken  # type: ignore[method-assign]  # the fault is in the machine's voice
    for _ in range(3):
        status = gantry.status()
        assert status.position_mm == pytest.approx(PLACE)
        assert status.homed
    assert not left


@pytest.mark.parametrize("garbled", [line for line in GARBLED if b"900" not in line and b":100" not in line])
def test_what_is_no_whole_status_report_is_not_read_as_one(garbled: bytes) -> None:  # 11
    assert isinstance(parse_reply(garbled.decode("latin-1").rstrip()), Garbage)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_an_old_status_is_shown_as_stale_and_blocks_moves(dialect: Dialect) -> None:  # 12
    bench = Bench(dialect)
    gantry = bench.homed()
    gantry.status()
    fresh = gantry.last_status
    assert fresh is not None
    assert fresh.trouble == ""
    bench.clock.sleep_s(5.0)
    stale = gantry.last_status
    assert stale is not None
    assert "stale: read 5.0 s ago" in stale.trouble
    bench.machine.apply_fault(Fault(FaultKind.HANG, at_s=0.0))
    lines = len(bench.lines_written())
    with pytest.raises(HardwareError, match="no valid status"):
        gantry.move_to(*PLACE)
    with pytest.raises(HardwareError, match="dead"):
        gantry.move_to(*PLACE)
    assert len(bench.lines_written()) == lines


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("place", [(1.0, -50, -20), (-399, -50, -20), (math.nan, -50, -20), (-100, math.inf, -20)])
def test_our_limits_hold_where_the_firmwares_are_off(dialect: Dialect, place: tuple[float, float, float]) -> None:  # 14
    bench = Bench(dialect, firmware={**BENCH, 20: 0, 21: 0})
    gantry = bench.homed()
    written = len(bench.bytes_written())
    with pytest.raises(UnreachableError, match=r"[xy] = .* outside its limits .* to .*Choose"):
        gantry.move_to(*place)
    assert len(bench.bytes_written()) == written
    with pytest.raises(UnreachableError):
        gantry.jog(place[0] - (-2.0) if math.isfinite(place[0]) else math.nan, place[1] + 2.0, 0.0)
    assert bench.lines_written() == ["$I", "$$", "$$", "$H"]
    assert bench.monitor.violations == []


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_no_absolute_move_before_homing_without_an_override(dialect: Dialect) -> None:  # 15
    bench = Bench(dialect)
    bench.gantry.connect()
    with pytest.raises(HardwareError, match=r"ALARM|not homed"):
        bench.gantry.move_to(*PLACE)
    idle = Bench(dialect, firmware={**BENCH, 22: 0, 20: 0})
    idle.gantry.connect()
    with pytest.raises(HardwareError, match=r"not homed.*rig home"):
        idle.gantry.move_to(*PLACE)
    with pytest.raises(UnreachableError, match="unhomed_jog_mm"):
        idle.gantry.jog(-1.0, 0.0, 0.0)
    assert not any("X" in line for line in bench.lines_written() + idle.lines_written())


def test_homing_may_be_overridden_explicitly() -> None:  # 15
    trusting = Bench(GRBL_1_1, homing="trusted")
    trusting.terminal.home()
    trusting.gantry.connect()
    assert trusting.gantry.move_to(*PLACE) == pytest.approx(PLACE)
    without = Bench(GRBL_1_1, firmware={**BENCH, 20: 0, 21: 0, 22: 0}, homing="none")
    without.gantry.connect()
    assert without.gantry.move_to(-10.0, -10.0, -10.0) == pytest.approx((-10.0, -10.0, -10.0))
    jogging = Bench(GRBL_1_1, firmware={**BENCH, 22: 0, 20: 0, 21: 0}, unhomed_jog_mm=2.0)
    before = jogging.truth
    jogging.gantry.connect()
    jogging.gantry.jog(-1.0, 0.0, 0.0)
    assert jogging.truth[0] == pytest.approx(before[0] - 1.0)
    with pytest.raises(UnreachableError, match="2 mm"):
        jogging.gantry.jog(-2.1, 0.0, 0.0)


def test_a_controller_that_restarted_on_connecting_is_not_trusted() -> None:  # 15
    bench = Bench(GRBL_1_1, firmware={**BENCH, 22: 0, 20: 0}, homing="trusted")
    bench.at_in(0.001, lambda: bench.machine.power_up(0.5))
    bench.gantry.connect()
    assert not bench.gantry.status().homed


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
@pytest.mark.parametrize(
    "left_over", ["G20", "G91", "G92X0Y0Z0", "G10L2P1X-77Y-13Z5", "G55", "G93", "$10=0", "G20G91G92X3"]
)
def test_what_others_left_behind_changes_nothing(dialect: Dialect, left_over: str) -> None:  # 22
    bench = Bench(dialect)
    bench.terminal.home()
    assert bench.terminal.type(left_over)[-1] == "ok"
    gantry = bench.homed()
    assert gantry.move_to(*PLACE) == pytest.approx(PLACE, abs=0.002)
    assert bench.truth == pytest.approx(PLACE, abs=1e-6)
    gantry.jog(-10.0, 0.0, 0.0)
    assert bench.truth == pytest.approx((-110.0, -50.0, -20.0), abs=1e-6)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_target_that_is_missed_fails(dialect: Dialect) -> None:  # 30
    bench = Bench(dialect)
    gantry = bench.homed()
    # becomes on its way: one bit, which GRBL cannot notice. One ``?`` goes before the line.
    before = bench.device.wire.bytes_sent(Side.TO_DEVICE) + len(b"?" + b"G21G90G94G53G1X-1")
    bench.device.wire.add(Fault(FaultKind.FLIP, at_byte=before, mask=0x08))
    with pytest.raises(HardwareError, match=r"not arrived at \(-100\.000, -50\.000, -20\.000\)"):
        gantry.move_to(*PLACE)
    assert b"X-180.000" not in bench.bytes_written()
    assert not bench.machine.planner.running


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_position_that_changes_by_itself_is_not_believed(dialect: Dialect) -> None:  # 3
    bench = Bench(dialect, firmware={**BENCH, 22: 0, 20: 0, 21: 0}, homing="none")
    gantry = bench.gantry
    gantry.connect()
    gantry.move_to(-10.0, -10.0, -10.0)
    bench.machine.power_up()
    bench.terminal.listen(0.1)  # its banner is lost
    with pytest.raises(HardwareError, match=r"not homed|changed"):
        gantry.move_to(-20.0, -10.0, -10.0)
    assert "changed without a command" in gantry.status().trouble


def test_a_slow_machine_is_waited_for() -> None:  # 8
    slow = {**DEFAULTS, 20: 1, 22: 1, 24: 100, 25: 500, 130: 400, 131: 300, 132: 200}
    bench = Bench(GRBL_1_1, firmware=slow)
    gantry = bench.homed()
    assert gantry.move_to(-60.0, -10.0, -4.0) == pytest.approx((-60.0, -10.0, -4.0), abs=0.002)
    assert Eeprom(slow)[110] == 500


def test_each_axis_keeps_its_own_feed() -> None:
    quick = Bench().settings
    bench = Bench(GRBL_1_1, z=replace_feed(quick.z, 300.0))
    gantry = bench.homed()
    began_s = bench.clock.now_s()
    gantry.move_to(-10.0, -10.0, -22.0)
    assert bench.clock.now_s() - began_s > 20.0 / (300.0 / 60.0)


def replace_feed(axis: GrblAxis, feed: float) -> GrblAxis:
    return axis.model_copy(update={"feed_mm_per_min": feed})


def test_numbers_are_written_in_fixed_point() -> None:
    bench = Bench(GRBL_1_1)
    gantry = bench.homed()
    gantry.move_to(-100.00000001, -1e1, -20.0)
    assert bench.lines_written()[-1].startswith("G21G90G94G53G1X-100.000Y-10.000Z-20.000F")
