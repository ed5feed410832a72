"""The emulated controllers do what was seen on real GRBL 1.1h and grblHAL firmware; no driver in between."""

from __future__ import annotations

import math

import pytest

from calibration_free_tests.gantry.simulated_bench import ALL, BOTH, name_of
from calibration_free_tests.gantry.terminal import Terminal
from sim_backends.faults import Fault, FaultKind, Side
from sim_backends.grbl_emulator.dialects import FLUIDNC, GRBL_1_1, GRBLHAL, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH, DEFAULTS
from sim_backends.grbl_emulator.machine import State
from sim_backends.grbl_emulator.mechanics import Mechanics, switches_of

LIMITS_OFF = {**BENCH, 20: 0, 21: 0, 22: 0}


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_ok_means_buffered_not_done(dialect: Dialect) -> None:
    terminal = Terminal(dialect)
    terminal.home()
    assert terminal.type("G53G1X-390F3000") == ["ok"]
    assert terminal.ask().startswith("<Run|")
    assert terminal.machine.mechanics.position[0] > -20.0


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_idle_may_be_reported_before_motion_begins(dialect: Dialect) -> None:
    terminal = Terminal(dialect, start_delay_s=0.05)
    terminal.home()
    terminal.port.write(b"G53G1X-390F3000\n?")
    assert terminal.listen(0.04)[-1].startswith("<Idle|")
    terminal.listen(0.02)
    assert terminal.ask().startswith("<Run|")


def test_a_trapezoid_takes_the_time_that_physics_asks_for() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    terminal.type("G53G1X-10F3000", 2.0)
    began_s = terminal.clock.now_s()
    terminal.port.write(b"G53G1X-110F3000\n")
    terminal.clock.wait_until(lambda: terminal.machine.planner.running, began_s + 1.0)
    started_s = terminal.clock.now_s()
    terminal.clock.wait_until(lambda: not terminal.machine.planner.running, began_s + 10.0)
    assert terminal.clock.now_s() - started_s == pytest.approx(100.0 / 50.0 + 50.0 / 500.0)


def test_moves_in_one_direction_are_joined_without_stopping() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    for place in (-30, -60, -90):
        terminal.port.write(f"G53G1X{place}F3000\n".encode())
    slowest = math.inf
    terminal.listen(0.3)
    while terminal.machine.mechanics.position[0] > -80.0:
        terminal.listen(0.01)
        slowest = min(slowest, abs(terminal.machine.planner.velocity[0]))
    assert slowest == pytest.approx(50.0)


def test_a_corner_is_taken_slowly_and_a_turn_back_from_rest() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    terminal.port.write(b"G53G1X-30F3000\nG53G1Y-30\nG53G1Y-2\n")
    speeds = []
    while terminal.machine.state is State.RUN or not speeds:
        terminal.listen(0.002)
        speeds.append((terminal.machine.mechanics.position, math.hypot(*terminal.machine.planner.velocity)))
    turned = next(index for index, (place, _) in enumerate(speeds) if place[1] < -3.0)
    corner = min(speed for place, speed in speeds[:turned] if place[0] < -29.0)
    assert 0.0 < corner < 10.0
    assert terminal.machine.mechanics.position == pytest.approx((-30.0, -2.0, -2.0))


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_hold_then_reset_keeps_the_position_and_reset_in_motion_loses_it(dialect: Dialect) -> None:
    terminal = Terminal(dialect)
    terminal.home()
    terminal.type("G53G1X-390F5000", 0.5)
    assert terminal.type(b"!", 0.02) == []
    assert terminal.ask().startswith("<Hold:1|")
    terminal.listen(0.5)
    assert terminal.ask().startswith("<Hold:0|")
    assert terminal.type("G53G1X-300F5000") == []  # nothing is read in a hold
    assert terminal.type(b"\x18")[0] == dialect.banner
    assert terminal.ask().startswith("<Idle|")
    assert terminal.machine.homed
    terminal.type("G53G1X-390F5000", 0.5)
    assert terminal.type(b"\x18")[0] == "ALARM:3"
    assert terminal.machine.mechanics.axes[0].lost_mm > 0.0
    assert not terminal.machine.homed


