"""Commands of several processes on one bench: one moves, the others are told which, and looking hinders nobody."""

from __future__ import annotations

import json
import os
import signal
import socket
from contextlib import ExitStack
from itertools import takewhile

import pytest

from calibration_free_tests.cli.person import SOON_S, Person, moving, run
from rig.devices import StopReport
from rig.guard import GuardStatus, State


def test_a_second_process_is_refused_with_the_name_of_the_first_and_disturbs_nothing(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:  # 6
    with person.running("move", person.bench, "--home", "--x-mm", 150, "--json") as holder:
        person.wait_until(moving)
        assert run("move", person.bench, "--home", "--x-mm", 1) == 3
        error = capsys.readouterr().err
        assert f"process {holder.pid} (`" in error
        assert "--home --x-mm 150 --json`) holds this bench. Wait until it is done, or stop it (`rig stop " in error
        assert run("status", person.bench) == 0
        text = capsys.readouterr().out
        assert f"state   moving: a move to x_mm 150, y_mm 0, z_mm 0, theta_deg 0, zoom 0 (process {holder.pid}" in text
        assert "--home --x-mm 150 --json`, holds the bench)" in text
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


def test_a_status_that_is_watched_hinders_no_command_and_goes_on_with_what_that_says(person: Person) -> None:
    with person.running("status", person.bench, "--watch", "--json") as watcher:
        assert watcher.stdout is not None
        assert json.loads(watcher.stdout.readline())["state"] == "unhomed"
        with person.running("move", person.bench, "--home", "--x-mm", 150, "--json") as mover:
            out, error = mover.communicate(timeout=SOON_S)
        assert mover.returncode == 0, error
        assert json.loads(out)["pose"]["x_mm"] == 150.0
        lines = map(json.loads, watcher.stdout)
        first = next(told for told in lines if "pid" in told)
        seen = [first, *takewhile(lambda told: "pid" in told, lines)]
        watcher.send_signal(signal.SIGINT)
        _, error = watcher.communicate(timeout=SOON_S)
    assert {told["pid"] for told in seen} == {mover.pid}  # and then the devices were asked again
    assert any(moving(told) for told in seen)
    assert (watcher.returncode, error) == (0, "")


def test_of_two_commands_started_together_one_moves_and_the_other_is_told_which(person: Person) -> None:
    move = ("move", person.bench, "--home", "--x-mm", 100)
    with person.running(*move) as one, person.running(*move) as other:
        told = {process.pid: process.communicate(timeout=SOON_S)[1] for process in (one, other)}
    assert sorted((one.returncode, other.returncode)) == [0, 3]
    winner, loser = (one, other) if one.returncode == 0 else (other, one)
    assert f"process {winner.pid} (" in told[loser.pid]
    assert told[loser.pid].count("\n") == 1


class Beginning:
    """What another process knows of the bench while it is connecting, and then; see `rig.runtime.line.Attended`."""

    def __init__(self, looks: int) -> None:
        self.looks = looks

    def glance(self) -> GuardStatus:
        self.looks -= 1
        state = State.DISCONNECTED if self.looks >= 0 else State.IDLE
        return GuardStatus(state, "connecting" if self.looks >= 0 else "", None, None, 0.0, False, ())

    def stop(self, by: str) -> StopReport:
        raise AssertionError("not asked for")

    def release(self) -> State:
        raise AssertionError("not asked for")


def test_the_status_of_a_bench_that_another_process_is_connecting_to_waits_until_it_knows_more(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    person.runtime.mkdir(mode=0o700)
    with person.attendance.listen(Beginning(looks=3)):
        assert run("status", person.bench, "--json") == 0
    assert json.loads(capsys.readouterr().out)["state"] == "idle"


def test_the_status_of_a_bench_that_another_process_goes_on_connecting_to_says_so(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rig.cli.looking.BEGIN_S", 0.1)
    person.runtime.mkdir(mode=0o700)
    with person.attendance.listen(Beginning(looks=1000)):
        assert run("status", person.bench) == 0
    assert f"state   disconnected: connecting (process {os.getpid()}, `" in capsys.readouterr().out


def test_the_status_of_a_bench_that_a_process_has_but_does_not_speak_of_names_that_process(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rig.cli.looking.BEGIN_S", 0.1)
    monkeypatch.setattr("rig.runtime.line.ANSWER_S", 0.1)
    person.runtime.mkdir(mode=0o700)
    with person.attendance.listen(Beginning(looks=0)), ExitStack() as stack:
        for socket_file in person.runtime.glob("*.sock"):
            socket_file.unlink()
        assert run("status", person.bench) == 3
        assert f"process {os.getpid()} (`" in capsys.readouterr().err
        mute = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        mute.bind(str(socket_file))
        mute.listen()
        assert run("status", person.bench) == 3
    error = capsys.readouterr().err
    assert f"process {os.getpid()} (`" in error
    assert "holds the bench and does not answer (timed out). Use the wired emergency stop" in error
