"""A controller that restarts when nobody expects it: never believed homed, never let do what was meant for another."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

import pytest

from calibration_free_tests.gantry.simulated_bench import ALL, Bench, name_of
from calibration_free_tests.guard.real_time import StopBench
from drivers.grbl_settings import GrblAxis
from rig.devices import Motion, StopReport
from rig.errors import HardwareError
from sim_backends.grbl_emulator.dialects import GRBL_1_1, GRBLHAL, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.machine import State
from sim_backends.grbl_emulator.mechanics import Mechanics


def restarted_while_mute(number: int) -> Bench:
    """GRBL in an alarm in which it answers nothing, and then restarted by its button."""
    bench = Bench(GRBL_1_1)
    gantry = bench.homed()
    gantry.move_to(-100.0, -100.0, -50.0)
    bench.machine.raise_alarm(number)
    bench.clock.sleep_s(0.1)
    bench.gantry.status()
    bench.machine.power_up()
    bench.clock.sleep_s(1.0)
    return bench


@pytest.mark.parametrize("number", [1, 2])
def test_homing_after_a_restart_in_a_mute_alarm_is_watched_to_its_end(number: int) -> None:  # 3, 13
    bench = restarted_while_mute(number)
    try:
        assert bench.gantry.home().homed
    except HardwareError:
        assert bench.machine.state is not State.HOME
        assert not bench.machine.planner.running
        assert bench.gantry.home().homed
    assert bench.machine.state is State.IDLE
    assert bench.gantry.move_to(-50.0, -50.0, -20.0) == pytest.approx((-50.0, -50.0, -20.0), abs=0.05)


def test_a_restart_in_a_mute_alarm_is_seen_by_asking_for_the_status() -> None:  # 3
    bench = restarted_while_mute(2)
    status = bench.gantry.status()
    assert not status.homed
    assert status.position_mm is None


def test_a_stop_after_a_restart_in_a_mute_alarm_does_not_claim_the_position() -> None:  # 19
    bench = restarted_while_mute(2)
    assert not bench.gantry.stop().position_kept


def test_after_a_stop_in_a_mute_alarm_the_controller_is_asked_again() -> None:
    bench = Bench(GRBL_1_1)
    gantry = bench.homed()
    bench.machine.raise_alarm(2)
    bench.clock.sleep_s(0.1)
    gantry.status()
    assert gantry.stop().confirmed
    before = len(bench.device.written)
    gantry.status()
    assert b"?" in b"".join(data for _, data in bench.device.written[before:])


def endless(dialect: Dialect) -> Bench:
    """A machine without switches, that may be anywhere."""
    axis = GrblAxis(lower_mm=-300.0, upper_mm=300.0, feed_mm_per_min=2400.0)
    return Bench(
        dialect,
        firmware={**BENCH, 20: 0, 21: 0, 22: 0},
        homing="none",
        mechanics=Mechanics(((-400.0, 400.0),) * 3, start_mm=(0.0, 0.0, 0.0)),
        x=axis,
        y=axis,
        z=axis,
    )


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_a_restart_in_mid_move_is_not_believed_though_its_banner_was_garbled(dialect: Dialect) -> None:  # 3, 10
    bench = endless(dialect)
    gantry = bench.gantry
    gantry.connect()
    gantry.move_to(100.0, 0.0, 0.0)
    say = bench.machine.say

    def restart() -> None:
        bench.machine.say = lambda line: say(line.replace("rbl", "\x7fl") if "help" in line else line)  # type: ignore[method-assign]  # a garbled wire
        bench.machine.power_up()

    bench.at_in(1.0, restart)
    with pytest.raises(HardwareError):
        gantry.move_to(200.0, 0.0, 0.0)
    status = gantry.status()
    assert not status.homed
    assert "home it again" in status.trouble


def test_a_controller_that_says_it_is_not_homed_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:  # 13
    """grblHAL tells ``H:0`` once, and then only when it changes."""
    from sim_backends.grbl_emulator import report

    told = report.status
    left = ["|H:0>"]

    def once(*args: object, **kw: object) -> str:
        line: str = told(*args, **kw)  # type: ignore[arg-type]  # passed on as they come
        return line[:-1] + left.pop() if left else line

    monkeypatch.setattr(report, "status", once)
    bench = Bench(GRBLHAL, firmware={**BENCH, 20: 0, 22: 0}, homing="trusted")
    bench.gantry.connect()
    assert not bench.gantry.status().homed


@pytest.mark.parametrize("gap_s", [0.02, 0.06, 0.15])
@pytest.mark.parametrize("first", ["stop", "hold"])
def test_a_second_stop_while_the_first_one_brakes_costs_nothing(first: str, gap_s: float) -> None:  # 19
    with tempfile.TemporaryDirectory() as folder, StopBench(Path(folder)) as bench:
        bench.machine.eeprom.write("120=60")
        move = bench.moving(300.0)
        time.sleep(1.5)
        reports: list[StopReport | None] = []
        guard = bench.guard
        before = threading.Thread(target=lambda: reports.append(guard.stop("one") if first == "stop" else guard.hold()))
        before.start()
        time.sleep(gap_s)
        reports.append(guard.stop("two"))
        before.join(20.0)
        move.join(20.0)
        assert [report and (report.confirmed, report.position_kept) for report in reports] == [(True, True)] * 2
        guard.release()
        assert guard.status().rig.gantry.motion is Motion.IDLE  # type: ignore[union-attr]  # it has a gantry