def test_cycle_start_goes_on_after_a_hold() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    terminal.type("G53G1X-100F5000", 0.5)
    terminal.type(b"!", 1.0)
    terminal.type(b"~", 3.0)
    assert terminal.machine.mechanics.position[0] == pytest.approx(-100.0)


def test_real_time_bytes_act_from_anywhere_even_in_a_comment() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    terminal.type("G53G1X-390F5000", 0.5)
    terminal.type(b"(stop here! please", 1.0)
    assert terminal.machine.state is State.HOLD


def test_grblhal_takes_printable_real_time_bytes_in_a_system_line_for_text() -> None:
    terminal = Terminal(GRBLHAL)
    terminal.home()
    terminal.type("G53G1X-390F5000", 0.5)
    terminal.type(b"$J=G91X1!", 1.0)
    assert terminal.machine.state is State.RUN
    terminal.type(b"\x82", 1.0)
    assert terminal.machine.state is State.HOLD


def test_only_fluidnc_starts_a_macro_on_the_byte_of_grblhals_full_report() -> None:
    full = Terminal(GRBLHAL)
    full.home()
    report = full.type(b"\x87")[-1]
    assert "WCO:" in report
    assert "|H:1>" in report
    macro = Terminal(FLUIDNC)
    assert macro.type(b"\x87") == []
    assert [violation.what for violation in macro.monitor.violations] == ["a stored macro was started"]
    assert Terminal(GRBL_1_1).type(b"\x87") == []


def test_twenty_five_unthrottled_jogs_go_on_after_their_cancel() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    for _ in range(25):
        terminal.port.write(b"$J=G91 X-2.000 F1000\n")
        terminal.clock.sleep_s(0.002)
    terminal.listen(0.2)
    assert terminal.machine.state is State.JOG
    before = terminal.machine.mechanics.position[0]
    terminal.type(b"\x85", 5.0)
    assert before - terminal.machine.mechanics.position[0] > 3.0
    assert terminal.type("")[0].startswith("error:")  # the buffer had overrun, and the last line lacks its end
    assert terminal.machine.state is State.IDLE


def test_one_jog_that_is_cancelled_after_its_ok_ends_soon_and_keeps_its_place() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    assert terminal.type("$J=G91X-100F3000", 0.3) == ["ok"]
    assert terminal.ask().startswith("<Jog|")
    terminal.type(b"\x85", 0.3)
    assert terminal.ask().startswith("<Idle|")
    assert terminal.machine.homed
    assert terminal.machine.mechanics.axes[0].lost_mm == 0.0


def test_the_receive_buffer_holds_128_bytes_and_loses_the_rest() -> None:
    terminal = Terminal(GRBL_1_1, {**BENCH, 10: 3})
    terminal.home()
    terminal.type("G53G1X-390F100", 0.1)
    terminal.type("G4P20", 0.1)
    terminal.type(b"(" + b"x" * 200, 0.1)
    assert "|Bf:15,0|" in terminal.ask() or "|Bf:14,0|" in terminal.ask()


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_writing_the_eeprom_loses_the_bytes_that_arrive_meanwhile(dialect: Dialect) -> None:
    terminal = Terminal(dialect)
    terminal.home()
    assert terminal.type("$110=5000\n$111=5000\n") != ["ok", "ok"]
    settings = terminal.type("$$")
    assert "$110=5000.000" in settings
    assert "$111=6000.000" in settings
    assert terminal.type("$111=5000") == ["ok"]
    assert "$111=5000.000" in terminal.type("$$")


