"""``rig home``, ``move``, ``status``, ``stop`` and ``capture``, as people, scripts and second processes meet them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.bench.plugins import ROOT, install
from calibration_free_tests.guard.real_time import FIRMWARE
from calibration_free_tests.guard.sample import bench as fresh_bench
from rig.bench import load_bench
from rig.cli.app import app
from rig.devices import Identity, StopReport
from rig.errors import HardwareError
from rig.imagegrid import read_grid
from rig.runtime import Attendance
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.pty_server import PtyServer
from sim_backends.simple_devices import SimpleAxis, SimpleGantry
from sim_backends.wired_device import WiredDevice

SOON_S = 20.0
BENCH = """\
schema: 1
kind: live
devices:
  gantry: {driver: simple, upper_mm: [500.0, 400.0, 300.0], speed_mm_per_s: 100.0, home_s: 0.05}
  pan: {driver: simple, speed_per_s: 90.0}
  camera: {driver: simple}
axes:
  x_mm: {lower: 0, upper: 500, speed_mm_per_s: 100}
  y_mm: {lower: 0, upper: 400, speed_mm_per_s: 100}
  z_mm: {lower: 0, upper: 300, speed_mm_per_s: 100}
  theta_deg: {lower: -90, upper: 90, speed_deg_per_s: 90}
"""


class Person:
    """Sits at a computer with drivers, a runtime folder and a bench file."""

    def __init__(self, folder: Path, plugins: Path) -> None:
        self.folder = folder
        self.bench = folder / "bench.yaml"
        self.bench.write_text(BENCH)
        self.environment: Mapping[str, str] = os.environ | {
            "PYTHONPATH": f"{ROOT}{os.pathsep}{plugins}",
            "RIG_RUNTIME_DIR": str(self.runtime),
        }

    @property
    def runtime(self) -> Path:
        return self.folder / "rig"

    @property
    def attendance(self) -> Attendance:
        return Attendance(self.runtime, load_bench(self.bench).key, "bench")

    @contextmanager
    def running(self, *arguments: object) -> Iterator[subprocess.Popen[str]]:
        """`rig` in a process of its own."""
        command = [sys.executable, "-m", "rig.cli.app", *map(str, arguments)]
        streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen(command, cwd=self.folder, env=self.environment, **streams) as process:
            try:
                yield process
            finally:
                process.kill()

    def wait_until(self, true_of: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Until the process that holds the bench says so."""
        deadline_s = time.monotonic() + SOON_S
        while time.monotonic() < deadline_s:
            told = self.attendance.ask("status")
            if told is not None and true_of(told):
                return told
            time.sleep(0.02)
        raise AssertionError("it never was so")


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    plugins = install(tmp_path / "drivers")
    monkeypatch.syspath_prepend(str(plugins))
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "rig"))
    return Person(tmp_path, plugins)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        app([*map(str, arguments)], prog_name="rig")
    return int(end.value.code or 0)


def moving(told: dict[str, Any]) -> bool:
    return bool(told["state"] == "moving" and "a move" in told["running"])


# One person, one process.


