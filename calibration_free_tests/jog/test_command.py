"""`rig jog` says what it needs before anything is opened, and ends in order whatever becomes of its terminal."""

from __future__ import annotations

import importlib.util
import os
import pty
import signal
import subprocess
import sys
import threading
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest
from textual.pilot import Pilot

from calibration_free_tests.jog.bench import eventually, session
from rig.bench.config import BenchConfig
from rig.bench.mock import BenchFile
from rig.cli import main
from rig.guard import State
from rig.imagegrid import read_grid
from rig.jog.leaving import INTERRUPTED, leaves_in_order

ROOT = Path(__file__).parents[2]


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
    before = signal.getsignal(number)
    with leaves_in_order(lambda: forced.append("forced"), end=lambda code: forced.append("ended")) as leave:
        os.kill(os.getpid(), number)
        assert leave.wait(5.0)
    assert forced == []
    assert signal.getsignal(number) is before


def test_a_second_signal_in_the_midst_of_the_first_gets_nothing_stuck() -> None:
    program = (
        "import signal\nfrom calibration_free_tests.signals import at_every_line\n"
        "from rig.jog.leaving import leaves_in_order\n"
        "print(at_every_line(lambda: leaves_in_order(lambda: None), signal.SIGTERM))"
    )
    command = [sys.executable, "-c", program]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    child = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=30.0)
    assert child.returncode == 0, child.stderr
    assert int(child.stdout) > 0


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


@pytest.mark.filterwarnings("ignore:Image.Image.getdata is deprecated:DeprecationWarning")
def test_it_joins_bench_screen_grid_marks_and_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """All but the terminal and the bench file is real."""
    from rig.jog.app import JogApp

    seen: list[str] = []
    whole = JogApp.run

    async def at_the_keys(pilot: Pilot[None]) -> None:
        await pilot.press("c", "right", "m", "enter")
        assert eventually(lambda: "mark 1" in str(pilot.app._jogger.messages))  # type: ignore[attr-defined]
        seen.extend(message.text for message in pilot.app._jogger.messages)  # type: ignore[attr-defined]
        await pilot.press("q")

    def headless(app: JogApp) -> None:
        whole(app, headless=True, size=(80, 24), auto_pilot=at_the_keys)

    with session(tmp_path) as s:
        s.jogger.close()
        monkeypatch.setattr("rig.cli.jogging._refuse_without_terminal", lambda: None)
        monkeypatch.setattr("rig.bench.load_bench", lambda path: BenchConfig(str(path), BenchFile.model_construct()))
        monkeypatch.setattr("rig.bench.open_live", lambda config: s.made.guard)
        monkeypatch.setattr(JogApp, "run", headless)
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
        with pytest.raises(SystemExit) as end:
            main(["jog", "bench.yaml", "--out", str(tmp_path / "kept"), "--preview"])
        assert end.value.code == 0
        assert s.state is State.DISCONNECTED
    assert any(text.startswith("preview: http://127.0.0.1:") for text in seen)
    assert len(read_grid(tmp_path / "kept").frames) == 1
    assert len(list((tmp_path / "state" / "rig" / "marks").iterdir())) == 1