def test_settings_survive_a_power_cycle_and_modal_state_does_not() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.type("$110=5000")
    terminal.type("$X")
    terminal.type("G20G91G55")
    assert "G55" in terminal.type("$G")[0]
    terminal.machine.apply_fault(Fault(FaultKind.POWER_CYCLE, at_s=0.0))
    assert GRBL_1_1.banner in terminal.listen(1.0)
    assert "$110=5000.000" in terminal.type("$$")
    assert "G54 G17 G21 G90 G94" in terminal.type("$G")[0]


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_homing_is_silent_and_ends_at_the_pull_off(dialect: Dialect) -> None:
    terminal = Terminal(dialect)
    assert terminal.type("$H", 5.0) == []
    assert terminal.type(b"?", 1.0) == []
    assert terminal.listen(60.0)[-1] == "ok"
    assert "MPos:-2.000,-2.000,-2.000" in terminal.ask()
    assert terminal.machine.mechanics.position == pytest.approx((-2.0, -2.0, -2.0))


def test_fluidnc_answers_while_homing() -> None:
    terminal = Terminal(FLUIDNC)
    terminal.type("$H", 2.0)
    assert terminal.ask().startswith("<Home|")


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_failed_homing_leaves_an_alarm_and_a_bogus_position(dialect: Dialect) -> None:
    terminal = Terminal(dialect)
    terminal.machine.apply_fault(Fault(FaultKind.STUCK_AXIS, number=1, at_s=0.0))
    assert "ALARM:9" in terminal.type("$H", 90.0)
    assert not terminal.machine.homed
    assert "MPos:0.000,0.000,0.000" not in terminal.ask()
    away = Terminal(dialect)
    away.type("$H", 1.0)
    assert "ALARM:6" in away.type(b"\x18")


def test_homing_may_go_to_the_lower_end() -> None:
    terminal = Terminal(GRBL_1_1, {**BENCH, 23: 1})
    terminal.home()
    assert "MPos:-398.000,-2.000,-2.000" in terminal.ask()
    assert terminal.machine.mechanics.position[0] == pytest.approx(-398.0)


def test_grbl_is_mute_after_alarm_2_until_it_is_reset() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    assert terminal.type("G53G1X50F1000") == ["ALARM:2", "[MSG:Reset to continue]"]
    assert terminal.type(b"?") == []
    assert terminal.type("$X") == []
    assert terminal.type(b"\x18")[-1] == "[MSG:'$H'|'$X' to unlock]"
    assert terminal.type("$X") == ["[MSG:Caution: Unlocked]", "ok"]
    assert terminal.machine.homed


def test_grblhal_answers_after_alarm_1_but_refuses_to_unlock() -> None:
    terminal = Terminal(GRBLHAL, {**BENCH, 20: 0})
    terminal.home()
    assert "ALARM:1" in terminal.type("G53G1X5F1000", 1.0)
    assert terminal.ask().startswith("<Alarm:1|")
    assert terminal.type("$X") == ["error:79"]
    terminal.type(b"\x18")
    assert not terminal.machine.homed


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_an_unhomed_jog_out_of_range_is_refused_by_grbl_and_run_by_grblhal(dialect: Dialect) -> None:
    terminal = Terminal(dialect, {**BENCH, 21: 0})
    terminal.machine.state, terminal.machine.alarm = State.IDLE, None
    expected = {"GRBL": ["error:15"], "grblHAL": ["ok"]}[dialect.name]
    assert terminal.type("$J=G91X5F1000") == expected


