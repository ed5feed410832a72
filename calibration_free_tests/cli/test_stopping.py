"""``rig stop``: at whatever moment of another command's life, and where nobody holds the bench; and its release."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import pytest

from calibration_free_tests.cli.person import BENCH, SOON_S, Person, moving, run
from calibration_free_tests.guard.real_time import FIRMWARE
from rig.bench import BenchConfig, load_bench
from rig.devices import Identity, StopReport
from rig.errors import HardwareError
from rig.guard import GuardStatus, State
from rig.runtime import Attendance
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.pty_server import PtyServer
from sim_backends.simple_devices import SimpleAxis, SimpleGantry
from sim_backends.wired_device import WiredDevice


def test_a_stop_where_nobody_holds_the_bench_is_latched_for_those_who_come(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    # A simple device that is not connected has nothing to stop, and says that it is at rest.
    assert run("stop", person.bench, "--json") == 0
    assert json.loads(capsys.readouterr().out)["confirmed"]
    assert run("home", person.bench) == 3
    assert "STOP is latched (`rig stop`, process" in capsys.readouterr().err
    assert run("status", person.bench) == 0
    told = capsys.readouterr().out
    assert "state   stopped" in told
    assert f"next    Release it by hand before anything moves: `rig stop {person.bench} --release`" in told
    assert run("stop", person.bench, "--release") == 0
    assert "STOP is released" in capsys.readouterr().out
    assert run("home", person.bench) == 0


def test_a_stop_needs_something_to_stop(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("stop") == 2
    told = "no process of yours holds a bench; those that are just starting will not move. Name the bench file"
    assert told in capsys.readouterr().err
    assert run("stop", "--release") == 2
    assert "which bench is to be released? Name its bench file" in capsys.readouterr().err


def test_a_stop_of_all_keeps_a_command_from_moving_that_has_begun_and_holds_nothing_yet(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("stop") == 2
    # This process has begun before that; one that begins a clock tick later has not.
    time.sleep(2.0 / os.sysconf("SC_CLK_TCK"))
    with person.running("move", person.bench, "--home", "--x-mm", 1) as later:
        _, error = later.communicate(timeout=SOON_S)
    assert later.returncode == 0, error
    assert run("move", person.bench, "--home", "--x-mm", 2) == 3
    assert f"STOP is latched (`rig stop`, process {os.getpid()}, 2" in capsys.readouterr().err
    assert run("stop", person.bench, "--release") == 0


def test_a_stop_is_released_by_the_command_that_it_names(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("stop", person.bench) == 0
    release = f"rig stop {person.bench} --release"
    assert f"nothing moves before it is released: {release}" in capsys.readouterr().out
    assert run(*release.split()[1:]) == 0
    told = capsys.readouterr().out
    assert told.startswith(f"{person.bench}: STOP is released (`rig stop`, process {os.getpid()}, 2")
    assert told.count("process") == 1
    assert run(*release.split()[1:]) == 0
    assert "no STOP was latched" in capsys.readouterr().out


def test_there_is_no_stop_to_release_on_a_bench_that_another_process_holds_unstopped(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    with person.running("status", person.bench, "--watch", "--json") as watcher:
        person.wait_until(lambda told: told["state"] == "unhomed")
        assert run("stop", person.bench, "--release") == 0
        assert "no STOP was latched" in capsys.readouterr().out
        assert run("stop", person.bench) == 0
        assert run("stop", person.bench, "--release") == 0
        assert "STOP is released (`rig stop`" in capsys.readouterr().out
        person.wait_until(lambda told: told["state"] == "unhomed")
        watcher.send_signal(signal.SIGINT)
        watcher.communicate(timeout=SOON_S)


def test_a_stop_that_falls_into_the_start_of_a_command_stops_it(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with ExitStack() as stack:
        movers: list[subprocess.Popen[str]] = []
        ask = Attendance.ask

        def look(attendance: Attendance, what: str, **details: str) -> dict[str, Any] | None:
            if movers or what != "stop":
                return ask(attendance, what, **details)
            # Nobody holds the bench yet; and then somebody has already seen that no STOP is latched.
            movers.append(stack.enter_context(person.running("move", person.bench, "--home", "--x-mm", 500)))
            person.wait_until(moving)
            return None

        monkeypatch.setattr(Attendance, "ask", look)
        assert run("stop", person.bench) == 0
        _, error = movers[0].communicate(timeout=SOON_S)
    assert movers[0].returncode == 3
    assert "stopped by STOP (`rig stop`, process" in error
    assert person.attendance.latch.note().startswith("`rig stop`")


class Closing:
    """A process that has closed its devices and is about to let the bench go; see `rig.runtime.line.Attended`."""

    running = "closing"

    def glance(self) -> GuardStatus:
        return GuardStatus(State.IDLE, self.running, None, None, 0.0, False, ())

    def stop(self, by: str) -> StopReport:
        return StopReport(None, confirmed=False, position_kept=False, trouble="pan: not connected")

    def release(self) -> State:
        raise AssertionError("not asked for")


def test_a_stop_that_falls_into_the_end_of_a_command_is_sent_to_the_devices_once_that_has_ended(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    person.runtime.mkdir(mode=0o700)
    listening, asked = threading.Event(), threading.Event()

    class Ending(Closing):
        def stop(self, by: str) -> StopReport:
            asked.set()
            return super().stop(by)

    def end() -> None:
        with person.attendance.listen(Ending()):
            listening.set()
            asked.wait(SOON_S)

    thread = threading.Thread(target=end)
    thread.start()
    listening.wait(SOON_S)
    assert run("stop", person.bench) == 0
    thread.join()
    assert "STOP: everything is at rest" in capsys.readouterr().out


def test_a_stop_of_a_command_that_is_still_connecting_is_told_once_it_knows_all_devices(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    class Connecting(Closing):
        running = "connecting"

        def stop(self, by: str) -> StopReport:
            told = super().stop(by) if self.running else StopReport(1.0, confirmed=True, position_kept=True)
            self.running = ""
            return told

    person.runtime.mkdir(mode=0o700)
    with person.attendance.listen(Connecting()):
        assert run("stop", person.bench) == 0
    assert "STOP: everything is at rest" in capsys.readouterr().out


def test_a_stop_that_a_command_gets_ahead_of_is_asked_of_that_command(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Begun(Closing):
        def stop(self, by: str) -> StopReport:
            return StopReport(1.0, confirmed=True, position_kept=True)

    hold, holds = Attendance.hold, []
    with ExitStack() as stack:

        @contextmanager
        def ahead(attendance: Attendance) -> Iterator[None]:
            holds.append(attendance)
            if len(holds) == 1:
                stack.enter_context(person.attendance.listen(Begun()))
            with hold(attendance):
                yield

        monkeypatch.setattr(Attendance, "hold", ahead)
        monkeypatch.setattr("rig.bench.stop_directly", lambda *_: pytest.fail("its devices are another's"))
        assert run("stop", person.bench) == 0
    assert "STOP: everything is at rest" in capsys.readouterr().out


def test_no_command_opens_the_devices_while_a_stop_does(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    holders = []

    def directly(config: BenchConfig, by: str) -> StopReport:
        holders.append(person.attendance.holder())
        return StopReport(1.0, confirmed=True, position_kept=True)

    monkeypatch.setattr("rig.bench.stop_directly", directly)
    assert run("stop", person.bench) == 0
    assert [holder is not None and holder.pid == os.getpid() for holder in holders] == [True]
    assert person.attendance.latch.note()


def test_a_stop_goes_out_though_the_bench_cannot_be_held(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    person.runtime.mkdir(mode=0o700)
    (person.runtime / f"{load_bench(person.bench).key}.held").mkdir()
    assert run("stop", person.bench) == 0
    assert "STOP: everything is at rest" in capsys.readouterr().out


def test_a_process_that_does_not_answer_finds_the_stop_latched_where_it_goes_on(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rig.runtime.line.ANSWER_S", 0.1)
    with person.running("move", person.bench, "--home", "--x-mm", 500) as mover:
        person.wait_until(moving)
        mover.send_signal(signal.SIGSTOP)
        assert run("stop", person.bench) == 3
        told = capsys.readouterr().out
        assert "STOP: NOT CONFIRMED: use the wired emergency stop" in told
        assert f"process {mover.pid} (`" in told
        mover.send_signal(signal.SIGCONT)
        mover.communicate(timeout=SOON_S)
    assert person.attendance.latch.note().startswith("`rig stop`")


def with_a_wired_gantry(person: Person, port: str) -> None:
    axis = "{lower_mm: 0, upper_mm: 300, feed_mm_per_min: 5000}"
    gantry = f"driver: grbl, port: {port}, x: {axis}, y: {axis}, z: {axis}"
    simple = "driver: simple, upper_mm: [500.0, 400.0, 300.0], speed_mm_per_s: 100.0, home_s: 0.05"
    person.bench.write_text(BENCH.replace(simple, gantry))


def test_a_stop_where_nobody_holds_the_bench_stops_what_another_program_has_set_in_motion(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:  # 19
    machine = GrblMachine(settings=FIRMWARE)
    with PtyServer(WiredDevice(machine)) as server:
        with_a_wired_gantry(person, server.path)
        with server.lock:
            machine.planner.add((300.0, 0.0, 0.0), 10.0, machine.limits())
            machine.start_cycle()
        assert run("stop", person.bench) == 0
        assert not machine.planner.running
        assert machine.planner.position[0] < 100.0
    assert "STOP: everything is at rest" in capsys.readouterr().out
    assert person.attendance.latch.note().startswith("`rig stop`")


def test_a_stop_of_a_wired_bench_that_is_not_there_is_not_confirmed(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    with_a_wired_gantry(person, f"{person.folder}/no-such-port")
    assert run("stop", person.bench) == 3
    text = capsys.readouterr().out
    assert "STOP: NOT CONFIRMED" in text
    assert "gantry: STOP could not be sent" in text
    assert "switch the power off" in text


def test_a_stop_where_nobody_holds_the_bench_reaches_the_gantry_however_long_a_servo_takes_to_connect(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry_told, in_time = threading.Event(), []
    connect, stop = SimpleAxis.connect, SimpleGantry.stop

    def slowly(axis: SimpleAxis) -> Identity:
        in_time.append(gantry_told.wait(3.0))
        return connect(axis)

    def told(gantry: SimpleGantry) -> StopReport:
        gantry_told.set()
        return stop(gantry)

    monkeypatch.setattr(SimpleAxis, "connect", slowly)
    monkeypatch.setattr(SimpleGantry, "stop", told)
    assert run("stop", person.bench) == 0
    assert in_time == [True]


def test_a_stop_where_nobody_holds_the_bench_tells_why_a_servo_was_not_reached(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(axis: SimpleAxis) -> Identity:
        raise HardwareError("the bus is cut")

    unconnected = StopReport(None, confirmed=False, position_kept=True, trouble="STOP could not be sent")
    monkeypatch.setattr(SimpleAxis, "connect", fail)
    monkeypatch.setattr(SimpleAxis, "stop", lambda axis: unconnected)
    assert run("stop", person.bench) == 3
    text = capsys.readouterr().out
    assert "pan: STOP could not be sent; the bus is cut" in text
    assert "gantry" not in text


def test_a_stop_where_nobody_holds_the_bench_leaves_no_device_open(
    person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    connected = []
    close = SimpleAxis.close
    monkeypatch.setattr(SimpleAxis, "close", lambda axis: (connected.append(axis.connected), close(axis))[1])
    assert run("stop", person.bench) == 0
    assert connected[0]
    assert not any(connected[1:])


# Two processes.


def test_stop_reaches_every_bench_though_one_process_is_mute(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rig.runtime.line.ANSWER_S", 0.3)
    with person.running("move", person.bench, "--home", "--x-mm", 500) as holder:
        person.wait_until(moving)
        with ExitStack() as mute:
            # One before and one behind the other in whatever order they are asked.
            for name in ("0", "z"):
                line = mute.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
                line.bind(str(person.runtime / f"{name}.sock"))
                line.listen()
            assert run("stop") == 3
        text = capsys.readouterr().out
        assert text.count("STOP: NOT CONFIRMED") == 2
        assert text.count("does not answer") == 2
        assert f"{person.bench}: STOP: everything is at rest" in text
        holder.communicate(timeout=SOON_S)
    assert holder.returncode == 3


def test_a_mute_process_with_a_full_queue_is_no_absent_one(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rig.runtime.line.ANSWER_S", 0.05)
    monkeypatch.setattr("rig.runtime.line._AGAIN_S", 0.005)
    person.runtime.mkdir(mode=0o700, exist_ok=True)
    with ExitStack() as sockets:
        mute, *waiting = (sockets.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)) for _ in range(4))
        mute.bind(str(person.runtime / "mute.sock"))
        mute.listen(0)
        for line in waiting:
            line.setblocking(False)
            with suppress(BlockingIOError):
                line.connect(str(person.runtime / "mute.sock"))
        assert run("stop", "--json") == 3
    told = json.loads(capsys.readouterr().out)
    assert (told["sent"], told["confirmed"]) == (False, False)
    assert "does not answer" in told["trouble"]


@pytest.mark.parametrize("named", [True, False], ids=["by its bench file", "whatever is held"])
def test_stop_reaches_the_process_that_holds_the_bench_in_mid_move(
    person: Person, named: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    with person.running("move", person.bench, "--home", "--x-mm", 500) as holder:
        told = person.wait_until(moving)
        assert told["pid"] == holder.pid
        assert run("stop", *([person.bench] if named else [])) == 0
        assert "STOP: everything is at rest" in capsys.readouterr().out
        _, error = holder.communicate(timeout=SOON_S)
    assert holder.returncode == 3
    assert f"stopped by STOP (`rig stop`, process {os.getpid()})" in error
    assert run("move", person.bench, "--home", "--x-mm", 1) == 3
    assert "STOP is latched" in capsys.readouterr().err
