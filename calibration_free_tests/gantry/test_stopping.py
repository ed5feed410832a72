"""STOP, jogs that end, pulled plugs and hung firmware. Numbers as in the list of behaviour."""

from __future__ import annotations

import math
import termios
import threading
from typing import NoReturn

import pytest
import serial

from calibration_free_tests.gantry.simulated_bench import ALL, BOTH, Bench, name_of
from drivers.grbl_errors import StoppedError
from drivers.grbl_settings import GrblDeadlines, GrblSettings
from drivers.serial_link import SerialPort
from rig.devices import Motion, StopReport
from rig.errors import HardwareError
from sim_backends.faults import Fault, FaultKind, Side
from sim_backends.grbl_emulator.dialects import GRBL_1_1, GRBLHAL, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.machine import State

FAR = (-390.0, -290.0, -190.0)
PLACE = (-100.0, -50.0, -20.0)


class HostDied(BaseException):
    """The operator's process is gone: nothing that it would still have done is done."""


def die() -> NoReturn:
    raise HostDied


def travelled_until_rest(bench: Bench) -> tuple[float, float]:
    """Seconds and millimetres from now until nothing moves any more."""
    began_s, began = bench.clock.now_s(), bench.truth
    assert bench.clock.wait_until(lambda: not bench.machine.planner.running, began_s + 60.0)
    return bench.clock.now_s() - began_s, math.dist(began, bench.truth)


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
@pytest.mark.parametrize("accel", [100, 500, 2000])
@pytest.mark.parametrize("after_s", [0.02, 0.31, 0.7, 1.13])
def test_a_jog_ends_within_three_tenths_of_a_second_after_its_operator(
    dialect: Dialect, accel: float, after_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:  # 18
    bench = Bench(dialect, firmware={**BENCH, 120: accel, 121: accel, 122: accel})
    gantry = bench.homed()
    monkeypatch.setattr(gantry, "stop", die)
    bench.at_in(after_s, die)
    with pytest.raises(HostDied):
        gantry.jog(-300.0, 0.0, 0.0)
    seconds, millimetres = travelled_until_rest(bench)
    assert seconds <= 0.3
    assert millimetres <= 5000.0 / 60.0 * 0.25
    assert bench.truth[0] > -300.0


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_jog_that_is_interrupted_overruns_little_and_keeps_the_position(dialect: Dialect) -> None:  # 18
    bench = Bench(dialect)
    gantry = bench.homed()

    def interrupt() -> NoReturn:
        raise KeyboardInterrupt

    bench.at_in(0.6, interrupt)
    with pytest.raises(KeyboardInterrupt):
        gantry.jog(-300.0, 0.0, 0.0)
    stood = bench.truth
    bench.clock.sleep_s(5.0)
    assert bench.truth == stood
    status = gantry.status()
    assert status.homed
    assert status.position_mm == pytest.approx(bench.truth, abs=0.005)


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_a_jog_goes_its_whole_step_in_a_straight_line(dialect: Dialect) -> None:
    bench = Bench(dialect)
    gantry = bench.homed()
    gantry.move_to(*PLACE)
    assert gantry.jog(-20.0, 10.0, 0.3) == pytest.approx((-120.0, -40.0, -19.7), abs=0.005)
    assert bench.truth == pytest.approx((-120.0, -40.0, -19.7), abs=1e-3)
    assert all(line.startswith("$J=G21G90G53X") for line in bench.lines_written() if "J" in line)


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
@pytest.mark.parametrize("after_s", [0.0, 0.013, 0.3, 0.9, 2.0])
def test_stop_holds_then_resets_and_keeps_the_position(dialect: Dialect, after_s: float) -> None:  # 19
    bench = Bench(dialect)
    gantry = bench.homed()
    written = len(bench.device.written)
    stops: list[StopReport] = []
    bench.at_in(after_s, lambda: stops.append(gantry.stop()))
    asked_s = bench.clock.now_s() + after_s
    with pytest.raises(StoppedError, match="STOP"):
        gantry.move_to(*FAR)
    (stop,) = stops
    assert stop.sent_at_s is not None
    assert stop.sent_at_s - asked_s <= 0.05
    assert (stop.confirmed, stop.position_kept, stop.trouble) == (True, True, "")
    sent = [data for _, data in bench.device.written[written:]]
    assert sent.index(b"!") < sent.index(b"\x18")
    assert bench.machine.mechanics.axes[0].lost_mm == 0.0
    stood = bench.truth
    bench.clock.sleep_s(5.0)
    assert bench.truth == stood
    assert gantry.move_to(*PLACE) == pytest.approx(PLACE)
    assert bench.truth == pytest.approx(PLACE)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_stop_in_a_jog_ends_the_jog(dialect: Dialect) -> None:  # 19
    bench = Bench(dialect)
    gantry = bench.homed()
    stops: list[StopReport] = []
    bench.at_in(0.4, lambda: stops.append(gantry.stop()))
    with pytest.raises(StoppedError):
        gantry.jog(-300.0, 0.0, 0.0)
    assert stops[0].confirmed
    assert stops[0].position_kept
    assert gantry.status().motion is Motion.IDLE


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_stop_in_homing_resets_and_says_that_the_position_is_lost(dialect: Dialect) -> None:  # 19
    bench = Bench(dialect)
    bench.gantry.connect()
    stops: list[StopReport] = []
    bench.at_in(2.0, lambda: stops.append(bench.gantry.stop()))
    with pytest.raises(StoppedError):
        bench.gantry.home()
    assert not stops[0].position_kept
    assert "position is lost" in stops[0].trouble
    assert bench.machine.state is State.ALARM
    assert not bench.machine.planner.running


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_stop_resets_after_its_time_out_where_the_hold_is_not_confirmed(dialect: Dialect) -> None:  # 19
    bench = Bench(dialect, firmware={**BENCH, 120: 10, 121: 10, 122: 10})
    gantry = bench.homed()
    stops: list[StopReport] = []
    bench.at_in(6.0, lambda: stops.append(gantry.stop()))
    with pytest.raises(StoppedError):
        gantry.move_to(*FAR)  # braking from here takes longer than hold_s
    assert stops[0].confirmed  # by the reset
    assert not stops[0].position_kept
    assert "position is lost" in stops[0].trouble
    assert not gantry.status().homed
    assert not bench.machine.planner.running
    assert bench.clock.now_s() < 60.0


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_stop_says_so_when_nothing_confirms_it(dialect: Dialect) -> None:  # 19
    bench = Bench(dialect)
    gantry = bench.homed()
    bench.machine.apply_fault(Fault(FaultKind.HANG, at_s=0.0))
    began_s = bench.clock.now_s()
    stop = gantry.stop()
    assert stop.sent_at_s == began_s
    assert not stop.confirmed
    assert "power" in stop.trouble
    assert bench.clock.now_s() - began_s < 15.0
    bench.device.unplug()
    gone = gantry.stop()
    assert (gone.sent_at_s, gone.confirmed) == (None, False)
    assert "could not be sent" in gone.trouble


def test_stop_reaches_the_wire_while_another_thread_holds_the_lock() -> None:  # 19
    bench = Bench(GRBL_1_1, deadlines=GrblDeadlines(hold_s=0.05))  # waited for on the real clock, by the real lock
    gantry = bench.homed()
    held, release = threading.Event(), threading.Event()

    def block() -> None:
        with gantry._lock:
            held.set()
            release.wait(10.0)

    blocker = threading.Thread(target=block)
    blocker.start()
    assert held.wait(10.0)
    writes = len(bench.device.written)
    stop = gantry.stop()
    release.set()
    blocker.join()
    assert [data for _, data in bench.device.written[writes:]] == [b"!", b"\x18"]
    assert not stop.confirmed
    assert "another thread" in stop.trouble


def test_a_lost_line_end_does_not_keep_grblhal_from_stopping() -> None:  # 19
    bench = Bench(GRBLHAL)
    gantry = bench.homed()
    bench.terminal.type("G53G1X-390F1000", 0.5)
    bench.device.host_writes(b"$J=G91X1F100", bench.clock.now_s())  # without its end: ``!`` would be text now
    bench.clock.sleep_s(0.1)
    stop = gantry.stop()
    assert not bench.machine.planner.running
    assert bench.truth[0] > -20.0  # it did not take the reset, seconds later, to stop it
    assert stop.sent_at_s is not None
    assert gantry.connect().kind == "grblHAL"


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
@pytest.mark.parametrize("after_s", [0.1, 0.6, 1.5])
def test_stop_while_connecting_ends_what_another_program_left_running(dialect: Dialect, after_s: float) -> None:  # 19
    bench = Bench(dialect)
    bench.terminal.home()
    bench.terminal.type("G53G1X-390F3000")
    stops: list[StopReport] = []
    bench.at_in(after_s, lambda: stops.append(bench.gantry.stop()))
    with pytest.raises(StoppedError):
        bench.gantry.connect()
    assert stops[0].confirmed
    assert not bench.machine.planner.running
    assert bench.truth[0] > -150.0
    bench.gantry.close()
    assert bench.gantry.connect().kind


def test_stop_while_the_port_is_being_opened_goes_by_that_port() -> None:  # 19
    bench = Bench(GRBL_1_1)
    opening, go_on = threading.Event(), threading.Event()
    open_port = bench.gantry._open_port

    def slowly(wanted: GrblSettings) -> SerialPort:
        assert not opening.is_set()  # nobody could open it twice
        opening.set()
        assert go_on.wait(10.0)
        return open_port(wanted)

    bench.gantry._open_port = slowly
    outcome: list[StopReport | HardwareError] = []

    def connect() -> None:
        try:
            bench.gantry.connect()
        except StoppedError as error:
            outcome.append(error)

    connecting = threading.Thread(target=connect)
    connecting.start()
    assert opening.wait(10.0)
    stopping = threading.Thread(target=lambda: outcome.append(bench.gantry.stop()))
    stopping.start()
    go_on.set()
    connecting.join(30.0)
    stopping.join(30.0)
    assert b"!" in bench.bytes_written()
    (report,) = (each for each in outcome if isinstance(each, StopReport))
    assert report.sent_at_s is not None


def test_stop_without_a_connection_opens_the_port_for_itself() -> None:  # 19
    bench = Bench(GRBL_1_1)
    bench.terminal.home()
    bench.terminal.type("G53G1X-390F3000")
    assert bench.gantry.stop().confirmed
    assert bench.machine.state is State.IDLE
    bench.device.unplug()
    assert "could not be sent" in bench.gantry.stop().trouble


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize(
    "error",
    [OSError(5, "Input/output error"), serial.SerialException("gone"), termios.error(5, "Input/output error"), None],
)
def test_a_pulled_plug_is_noticed_within_a_second(dialect: Dialect, error: Exception | None) -> None:  # 20
    bench = Bench(dialect, unplugged=error)
    gantry = bench.homed()
    pulled_s = bench.clock.now_s() + 0.5
    bench.device.wire.add(Fault(FaultKind.UNPLUG, at_s=pulled_s, seconds=5.0))
    with pytest.raises(HardwareError, match=r"connection is lost.*[Cc]heck cable"):
        gantry.move_to(*FAR)
    assert bench.clock.now_s() - pulled_s <= 1.0
    with pytest.raises(HardwareError, match="dead"):
        gantry.status()
    with pytest.raises(HardwareError, match="cannot be opened"):
        gantry.connect()
    bench.clock.sleep_s(20.0)
    written = len(bench.lines_written())
    stood = bench.truth
    gantry.connect()
    bench.clock.sleep_s(5.0)
    assert set(bench.lines_written()[written:]) == {"$I", "$$"}
    assert bench.truth == stood
    assert not gantry.status().homed


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("doing", ["status", "move", "jog", "home", "connect"])
def test_hung_firmware_ends_in_a_time_out(dialect: Dialect, doing: str) -> None:  # 21
    bench = Bench(dialect)
    gantry = bench.homed()
    actions = {
        "status": gantry.status,
        "move": lambda: gantry.move_to(*PLACE),
        "jog": lambda: gantry.jog(-5.0, 0.0, 0.0),
        "home": gantry.home,
        "connect": gantry.connect,
    }
    bench.device.wire.add(Fault(FaultKind.HANG, at_s=bench.clock.now_s() + (0.0 if doing != "home" else 0.002)))
    began_s = bench.clock.now_s()
    with pytest.raises(HardwareError):
        actions[doing]()
    assert bench.clock.now_s() - began_s < (15.0 if doing != "home" else 200.0)


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("doing", ["move", "jog", "connect"])
def test_firmware_that_hangs_between_a_line_and_its_ok_ends_in_a_time_out(dialect: Dialect, doing: str) -> None:  # 21
    bench = Bench(dialect)
    gantry = bench.homed()
    take = bench.machine.take_output

    def taken() -> list[tuple[float, bytes]]:
        out = take()
        if any(data == b"ok\r\n" for _, data in out):
            bench.machine.apply_fault(Fault(FaultKind.HANG, at_s=0.0))
            return []
        return out

    bench.machine.take_output = taken  # type: ignore[method-assign]  # the fault is in the machine's voice
    actions = {
        "move": lambda: gantry.move_to(*PLACE),
        "jog": lambda: gantry.jog(-5.0, 0.0, 0.0),
        "connect": gantry.connect,
    }
    began_s = bench.clock.now_s()
    with pytest.raises(HardwareError):
        actions[doing]()
    assert bench.machine.hung
    assert bench.clock.now_s() - began_s < 15.0


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_closing_in_the_middle_of_a_move_stops_it(dialect: Dialect) -> None:  # 32
    bench = Bench(dialect)
    gantry = bench.homed()
    bench.at_in(0.5, gantry.close)
    with pytest.raises(HardwareError):
        gantry.move_to(*FAR)
    bench.clock.sleep_s(0.5)
    assert not bench.machine.planner.running
    assert bench.truth[0] > -100.0
    gantry.close()
    with pytest.raises(HardwareError, match="not connected"):
        gantry.status()


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_an_interrupt_in_the_middle_of_a_move_stops_it(dialect: Dialect) -> None:  # 32
    bench = Bench(dialect)
    gantry = bench.homed()

    def interrupt() -> NoReturn:
        raise KeyboardInterrupt

    bench.at_in(0.5, interrupt)
    with pytest.raises(KeyboardInterrupt):
        gantry.move_to(*FAR)
    assert not bench.machine.planner.running
    assert gantry.status().homed


def test_a_failed_start_gives_the_port_back() -> None:  # 32
    bench = Bench(GRBL_1_1)
    bench.device.wire.add(Fault(FaultKind.DROP, Side.FROM_DEVICE, at_s=0.0, count=10**9))
    ports = []
    opener = bench.open_port
    bench.gantry._open_port = lambda wanted: ports.append(opener(wanted)) or ports[-1]  # type: ignore[func-returns-value]  # append
    with pytest.raises(HardwareError, match="nothing answers"):
        bench.gantry.connect()
    with pytest.raises(serial.SerialException):
        ports[0].read(1)