def test_an_overlong_line_is_one_error_on_grbl_and_spoils_what_follows_on_grblhal() -> None:
    grbl, hal = Terminal(GRBL_1_1), Terminal(GRBLHAL)
    for terminal in (grbl, hal):
        terminal.home()
        assert terminal.type("G1X" + "1" * 400, 0.2) == ["error:11"]
    assert grbl.type("G53G1X-10F1000") == ["ok"]
    assert hal.type("G53G1X-10F1000") == ["error:11"]
    assert hal.type("$G")[-1] == "ok"
    assert hal.type("G53G1X-10F1000") == ["ok"]


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize(
    ("line", "reply"),
    [
        ("G1X1e-07F100", "error:20"),
        ("G1XnanF100", "error:2"),
        ("G1X1", "error:22"),
        ("G1X1X2F100", "error:25"),
        ("G20G21", "error:21"),
        ("G53X1F100G4P0", "error:21"),
        ("$J=X1", "error:22"),
        ("$J=G91F100", "error:26"),
        ("$J=G92X1F100", "error:16"),
        ("5", "error:1"),
        ("$Q", "error:3"),
        ("$20=1", "error:10"),
        ("$H", "error:5"),
        ("G4P0", "ok"),
        ("", "ok"),
    ],
)
def test_lines_are_answered_by_their_numbers(dialect: Dialect, line: str, reply: str) -> None:
    assert Terminal(dialect, LIMITS_OFF).type(line)[-1] == reply


def test_without_limits_a_huge_number_is_accepted() -> None:
    terminal = Terminal(GRBL_1_1, LIMITS_OFF)
    terminal.listen(0.5)
    assert terminal.type(f"G1X{1e22:.0f}F100") == ["ok"]
    assert [violation.what for violation in terminal.monitor.violations] == ["motion while unhomed"]


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_states_lock_what_they_should(dialect: Dialect) -> None:
    terminal = Terminal(dialect)
    assert terminal.type("G1X1F100") == ["error:9"]
    assert terminal.type("$J=G91X1F100") == ["error:8"]
    terminal.home()
    terminal.type("$J=G91X-100F1000")
    assert terminal.type("$G")[-1] == "ok"
    assert terminal.type("G1X-1F100") == ["error:9"]
    assert terminal.type("$$") == ["error:8"]


def test_wco_comes_only_now_and_then_and_at_once_when_it_has_changed() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    reports = [terminal.ask() for _ in range(40)]
    carrying = sum("WCO:" in report for report in reports)
    assert 1 <= carrying <= 6
    assert any("Ov:" in report for report in reports)
    assert not any("WCO:" in report and "Ov:" in report for report in reports)
    terminal.type("G92X0")
    assert "WCO:-2.000,0.000,0.000" in terminal.ask()


def test_a_report_may_carry_work_positions_and_inches() -> None:
    terminal = Terminal(GRBL_1_1, {**BENCH, 10: 0, 13: 1})
    terminal.home()
    terminal.type("G92X0Y0Z25.4")
    report = terminal.ask()
    assert "|WPos:0.0000,0.0000,1.0000|" in report
    assert "MPos" not in report
    assert "WCO:-0.0787,-0.0787,-1.0787" in report


@pytest.mark.parametrize(
    ("lines", "x"),
    [
        (["G20", "G53G1X-1F100"], -25.4),
        (["G91", "G1X-10F2000"], -12.0),
        (["G92X0", "G1X-10F2000"], -12.0),
        (["G10L2P1X-50", "G1X-10F2000"], -60.0),
        (["G92X0", "G10L2P1X-50", "G53G1X-30F2000"], -30.0),
        (["G55", "G10L20P2X5", "G1X0F2000"], -7.0),
    ],
)
def test_modal_state_is_obeyed(lines: list[str], x: float) -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    for line in lines:
        assert terminal.type(line, 0.2) == ["ok"]
    terminal.listen(20.0)
    assert terminal.machine.mechanics.position[0] == pytest.approx(x)


def test_hard_limits_stop_and_alarm() -> None:
    terminal = Terminal(GRBL_1_1, {**BENCH, 20: 0})
    terminal.home()
    assert "ALARM:1" in terminal.type("G53G1X20F5000", 2.0)
    assert terminal.machine.mechanics.position[0] == pytest.approx(0.0, abs=1.0)
    assert not terminal.machine.homed