def test_homing_tells_where_it_stands_and_what_each_device_is(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("home", person.bench) == 0
    text = capsys.readouterr().out
    assert "state   idle" in text
    assert "x 0.000  y 0.000  z 0.000 mm  theta 0.000°" in text
    assert "gantry  idle, homed" in text
    assert "pan     idle, referenced, torque on, 30 °C, 12.0 V" in text
    assert run("home", person.bench, "--theta-deg", 30, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["pose"]["theta_deg"]) == ("idle", 30.0)
    assert told["identities"]["gantry"] == "simulated gantry 1 at nowhere"


def test_a_bench_that_was_just_switched_on_is_homed_and_referenced_by_one_command(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fresh_bench()
    made.gantry.raise_alarm(11)  # as a controller is that wants to be homed
    made.pan.lose_power()
    monkeypatch.setattr("rig.bench.open_live", lambda config: made.guard)
    assert run("home", person.bench, "--theta-deg", 30, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["pose"]["theta_deg"]) == ("idle", 30.0)


def test_a_servo_with_a_hardware_error_is_rebooted_homed_and_referenced_by_one_command(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fresh_bench()
    made.pan.overheat()
    monkeypatch.setattr("rig.bench.open_live", lambda config: made.guard)
    assert run("home", person.bench) == 3
    assert "overheated" in capsys.readouterr().err
    made.clock.sleep_s(60.0)
    assert run("home", person.bench, "--reboot", "pan", "--theta-deg", 30, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["pose"]["theta_deg"]) == ("idle", 30.0)


def test_what_needs_no_reboot_gets_none(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fresh_bench()
    made.gantry.raise_alarm(11)
    monkeypatch.setattr("rig.bench.open_live", lambda config: made.guard)
    assert run("home", person.bench, "--reboot", "pan") == 1
    assert "pan reports no hardware error" in capsys.readouterr().err
    assert made.pan.referenced
    assert run("home", person.bench, "--reboot", "gantry") == 2
    assert made.motions == []


def test_a_move_goes_there_and_by_a_step_and_leaves_other_axes(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("move", person.bench, "--home", "--x-mm", 5, "--theta-deg", -9, "--json") == 0
    pose = json.loads(capsys.readouterr().out)["pose"]
    assert pose == {"x_mm": 5.0, "y_mm": 0.0, "z_mm": 0.0, "theta_deg": -9.0, "zoom": 0.0}
    assert run("move", person.bench, "--home", "--by", "--y-mm", 2, "--json") == 0
    assert json.loads(capsys.readouterr().out)["pose"]["y_mm"] == 2.0


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--x-mm", "5"], 1, "where the rig stands is not known. Connect and home it first"),
        (["--by", "--x-mm", "5"], 2, "dx_mm = 5 is more than 0, the longest jog before homing"),
        (["--home", "--x-mm", "501"], 2, "x_mm = 501 is outside 0 .. 500"),
        (["--home", "--x-mm", "nan"], 2, "x_mm = nan is outside 0 .. 500"),
        (["--home", "--by", "--y-mm", "-1"], 2, "y_mm = -1 is outside 0 .. 400"),
        (["--home", "--zoom", "0.5"], 2, "zoom = 0.5 is outside 0 .. 0"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_message_and_an_exit_code(
    person: Person, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, told: str
) -> None:
    assert run("move", person.bench, *arguments) == code
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("rig: ")
    assert told in error


def test_a_mock_bench_moves_nothing_by_hand(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    person.bench.write_text("schema: 1\nkind: mock\n")
    for command in ("home", "move", "status", "stop"):
        assert run(command, person.bench) == 2
        assert "this is a mock bench: nothing moves there" in capsys.readouterr().err


def test_the_status_of_a_bench_that_nobody_holds_is_asked_of_its_devices(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("status", person.bench) == 0
    text = capsys.readouterr().out
    assert text.startswith("state   unhomed\npose    not known\n")
    assert "! gantry: not homed" in text


def test_pictures_by_hand_are_kept_in_one_image_grid_with_their_poses(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = person.folder / "by-hand"
    assert run("capture", person.bench, "--out", folder, "--home", "--x-mm", 900) == 2
    assert "x_mm = 900 is outside 0 .. 500" in capsys.readouterr().err
    for x_mm in (3.0, 4.0):
        assert run("capture", person.bench, "--out", folder, "--home", "--x-mm", x_mm, "--json") == 0
        told = json.loads(capsys.readouterr().out)
        assert told["pose"]["x_mm"] == x_mm
        assert Path(told["file"]).exists()
    assert [frame.pose.x_mm for frame in read_grid(folder).frames] == [3.0, 4.0]


def test_a_scan_homes_first_where_it_is_told_to_and_refuses_to_begin_unhomed(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = person.folder / "plan.yaml"
    plan.write_text("schema: 1\nlattice: {x_mm: [10, 20], y_mm: [5], z_mm: [5], theta_deg: [0], zoom: [0]}\n")
    scan = ("scan", plan, "--bench", person.bench)
    assert run(*scan, "--out", person.folder / "unhomed") == 1
    assert "Home it first" in capsys.readouterr().err
    assert not (person.folder / "unhomed").exists()
    assert run(*scan, "--home", "--out", person.folder / "homed") == 0
    assert [frame.pose.x_mm for frame in read_grid(person.folder / "homed").frames] == [10.0, 20.0]


# STOP.


def test_a_stop_where_nobody_holds_the_bench_is_latched_for_those_who_come(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    # A simple device that is not connected has nothing to stop, and says that it is at rest.
    assert run("stop", person.bench, "--json") == 0
    assert json.loads(capsys.readouterr().out)["confirmed"]
    assert run("home", person.bench) == 3
    assert "STOP is latched (`rig stop`, process" in capsys.readouterr().err
    assert run("status", person.bench) == 0
    assert "state   stopped" in capsys.readouterr().out
    assert run("stop", person.bench, "--release") == 0
    assert "STOP is released" in capsys.readouterr().out
    assert run("home", person.bench) == 0


def test_a_stop_needs_something_to_stop(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("stop") == 2
    assert "no process of yours holds a bench. Name the bench file" in capsys.readouterr().err
    assert run("stop", "--release") == 2
    assert "which bench is to be released?" in capsys.readouterr().err


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


def test_a_second_process_is_refused_with_the_name_of_the_first_and_disturbs_nothing(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:  # 6
    with person.running("move", person.bench, "--home", "--x-mm", 150, "--json") as holder:
        person.wait_until(moving)
        assert run("move", person.bench, "--home", "--x-mm", 1) == 3
        assert f"process {holder.pid} holds this bench. Wait until it is done, or stop it" in capsys.readouterr().err
        assert run("status", person.bench) == 0
        text = capsys.readouterr().out
        assert f"state   moving: a move to x_mm 150, y_mm 0, z_mm 0, theta_deg 0, zoom 0 (process {holder.pid}" in text
        out, _ = holder.communicate(timeout=SOON_S)
    assert holder.returncode == 0
    assert json.loads(out)["pose"]["x_mm"] == 150.0


def test_a_killed_process_leaves_nothing_in_the_way(person: Person) -> None:
    with person.running("move", person.bench, "--home", "--x-mm", 500) as holder:
        person.wait_until(moving)
        holder.kill()
        holder.wait(SOON_S)
    assert list((person.folder / "rig").glob("*.sock"))
    assert run("move", person.bench, "--home", "--x-mm", 1) == 0


def test_a_status_that_is_watched_goes_on_until_ctrl_c(person: Person) -> None:
    with person.running("status", person.bench, "--watch", "--json") as watcher:
        assert watcher.stdout is not None
        lines = [json.loads(watcher.stdout.readline()) for _ in range(2)]
        watcher.send_signal(signal.SIGINT)
        _, error = watcher.communicate(timeout=SOON_S)
    assert [line["state"] for line in lines] == ["unhomed", "unhomed"]
    assert watcher.returncode == 0
    assert error == ""


@pytest.mark.parametrize("ask", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_once_holds_the_motion_and_ends(person: Person, ask: signal.Signals) -> None:
    with person.running("move", person.bench, "--home", "--x-mm", 500) as mover:
        person.wait_until(moving)
        asked_s = time.monotonic()
        mover.send_signal(ask)
        _, error = mover.communicate(timeout=SOON_S)
    assert mover.returncode == 130
    assert "holding motion" in error
    assert "held before it had ended" in error
    assert time.monotonic() - asked_s < 4.0  # and not when the move would have ended
    assert person.attendance.latch.note() == ""


def test_ctrl_c_twice_is_a_latched_stop(person: Person) -> None:  # 32
    text = BENCH.replace("axes:", "  zoom: {driver: deaf, lower: 0, upper: 1}\naxes:\n  zoom: {speed_per_s: 1}")
    (person.folder / "deaf.py").write_text(DEAF)
    person.environment = dict(person.environment) | {
        "PYTHONPATH": f"{person.environment['PYTHONPATH']}{os.pathsep}{person.folder}"
    }
    info = person.folder / "deaf-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: deaf\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[rig.axes]\ndeaf = deaf:DeafAxis\n")
    person.bench.write_text(text)
    sys.path.insert(0, str(person.folder))
    try:
        with person.running("move", person.bench, "--home", "--zoom", 1) as mover:
            person.wait_until(moving)
            assert mover.stderr is not None
            mover.send_signal(signal.SIGINT)
            assert "Ctrl-C again: STOP" in mover.stderr.readline()
            mover.send_signal(signal.SIGINT)
            _, error = mover.communicate(timeout=SOON_S)
        assert mover.returncode == 130
        assert person.attendance.latch.note().startswith("Ctrl-C twice")
        assert "Traceback" not in error
    finally:
        sys.path.remove(str(person.folder))


DEAF = '''
"""An axis that heeds only the second of two stops, so that a person must press twice."""
from sim_backends.simple_devices import SimpleAxis

class DeafAxis(SimpleAxis):
    asked = 0

    def move_to(self, position):
        while DeafAxis.asked < 3:
            self.clock.sleep_s(0.01)
        return super().move_to(position)

    def stop(self):
        DeafAxis.asked += 1
        return super().stop()
'''
