"""Alarms, restarts and homing: what is shown, what is lost, and which way leads back. Numbers as in the list."""

from __future__ import annotations

import pytest

from calibration_free_tests.gantry.simulated_bench import ALL, BOTH, Bench, name_of
from drivers.grbl_faults import ALARMS, alarm
from rig.devices import Motion
from rig.errors import HardwareError
from sim_backends.faults import Fault, FaultKind
from sim_backends.grbl_emulator.dialects import GRBL_1_1, GRBLHAL, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH

PLACE = (-100.0, -50.0, -20.0)


def strike(bench: Bench, seconds: float, kind: FaultKind, number: int = 0, lasting_s: float = 0.0) -> None:
    """Let the device fail so many seconds from now."""
    bench.device.wire.add(Fault(kind, at_s=bench.clock.now_s() + seconds, number=number, seconds=lasting_s))


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
@pytest.mark.parametrize("when_s", [0.3, 100.0])
def test_a_banner_that_we_did_not_cause_ends_homed_and_what_was_queued(dialect: Dialect, when_s: float) -> None:  # 3
    bench = Bench(dialect)
    gantry = bench.homed()
    if when_s < 1.0:
        strike(bench, when_s, FaultKind.BANNER)
        with pytest.raises(HardwareError, match=r"restarted.*rig home"):
            gantry.move_to(-390.0, -290.0, -190.0)
    else:
        strike(bench, 0.0, FaultKind.BANNER)
        bench.clock.sleep_s(1.0)
    lines = len(bench.lines_written())
    status = gantry.status()
    assert (status.homed, status.position_mm) == (False, None)
    stood = bench.truth
    with pytest.raises(HardwareError):
        gantry.move_to(*PLACE)
    bench.clock.sleep_s(5.0)
    assert len(bench.lines_written()) == lines
    assert bench.truth == stood
    gantry.home()
    assert gantry.move_to(*PLACE) == pytest.approx(PLACE)
    assert bench.truth == pytest.approx(PLACE)


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_a_restart_ends_homed_even_where_the_controller_comes_back_idle(dialect: Dialect) -> None:  # 3
    bench = Bench(dialect, firmware={**BENCH, 20: 0, 21: 0, 22: 0}, homing="none")
    bench.gantry.connect()
    strike(bench, 0.0, FaultKind.BANNER)
    bench.clock.sleep_s(0.5)
    status = bench.gantry.status()
    assert (status.motion, status.homed, status.position_mm) == (Motion.IDLE, False, None)
    assert "restarted" in status.trouble


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_the_silence_of_homing_is_no_disconnect(dialect: Dialect) -> None:  # 13
    bench = Bench(dialect)
    bench.gantry.connect()
    began_s = bench.clock.now_s()
    assert bench.gantry.home().homed
    assert bench.clock.now_s() - began_s > 10.0
    assert bench.truth == pytest.approx((-2.0, -2.0, -2.0))


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_after_failed_homing_the_position_is_unknown(dialect: Dialect) -> None:  # 13
    bench = Bench(dialect)
    gantry = bench.homed()
    strike(bench, 0.0, FaultKind.STUCK_AXIS, 0)
    with pytest.raises(HardwareError, match=r"ALARM:[89]: homing .*\$"):
        gantry.home()
    status = gantry.status()
    assert (status.motion, status.homed, status.position_mm) == (Motion.ALARM, False, None)
    with pytest.raises(HardwareError):
        gantry.move_to(*PLACE)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_homing_that_never_ends_is_given_up_at_its_own_deadline(dialect: Dialect) -> None:  # 13
    bench = Bench(dialect, firmware={**BENCH, 24: 1.0})
    gantry = bench.gantry
    gantry.connect()
    began_s = bench.clock.now_s()
    with pytest.raises(HardwareError, match="no answer"):
        gantry.home()
    assert 180.0 <= bench.clock.now_s() - began_s < 190.0
    assert not bench.machine.planner.running
    assert not gantry.status().homed