def test_without_limits_the_frame_stops_the_carriage_and_steps_are_lost() -> None:
    terminal = Terminal(GRBL_1_1, LIMITS_OFF)
    terminal.type("G1X500F6000", 10.0)
    assert terminal.machine.mechanics.position[0] == 3.0
    assert terminal.machine.mechanics.axes[0].lost_mm > 200.0


def test_a_stuck_axis_parts_the_truth_from_the_report() -> None:
    terminal = Terminal(GRBL_1_1)
    terminal.home()
    terminal.machine.apply_fault(Fault(FaultKind.STUCK_AXIS, number=0, at_s=0.0, seconds=0.5))
    terminal.type("G53G1X-102Y-52F3000", 10.0)
    assert "MPos:-102.000,-52.000" in terminal.ask()
    assert terminal.machine.mechanics.position[0] > -95.0
    assert terminal.machine.mechanics.position[1] == pytest.approx(-52.0)
    terminal.home()
    assert terminal.machine.mechanics.position == pytest.approx((-2.0, -2.0, -2.0))


def test_backlash_shows_in_the_truth_and_not_in_the_report() -> None:
    mechanics = Mechanics(switches_of((400.0, 300.0, 200.0), 0), backlash_mm=(0.3, 0.0, 0.0))
    terminal = Terminal(GRBL_1_1, mechanics=mechanics)
    terminal.home()
    stood = []
    for line in ("G53G1X-100F5000", "G53G1X-50F5000", "G53G1X-100F5000", "G53G1X-150F5000", "G53G1X-100F5000"):
        terminal.type(line, 5.0)
        stood.append((terminal.ask().split("|")[1], terminal.machine.mechanics.position[0]))
    at_100 = [place for report, place in stood if report.startswith("MPos:-100.000")]
    assert at_100[0] == pytest.approx(at_100[1])
    assert at_100[0] - at_100[2] == pytest.approx(0.3)


def test_a_machine_of_defaults_neither_homes_nor_limits() -> None:
    terminal = Terminal(GRBL_1_1, DEFAULTS)
    assert terminal.ask().startswith("<Idle|")
    assert terminal.type("$H") == ["error:5"]


def test_the_monitor_sees_what_must_not_be_commanded() -> None:
    terminal = Terminal(GRBL_1_1, LIMITS_OFF)
    terminal.listen(0.5)
    for line in ("G1X-10F100", "$J=G91X-1F100", "G1XnanF100"):
        terminal.type(line)
    whats = [violation.what for violation in terminal.monitor.violations]
    assert whats == ["motion while unhomed", "motion while unhomed", "a number that is not finite"]
    homed = Terminal(GRBL_1_1, {**BENCH, 20: 0, 21: 0})
    homed.home()
    for line in ("G53G1X1F100", "$J=G91G21X5F100", "G53G1X-10F100", "$X", "?", "G4P0"):
        homed.type(line, 2.0)
    whats = [violation.what for violation in homed.monitor.violations]
    assert whats == ["motion out of limits: X1.000", "motion out of limits: X6.000"]
    homed.machine.raise_alarm(1)
    homed.listen(1.0)
    homed.type("G53G1X-10F100")
    assert "motion in alarm" in [violation.what for violation in homed.monitor.violations]


def test_the_monitor_tells_what_the_wire_altered_from_what_the_host_wrote() -> None:
    terminal = Terminal(GRBL_1_1, {**BENCH, 20: 0, 21: 0})
    terminal.home()
    drop = terminal.device.wire.bytes_sent(Side.TO_DEVICE) + len(b"G53G1X")
    terminal.device.wire.add(Fault(FaultKind.DROP, at_byte=drop))
    terminal.type("G53G1X-1F1000")
    (violation,) = terminal.monitor.violations
    assert (violation.what, violation.altered) == ("motion out of limits: X1.000", True)
    assert terminal.monitor.blamed_on_host == []
