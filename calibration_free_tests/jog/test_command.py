"""`rig jog` says what it needs before anything is opened, and ends in order whatever becomes of its terminal."""

from __future__ import annotations

import importlib.util
import os
import pty
import signal
import sys
import threading
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from calibration_free_tests.jog.bench import eventually, session
from rig.cli import main
from rig.guard import State
from rig.jog.leaving import INTERRUPTED, leaves_in_order


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as end:
        main(["jog", *arguments])
    assert end.value.code == 2
    return capsys.readouterr().err


def test_without_a_terminal_it_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "needs a terminal" in refused(capsys, "bench.yaml")


def test_without_textual_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = importlib.util.find_spec

    def without(name: str, package: str | None = None) -> ModuleSpec | None:
        return None if name in ("textual", "textual_image") else found(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", without)
    told = refused(capsys, "bench.yaml")
    assert "needs textual and textual-image" in told
    assert "pip install 'calibration-free-rig[jog]'" in told


def test_a_terminal_without_a_size_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ours, theirs = pty.openpty()
    with os.fdopen(ours), os.fdopen(theirs) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        with monkeypatch.context() as patched:
            patched.setattr(sys.stdout, "isatty", lambda: True, raising=False)
            patched.setattr(sys.stdout, "fileno", terminal.fileno, raising=False)
            told = refused(capsys, "bench.yaml")
    assert "does not tell its size" in told


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_screen_that_leaves_when_asked_is_not_forced(number: int) -> None:
    forced: list[str] = []
    with leaves_in_order(lambda: forced.append("forced"), end=lambda code: forced.append("ended")) as leave:
        os.kill(os.getpid(), number)
        assert leave.wait(5.0)
    assert forced == []
    assert signal.getsignal(number) is signal.SIG_DFL


def test_where_the_screen_hangs_the_bench_is_held_and_closed_all_the_same(tmp_path: Path) -> None:
    ended: list[int] = []
    with session(tmp_path) as s:
        s.gate.open = False
        s.jogger.go_to("x=100")
        s.under_way()
        hangs = threading.Event()

        def end(code: int) -> None:
            ended.append(code)
            hangs.set()

        def force() -> None:
            s.jogger.close()
            s.made.guard.close()

        with leaves_in_order(force, grace_s=0.01, end=end):
            os.kill(os.getpid(), signal.SIGHUP)
            assert hangs.wait(5.0)
        assert ended == [INTERRUPTED]
        assert s.state is State.DISCONNECTED
        assert eventually(lambda: not any(device.connected for device in s.made.devices))
