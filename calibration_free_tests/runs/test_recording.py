"""What a run folder holds, however the run ends."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.scripted_run import scripted_models, scripted_steps
from recognition.steps import Outcome, Step
from rig.errors import HardwareError, InputError, RigError
from rig.run import RunRecorder, RunStart, replay, watch

START = RunStart(models="three", bench="scripted")


def recorder(folder: Path | None) -> RunRecorder:
    return RunRecorder(folder, START, scripted_models(), now=lambda: datetime(2026, 1, 2, tzinfo=UTC))


def events_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def ignore(_: Step) -> None:
    pass


def test_run_folder_holds_events_views_and_result(tmp_path: Path) -> None:
    keeper = recorder(tmp_path / "run")
    answer = watch(keeper.record(scripted_steps()), ignore)
    assert answer.outcome is Outcome.RECOGNISED
    kinds = [event["kind"] for event in events_of(tmp_path / "run")]
    view = ["view", "parts", "belief"]
    assert kinds == ["start", *[*view, "move"] * 3, *view, "finish"]
    assert [path.name for path in sorted((tmp_path / "run" / "views").iterdir())] == [f"{k:03d}.jpg" for k in range(4)]
    assert json.loads((tmp_path / "run" / "result.json").read_text()) == keeper.result()


def test_every_event_explains_itself_in_one_sentence(tmp_path: Path) -> None:
    watch(recorder(tmp_path / "run").record(scripted_steps()), ignore)
    for event in events_of(tmp_path / "run"):
        assert event["why"].strip().endswith("."), event["kind"]


def test_a_view_is_explained_by_the_move_that_led_to_it(tmp_path: Path) -> None:
    watch(recorder(tmp_path / "run").record(scripted_steps()), ignore)
    events = events_of(tmp_path / "run")
    moves = [event["why"] for event in events if event["kind"] == "move"]
    assert [event["why"] for event in events if event["kind"] == "view"][1:] == moves


def test_step_is_on_disk_before_anybody_sees_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"

    def check(step: Step) -> None:
        assert events_of(folder)[-1]["view"] == step.index
        assert (folder / "views" / f"{step.index:03d}.jpg").is_file()

    watch(recorder(folder).record(scripted_steps()), check)


def test_result_has_exactly_the_published_keys() -> None:
    keeper = recorder(None)
    watch(keeper.record(scripted_steps()), ignore)
    result = keeper.result()
    assert set(result) == {
        *("outcome", "object", "candidates", "posterior", "pose", "pose_sd", "unobservable", "views"),
        *("travel_mm", "rotation_deg", "pose_sure"),
    }
    assert set(result["pose"]) == set(result["pose_sd"]) == {"theta_deg", "x_mm", "y_mm", "z_mm"}
    keys = {"rig_pose", "parts_found", "hypotheses_left", "entropy_bits", "seconds", "why"}
    assert all(set(view) == keys for view in result["views"])
    assert all(set(view["rig_pose"]) == {"x_mm", "y_mm", "z_mm", "theta_deg", "zoom"} for view in result["views"])
    assert all(set(view["seconds"]) == {"detect", "update", "plan"} for view in result["views"])


def test_without_a_folder_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    watch(recorder(None).record(scripted_steps()), ignore)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("views", [0, 1, 3])
def test_interrupted_run_leaves_a_valid_folder(tmp_path: Path, views: int) -> None:
    keeper = recorder(tmp_path / "run")
    answer = watch(keeper.record(scripted_steps(views, failure=KeyboardInterrupt())), ignore)
    assert keeper.interrupted
    assert answer.outcome is Outcome.ABORTED
    assert watch(replay(tmp_path / "run"), ignore).outcome is Outcome.ABORTED
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["outcome"] == "aborted"
    assert len(result["views"]) == views


def test_stop_request_ends_the_run_after_the_view(tmp_path: Path) -> None:
    keeper = recorder(tmp_path / "run")
    seen: list[Step] = []
    answer = watch(keeper.record(scripted_steps(), stop=lambda: len(seen) == 2), seen.append)
    assert (len(seen), answer.outcome, keeper.interrupted) == (2, Outcome.ABORTED, True)
    assert answer.candidates[0] == "tower at front 2.3"


def test_hardware_fault_is_raised_and_recorded(tmp_path: Path) -> None:
    keeper = recorder(tmp_path / "run")
    with pytest.raises(HardwareError):
        watch(keeper.record(scripted_steps(2, failure=HardwareError("the gantry is stuck"))), ignore)
    last = events_of(tmp_path / "run")[-1]
    assert (last["kind"], last["outcome"]) == ("finish", "aborted")
    assert "the gantry is stuck" in last["why"]


def test_watcher_that_fails_leaves_a_valid_folder(tmp_path: Path) -> None:
    def fail(step: Step) -> None:
        raise ValueError("the terminal is gone")

    with pytest.raises(ValueError, match="terminal"):
        watch(recorder(tmp_path / "run").record(scripted_steps()), fail)
    assert events_of(tmp_path / "run")[-1]["outcome"] == "aborted"


def test_folder_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    with pytest.raises(InputError, match="not empty"):
        recorder(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_full_disk_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keeper = recorder(tmp_path / "run")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RigError, match="No space left"):
        watch(keeper.record(scripted_steps()), ignore)
