"""Ctrl-C and SIGTERM reach the rig however close they follow each other, and whatever goes wrong with the first."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from rig.cli.interrupt import ends_gently

SOON_S = 5.0
ROOT = Path(__file__).parents[2]

CLOSE_TOGETHER = """
import signal
from calibration_free_tests.signals import at_every_line
from rig.cli.interrupt import ends_gently

class Moving:
    stops = 0
    def hold(self): pass
    def stop(self, by): Moving.stops += 1

lines = at_every_line(lambda: ends_gently(Moving()), signal.SIGTERM)
print(lines, Moving.stops)
"""


class Moving:
    """Something that moves, of which the first attempts to end that fail."""

    def __init__(self, failures: int = 0) -> None:
        self.failures, self.stops, self.held, self.stopped = failures, 0, threading.Event(), threading.Event()

    def hold(self) -> None:
        self.held.set()

    def stop(self, by: str) -> None:
        self.stops += 1
        if self.stops <= self.failures:
            raise OSError("anything")
        self.stopped.set()


def test_a_second_signal_in_the_midst_of_the_first_is_a_stop() -> None:
    command = [sys.executable, "-c", CLOSE_TOGETHER]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    child = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=30.0)
    assert child.returncode == 0, child.stderr
    lines, stops = map(int, child.stdout.split())
    assert lines > 2
    assert stops == lines


def test_a_stop_that_fails_is_told_and_the_next_ctrl_c_stops_all_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    rig = Moving(failures=1)
    with ends_gently(rig) as asked:
        os.kill(os.getpid(), signal.SIGINT)
        assert rig.held.wait(SOON_S)
        assert asked()
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
        assert rig.stopped.wait(SOON_S)
    assert rig.stops == 2
    assert "STOP failed: OSError: anything. Use the wired emergency stop" in capsys.readouterr().err


def test_a_hold_that_fails_is_told_too(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    rig, failed = Moving(), threading.Event()

    def fail() -> None:
        failed.set()
        raise OSError("anything")

    monkeypatch.setattr(rig, "hold", fail)
    with ends_gently(rig):
        os.kill(os.getpid(), signal.SIGINT)
        assert failed.wait(SOON_S)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert rig.stopped.is_set()
    assert "hold failed: OSError: anything" in capsys.readouterr().err


def test_who_is_just_writing_when_a_signal_comes_loses_no_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Moving()

    class Busy:
        """The stream that the main thread is in the midst of writing to."""

        def write(self, text: str) -> int:
            raise RuntimeError("reentrant call inside <_io.BufferedWriter name='<stderr>'>")

        def flush(self) -> None:
            pass

    with ends_gently(rig) as asked:
        monkeypatch.setattr(sys, "stderr", Busy())
        os.kill(os.getpid(), signal.SIGINT)
        monkeypatch.undo()
        assert asked()
        assert rig.held.wait(SOON_S)
