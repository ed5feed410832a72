"""What a person, a script and Ctrl-C get from a recognition, whichever loop makes the steps."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.scripted_run import scripted_models, scripted_steps
from rig.cli.watching import new_run_folder, watch_run
from rig.errors import HardwareError
from rig.run import RunRecorder, RunStart

ROOT = Path(__file__).resolve().parents[2]
SLOW_RUN = """
import sys, time
from pathlib import Path
from calibration_free_tests.scripted_run import scripted_models, scripted_steps
from rig.cli.watching import watch_run
from rig.run import RunRecorder, RunStart

def slow():
    steps = scripted_steps()
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            return end.value
        print("looking", file=sys.stderr, flush=True)
        time.sleep(PAUSE_S)
        yield step

keeper = RunRecorder(Path(sys.argv[1]), RunStart("three", "scripted"), scripted_models())
sys.exit(watch_run(slow(), keeper, as_json=True)[0])
"""


def keeper(folder: Path | None) -> RunRecorder:
    return RunRecorder(folder, RunStart("three", "scripted"), scripted_models())


def test_json_is_the_only_thing_on_stdout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert watch_run(scripted_steps(), keeper(tmp_path / "run"), as_json=True)[0] == 0
    streams = capsys.readouterr()
    result = json.loads(streams.out)
    assert len(streams.out.splitlines()) == 1
    assert result == json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["outcome"] == "recognised"
    assert "374" in streams.err


def test_a_reader_that_closes_the_pipe_loses_no_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Closed:
        def write(self, _: str) -> int:
            raise BrokenPipeError

        def flush(self) -> None:
            pass

    monkeypatch.setattr(sys, "stdout", Closed())
    with pytest.raises(BrokenPipeError):
        watch_run(scripted_steps(), keeper(tmp_path / "run"), as_json=True)
    assert (tmp_path / "run" / "report.html").is_file()


def test_person_gets_table_answer_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert watch_run(scripted_steps(), keeper(tmp_path / "run"), as_json=False)[0] == 0
    text = capsys.readouterr().out
    for expected in ("374", "recognised: tower", "x 1010.0 ± 1.4 mm", str(tmp_path / "run" / "report.html")):
        assert expected in text
    assert (tmp_path / "run" / "report.html").is_file()


def test_undecided_run_is_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    def undecided() -> Any:
        from dataclasses import replace

        from recognition.steps import Outcome

        answer = yield from scripted_steps()
        return replace(answer, outcome=Outcome.AMBIGUOUS, object_id=None)

    assert watch_run(undecided(), keeper(None), as_json=True)[0] == 1
    assert json.loads(capsys.readouterr().out)["outcome"] == "ambiguous"


def test_hardware_fault_still_prints_what_was_believed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steps = scripted_steps(2, failure=HardwareError("the gantry is stuck"))
    with pytest.raises(HardwareError):
        watch_run(steps, keeper(tmp_path / "run"), as_json=True)
    result = json.loads(capsys.readouterr().out)
    assert (result["outcome"], len(result["views"])) == ("aborted", 2)
    assert (tmp_path / "run" / "report.html").is_file()


@pytest.mark.parametrize("presses", [1, 2])
def test_interrupt_leaves_a_whole_run(tmp_path: Path, presses: int) -> None:
    # One press lets the view in hand finish, however long it takes; a second ends the run at once.
    code = SLOW_RUN.replace("PAUSE_S", "0.3" if presses == 1 else "60")
    command = [sys.executable, "-c", code, str(tmp_path / "run")]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().strip() == "looking"
        for _ in range(presses):
            process.send_signal(signal.SIGINT)
            # The answer to the first press comes before the second press is made.
            assert presses == 1 or "Ctrl-C" in process.stderr.readline() or _ == 1
        out, errors = process.communicate(timeout=30)
    assert process.returncode == 130, errors
    result = json.loads(out)
    assert result["outcome"] == "aborted"
    assert len(result["views"]) == (1 if presses == 1 else 0)
    assert "Traceback" not in errors
    last = json.loads((tmp_path / "run" / "events.jsonl").read_text().splitlines()[-1])
    assert (last["kind"], last["outcome"]) == ("finish", "aborted")
    assert (tmp_path / "run" / "report.html").is_file()


def test_signals_are_given_back_after_a_run() -> None:
    before = signal.getsignal(signal.SIGINT)
    watch_run(scripted_steps(), keeper(None), as_json=True)
    assert signal.getsignal(signal.SIGINT) is before


def test_run_folders_are_never_shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    now = datetime(2026, 1, 2, 10, 15)
    first = new_run_folder(None, False, "images/p00 w.jpg", now)
    assert first == Path("runs/20260102-101500_images_p00_w.jpg")
    first.mkdir(parents=True)
    assert new_run_folder(None, False, "images/p00 w.jpg", now) == Path("runs/20260102-101500_images_p00_w.jpg-2")
    assert new_run_folder(None, True, "x", now) is None
    assert new_run_folder(Path("mine"), True, "x", now) == Path("mine")
