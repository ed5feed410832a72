"""STOP: from any thread, behind no lock, latched until a person releases it, and honest about what it could not do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.guard.sample import START, Bench, at, bench, homed
from calibration_free_tests.guard.test_guard import in_a_moment
from drivers import stopping_all
from drivers.stopping_all import in_threads
from rig.clock import SystemClock
from rig.devices import Identity, StopReport
from rig.errors import HardwareError, RigError
from rig.guard import BusyError, Guard, RefusedError, State, StoppedError
from rig.runtime import Attendance, FileLatch, ask

SOON_S = 5.0
"""Real seconds after which a thread that should have come back has not."""
FAR = at(x_mm=180.0)


def in_a_thread(action: Callable[[], object]) -> threading.Thread:
    def run() -> None:
        with suppress(RigError):
            action()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def everything_but_release(guard: Guard) -> list[Callable[[], Any]]:
    asks = [lambda: guard.move_to(START), lambda: guard.jog(dx_mm=1.0), guard.home, guard.capture, guard.connect]
    return [*asks, guard.unlock, guard.resume, lambda: guard.reference("zoom", 0.5)]


# The latch.


def test_a_stop_ends_the_move_and_nothing_moves_before_it_is_released() -> None:  # 19
    made = homed()
    in_a_moment(made, lambda: made.guard.stop("a person"), 1.0)
    with pytest.raises(StoppedError, match=r"stopped by STOP .a person"):
        made.guard.move_to(FAR)
    before = len(made.motions)
    for ask_for in everything_but_release(made.guard):
        with pytest.raises(StoppedError, match=r"STOP is latched .a person.*Release it by hand"):
            ask_for()
    made.guard.hold()
    assert (made.guard.state, len(made.motions)) == (State.STOPPED, before)
    assert made.guard.release() is State.IDLE
    made.guard.move_to(START)


def test_nothing_is_released_that_is_not_stopped() -> None:
    with pytest.raises(RefusedError, match="release is not possible while idle"):
        homed().guard.release()


def test_a_second_stop_changes_neither_who_stopped_it_nor_what_is_latched() -> None:
    made = homed()
    made.guard.stop("first")
    made.guard.stop("second")
    assert made.guard.glance().troubles[0] == "STOP: first"
    made.guard.release()
    assert made.guard.state is State.IDLE


def test_a_stop_before_connecting_keeps_it_from_connecting() -> None:
    made = bench()
    made.guard.stop("early")
    assert made.guard.state is State.STOPPED
    with pytest.raises(StoppedError):
        made.guard.connect()
    assert made.guard.release() is State.DISCONNECTED


def test_a_latched_stop_outlives_its_process_and_is_told_to_the_next(tmp_path: Path) -> None:
    latch = tmp_path / "bench.stopped"
    stopped = homed(latch=FileLatch(latch))
    stopped.guard.stop("`rig stop`")
    stopped.guard.close()
    after = bench(latch=FileLatch(latch))
    after.guard.connect()
    assert after.guard.state is State.STOPPED
    with pytest.raises(StoppedError, match=r"`rig stop`, process \d+, \d{4}-"):
        after.guard.home()
    assert after.motions == []
    assert after.guard.release() is State.UNHOMED
    assert not latch.exists()
    after.guard.home()


def test_a_stop_latched_by_another_process_in_mid_session_blocks_the_next_command(tmp_path: Path) -> None:
    latch = FileLatch(tmp_path / "bench.stopped")
    made = homed(latch=latch)
    latch.set("another process")
    before = len(made.motions)
    for ask_for in (lambda: made.guard.move_to(FAR), made.guard.capture):
        with pytest.raises(StoppedError, match="another process"):
            ask_for()
    assert (made.guard.state, len(made.motions)) == (State.STOPPED, before)


def test_a_latch_that_cannot_be_read_stops_and_one_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    assert "cannot be read" in FileLatch(tmp_path / "folder").note()
    nowhere = FileLatch(tmp_path / "missing" / "bench.stopped")
    made = homed(latch=nowhere)
    assert "could not be latched for other processes" in made.guard.stop("a person").trouble
    (tmp_path / "empty").touch()
    assert FileLatch(tmp_path / "empty").note() == "by somebody"


# What it did.


def test_a_stop_that_was_not_confirmed_says_so_and_by_which_device() -> None:  # 19
    made = homed()
    made.pan.stop_is_lost = True
    report = made.guard.stop()
    assert not report.confirmed
    assert report.trouble.startswith("pan: STOP could not be sent: no link; it is not certain")
    assert made.guard.glance().stop == report
    assert made.gantry.stops == made.zoom.stops == 1


def test_what_stopping_lost_must_be_homed_again() -> None:
    made = homed()
    in_a_moment(made, made.guard.stop, 1.0)
    with pytest.raises(StoppedError):
        made.guard.home()
    stop = made.guard.glance().stop
    assert stop is not None
    assert not stop.position_kept
    assert made.guard.release() is State.UNHOMED


def test_a_gantry_that_has_lost_its_place_in_a_stop_is_not_believed_to_be_homed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = homed()
    lost = StopReport(made.clock.now_s(), confirmed=True, position_kept=False)
    monkeypatch.setattr(made.gantry, "stop", lambda: lost)
    made.guard.stop()
    assert made.gantry.homed
    assert made.guard.release() is State.UNHOMED


# From another thread.


class Blocking:
    """A gantry's move that goes on for ever unless it is stopped while it goes on."""

    def __init__(self, made: Bench, monkeypatch: pytest.MonkeyPatch, hears_from: int = 1) -> None:
        self.began, self.ended, self.stops, self.hears_from = threading.Event(), threading.Event(), 0, hears_from
        monkeypatch.setattr(made.gantry, "move_to", self.move_to)
        monkeypatch.setattr(made.gantry, "stop", self.stop)

    def move_to(self, *place: float) -> None:
        self.began.set()
        assert self.ended.wait(SOON_S)
        raise HardwareError("stopped in mid-move")

    def stop(self) -> StopReport:
        self.stops += 1
        if self.stops >= self.hears_from:
            self.ended.set()
        return StopReport(float(self.stops), confirmed=True, position_kept=True)