def test_a_homing_command_that_became_another_is_not_believed() -> None:  # 13
    bench = Bench(GRBL_1_1)
    gantry = bench.gantry
    gantry.connect()
    write = bench.device.host_writes

    def garbling(data: bytes, now_s: float) -> None:
        write(data.replace(b"$H", b"$X"), now_s)

    bench.device.host_writes = garbling  # type: ignore[method-assign]  # one flipped bit, which still gets an ok
    with pytest.raises(HardwareError, match="sooner than it can be done"):
        gantry.home()
    assert not gantry.status().homed


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("number", [1, 2])
def test_an_alarm_in_the_middle_of_a_move_shows_its_code_and_remedy(dialect: Dialect, number: int) -> None:  # 16
    bench = Bench(dialect)
    gantry = bench.homed()
    strike(bench, 0.5, FaultKind.ALARM, number)
    with pytest.raises(HardwareError, match=rf"ALARM:{number}: {alarm(number).meaning}\. "):
        gantry.move_to(-390.0, -290.0, -190.0)
    status = gantry.status()
    assert (status.motion, status.alarm, status.homed) == (Motion.ALARM, number, number == 2)
    assert alarm(number).remedy in status.trouble
    with pytest.raises(HardwareError, match=f"ALARM:{number}"):
        gantry.move_to(*PLACE)
    assert b"$X" not in bench.bytes_written()


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_an_alarm_that_keeps_the_position_is_left_by_reset_and_unlock(dialect: Dialect) -> None:  # 17
    bench = Bench(dialect)
    gantry = bench.homed()
    gantry.move_to(*PLACE)
    strike(bench, 0.0, FaultKind.ALARM, 2)
    bench.clock.sleep_s(0.5)
    assert gantry.status().alarm == 2
    written = len(bench.bytes_written())
    status = gantry.unlock()
    assert (status.motion, status.homed) == (Motion.IDLE, True)
    assert status.position_mm == pytest.approx(PLACE)
    text = bench.bytes_written()[written:]
    assert text.index(b"\x18") < text.index(b"$X")
    assert gantry.move_to(-120.0, -60.0, -30.0) == pytest.approx((-120.0, -60.0, -30.0))


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_an_alarm_that_loses_the_position_asks_for_homing(dialect: Dialect) -> None:  # 17
    bench = Bench(dialect)
    gantry = bench.homed()
    strike(bench, 0.5, FaultKind.ALARM, 1)
    with pytest.raises(HardwareError):
        gantry.move_to(-390.0, -290.0, -190.0)
    with pytest.raises(HardwareError, match=r"ALARM:1.*position is lost.*rig home"):
        gantry.unlock()
    assert b"$X" not in bench.bytes_written()
    gantry.home()
    assert gantry.move_to(*PLACE) == pytest.approx(PLACE)
    assert bench.truth == pytest.approx(PLACE)


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_unlocking_what_is_not_locked_sends_nothing(dialect: Dialect) -> None:  # 17
    bench = Bench(dialect)
    gantry = bench.homed()
    assert gantry.unlock().motion is Motion.IDLE
    assert b"$X" not in bench.bytes_written()
    fresh = Bench(dialect)
    fresh.gantry.connect()
    with pytest.raises(HardwareError, match="rig home"):
        fresh.gantry.unlock()


def test_the_table_of_alarms_knows_which_keep_the_position() -> None:  # 17
    assert set(ALARMS) == set(range(1, 23))
    assert not any(alarm(number).position_kept for number in (1, 3, 6, 7, 8, 9, 10, 99))
    assert alarm(2).position_kept
    assert [number for number in range(1, 10) if alarm(number).needs_reset] == [1, 2]


def test_grblhal_obeys_after_an_error_that_it_would_repeat() -> None:
    bench = Bench(GRBLHAL)
    gantry = bench.homed()
    bench.terminal.type("G1X" + "1" * 300)
    bench.terminal.listen()
    with pytest.raises(HardwareError, match="error:11"):
        gantry.move_to(*PLACE)
    assert gantry.move_to(*PLACE) == pytest.approx(PLACE)