def test_a_stop_from_another_thread_waits_for_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    made = homed()
    move = Blocking(made, monkeypatch)
    thread = in_a_thread(lambda: made.guard.move_to(FAR))
    assert move.began.wait(SOON_S)
    with pytest.raises(BusyError):
        made.guard.capture()
    assert made.guard.stop().confirmed
    thread.join(SOON_S)
    assert not thread.is_alive()
    assert (move.stops, made.guard.state) == (1, State.STOPPED)


@pytest.mark.parametrize("halt", [Guard.stop, Guard.hold])
def test_a_stop_that_came_just_before_the_first_byte_is_sent_again(
    monkeypatch: pytest.MonkeyPatch, halt: Callable[[Guard], StopReport]
) -> None:
    made = homed()
    move = Blocking(made, monkeypatch, hears_from=3)
    thread = in_a_thread(lambda: made.guard.move_to(FAR))
    assert move.began.wait(SOON_S)
    report = halt(made.guard)
    thread.join(SOON_S)
    assert not thread.is_alive()
    assert move.stops >= 3
    assert report.confirmed
    if halt is Guard.stop:
        assert report.sent_at_s == 1.0
    assert made.guard.state in (State.STOPPED, State.HELD)


def test_a_command_that_cannot_be_ended_is_told_and_not_released(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.guard.breaking._TIMES", 3)
    monkeypatch.setattr("rig.guard.breaking._AGAIN_S", 0.001)
    made = homed()
    move = Blocking(made, monkeypatch, hears_from=100)
    thread = in_a_thread(lambda: made.guard.move_to(FAR))
    assert move.began.wait(SOON_S)
    report = made.guard.stop()
    assert not report.confirmed
    assert "not certain that everything is at rest" in report.trouble
    with pytest.raises(BusyError):
        made.guard.release()
    move.ended.set()
    thread.join(SOON_S)
    assert made.guard.release() is State.IDLE


@pytest.mark.parametrize("what", ["status", "capture"])
def test_a_stop_waits_for_no_status_and_no_camera_that_hangs(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made, asked, answer = homed(), threading.Event(), threading.Event()
    device = made.gantry if what == "status" else made.camera
    rightly = getattr(device, what)

    def slowly(*given: float) -> object:
        asked.set()
        assert answer.wait(SOON_S)
        return rightly(*given)

    monkeypatch.setattr(device, what, slowly)
    thread = in_a_thread(getattr(made.guard, what))
    assert asked.wait(SOON_S)
    assert made.guard.stop().confirmed
    assert thread.is_alive()
    assert made.guard.state is State.STOPPED
    answer.set()
    thread.join(SOON_S)
    assert made.guard.state is State.STOPPED


def test_a_servo_that_is_slow_to_stop_does_not_delay_the_gantry(monkeypatch: pytest.MonkeyPatch) -> None:
    made, gantry_stopped = homed(stops=in_threads), threading.Event()
    stop_gantry, stop_pan = made.gantry.stop, made.pan.stop

    def gantry() -> StopReport:
        gantry_stopped.set()
        return stop_gantry()

    def pan() -> StopReport:
        assert gantry_stopped.wait(SOON_S)
        return stop_pan()

    monkeypatch.setattr(made.gantry, "stop", gantry)
    monkeypatch.setattr(made.pan, "stop", pan)
    monkeypatch.setattr(made.zoom, "stop", pan)
    assert made.guard.stop().confirmed


def test_a_device_whose_stop_never_returns_is_told_and_the_others_are_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stopping_all, "STOP_S", 0.05)
    made, never = homed(stops=in_threads), threading.Event()
    monkeypatch.setattr(made.zoom, "stop", lambda: never.wait(SOON_S))
    report = made.guard.stop()
    never.set()
    assert "zoom: its STOP did not return within 0.05 s" in report.trouble
    assert not report.confirmed
    assert made.gantry.stops == made.pan.stops == 1


def test_where_no_thread_can_be_had_devices_are_stopped_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    made = homed(stops=in_threads)

    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    assert made.guard.stop().confirmed
    assert made.gantry.stops == made.pan.stops == made.zoom.stops == 1


# From another process.


def attended(tmp_path: Path) -> tuple[Attendance, Bench]:
    attendance = Attendance(tmp_path, "key", "bench.yaml")
    made = bench(latch=attendance.latch, company=(attendance.listen,), clock=SystemClock(), stops=in_threads)
    return attendance, made


def test_another_process_stops_asks_and_releases_through_the_line(tmp_path: Path) -> None:
    attendance, made = attended(tmp_path)
    assert attendance.ask("status") is None
    code = (
        "import json, sys\nfrom pathlib import Path\nfrom rig.runtime import Attendance\n"
        "print(json.dumps(Attendance(Path(sys.argv[1]), 'key', 'x').ask(sys.argv[2], by='the other process')))"
    )

    def from_elsewhere(what: str) -> dict[str, Any]:
        command = [sys.executable, "-c", code, str(tmp_path), what]
        return dict(json.loads(subprocess.run(command, capture_output=True, check=True, timeout=30).stdout))

    with made.guard:
        assert from_elsewhere("status")["state"] == "unhomed"
        assert from_elsewhere("stop")["confirmed"]
        assert made.guard.glance().troubles[0] == "STOP: the other process"
        assert attendance.latch.note().startswith("the other process")
        assert from_elsewhere("release")["state"] == "unhomed"
        assert attendance.latch.note() == ""
        with pytest.raises(RigError, match="release is not possible while unhomed"):
            attendance.ask("release")
        with pytest.raises(RigError, match="'dance' is not understood"):
            attendance.ask("dance")
    assert attendance.ask("stop") is None


def test_a_stop_from_another_process_reaches_one_that_is_still_connecting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attendance, made = attended(tmp_path)
    connect, told = made.camera.connect, []

    def stopped_meanwhile() -> Identity:
        told.append((attendance.ask("status") or {}).get("running"))
        told.append((attendance.ask("stop", by="a person") or {}).get("confirmed"))
        told.append(made.gantry.stops)
        return connect()

    monkeypatch.setattr(made.camera, "connect", stopped_meanwhile)
    with made.guard:
        assert told == ["connecting", True, 1]
        # What was not connected yet when the STOP came is stopped once it is.
        assert made.pan.stops == made.gantry.stops == 2
        assert made.guard.state is State.STOPPED
        with pytest.raises(StoppedError, match="a person"):
            made.guard.home()
        assert made.motions == []
        assert made.guard.release() is State.UNHOMED


def test_connecting_that_fails_for_a_stop_says_so_and_leaves_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attendance, made = attended(tmp_path)

    def fail() -> Identity:
        attendance.ask("stop", by="a person")
        raise HardwareError("reset while it was asked who it is")

    monkeypatch.setattr(made.camera, "connect", fail)
    with pytest.raises(StoppedError, match=r"stopped by STOP .a person"):
        made.guard.connect()
    assert attendance.ask("status") is None
    assert not any(device.connected for device in made.devices)
    assert attendance.latch.note().startswith("a person")


def test_connecting_to_a_stopped_bench_sends_no_further_stop(tmp_path: Path) -> None:
    attendance, made = attended(tmp_path)
    attendance.latch.set("another process")
    with made.guard:
        assert made.guard.state is State.STOPPED
        assert made.gantry.stops == made.pan.stops == 0


def test_nonsense_on_the_line_does_not_keep_a_stop_away(tmp_path: Path) -> None:
    import socket

    attendance, made = attended(tmp_path)
    with made.guard:
        for nonsense in (b"", b"\xff\xfe\n", b"[1]\n", b"x" * 10_000):
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
                line.connect(str(tmp_path / "key.sock"))
                with suppress(OSError):
                    line.sendall(nonsense)
        waiting = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        with waiting:
            waiting.connect(str(tmp_path / "key.sock"))  # and says nothing
            assert (attendance.ask("stop", by="a person") or {})["confirmed"]


def test_a_holder_that_does_not_answer_is_told_with_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import socket

    monkeypatch.setattr("rig.runtime.line.ANSWER_S", 0.05)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as deaf:
        deaf.bind(str(tmp_path / "key.sock"))
        deaf.listen()
        with pytest.raises(HardwareError, match=r"does not answer .*wired emergency stop"):
            ask(tmp_path / "key.sock", "stop")


def test_who_asked_for_a_stop_is_answered_before_the_stopped_process_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attendance, made = attended(tmp_path)
    stopping, stopped = threading.Event(), threading.Event()
    stop = made.guard.stop

    def slow_stop(by: str = "") -> StopReport:
        stopping.set()
        threading.Event().wait(0.2)
        report = stop(by)
        stopped.set()
        return report

    monkeypatch.setattr(made.guard, "stop", slow_stop)
    answers: list[dict[str, Any] | None] = []
    with made.guard:
        asker = in_a_thread(lambda: answers.append(attendance.ask("stop", by="a person")))
        assert stopping.wait(SOON_S)
    assert stopped.is_set()
    asker.join(SOON_S)
    assert [(answer or {})["confirmed"] for answer in answers] == [True]


def test_a_holder_that_hangs_up_and_goes_is_no_holder(tmp_path: Path) -> None:
    import socket

    path = tmp_path / "key.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as ending:
        ending.bind(str(path))
        ending.listen()

        def end() -> None:
            ending.accept()[0].close()
            path.unlink()

        thread = in_a_thread(end)
        assert ask(path, "stop") is None
        thread.join(SOON_S)


def test_the_socket_of_a_killed_process_is_taken_away_and_that_of_a_living_one_is_not(tmp_path: Path) -> None:
    import socket

    stale = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(tmp_path / "key.sock"))
    stale.close()
    _, first = attended(tmp_path)
    _, second = attended(tmp_path)
    with first.guard:
        with pytest.raises(HardwareError, match=rf"process {os.getpid()} .*holds this bench"):
            second.guard.__enter__()
        assert not any(device.connected for device in second.devices)
        assert first.guard.state is State.UNHOMED
