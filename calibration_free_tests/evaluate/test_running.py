"""An evaluation comes out the same however it is done, and loses nothing when it is cut off."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from calibration_free_tests.evaluate.sample import (
    PLAN,
    after,
    evaluate,
    kept,
    never,
    plan_file,
    small_plan,
    without_times,
)
from rig.errors import InputError, RigError
from rig.evaluate import staging, workers
from rig.evaluate.plan import Plan, load_plan
from rig.evaluate.plan_file import NoiseEntry, RowEntry
from rig.evaluate.store import TRIALS, Store, failed
from rig.evaluate.work import Record, tolerance


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return small_plan(tmp_path_factory.mktemp("plan"))


@pytest.fixture(scope="module")
def alone(plan: Plan) -> list[Record]:
    """All trials, done in this process."""
    return list(workers.here(plan.tasks, never))


def test_trials_name_their_seed_and_how_they_went(plan: Plan, alone: list[Record]) -> None:
    assert [(record["row"], record["number"], record["seed"]) for record in alone] == [
        (task.row.key, task.number, task.seed) for task in plan.tasks
    ]
    assert not any(map(failed, alone))
    assert "right" in {record["kind"] for record in alone}
    for record in alone:
        assert record["views"] == len(record["seconds"]) <= 4
        assert (record["travel_s"] > 0) == (record["views"] > 1)


def test_two_processes_do_what_one_does(plan: Plan, alone: list[Record]) -> None:
    together = list(workers.in_processes(plan.tasks, 2, never))
    assert without_times(together) == without_times(alone)


def test_a_cluster_does_what_one_process_does(plan: Plan, alone: list[Record]) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        done = list(workers.on_cluster(plan.tasks, cluster.scheduler_address, never))
    assert without_times(done) == without_times(alone)


def test_a_cluster_that_is_not_there_is_told(plan: Plan) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no Dask scheduler answers at 'nowhere'"):
        list(workers.on_cluster(plan.tasks, "nowhere", never))


def test_without_dask_the_extra_is_named(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"calibration-free-rig\[cluster\]"):
        list(workers.on_cluster(plan.tasks, "tcp://127.0.0.1:1", never))


@pytest.mark.parametrize("jobs", [1, 2])
def test_asked_to_stop_it_finishes_what_is_in_hand_and_begins_nothing(plan: Plan, jobs: int) -> None:
    done = list(workers.here(plan.tasks, after(3)) if jobs == 1 else workers.in_processes(plan.tasks, jobs, after(3)))
    assert 0 < len(done) < plan.trials
    assert not any(map(failed, done))


def test_a_process_that_dies_ends_the_evaluation_with_what_was_done(plan: Plan) -> None:
    records = workers.in_processes(plan.of(trials=40).tasks, 2, never)
    first = next(records)
    for process in multiprocessing.active_children():
        process.kill()
    with pytest.raises(RigError, match="a process that did trials died"):
        list(records)
    assert not failed(first)


# --- resuming -------------------------------------------------------------------------------------------------------


def keep(folder: Path, plan: Plan, records: list[Record]) -> None:
    with Store(folder, plan) as store:
        for record in records:
            store.add(record)


def test_an_evaluation_that_was_cut_off_goes_on_to_the_same_end(
    tmp_path: Path, plan: Plan, alone: list[Record]
) -> None:
    keep(tmp_path / "run", plan, alone[:2])
    code, result, said = evaluate(plan.name, "--out", tmp_path / "run", "--jobs", 1, "--json")
    assert code == 0
    assert "2 of 6 trials are done already" in said
    assert kept(tmp_path / "run", plan) == without_times(alone)
    assert result is not None
    assert (result["done"], result["errors"]) == (6, 0)
    assert len((tmp_path / "run" / TRIALS).read_text().splitlines()) == 6


def test_a_torn_last_line_is_cut_away_and_its_trial_done_again(tmp_path: Path, plan: Plan, alone: list[Record]) -> None:
    folder = tmp_path / "run"
    keep(folder, plan, alone[:3])
    whole = (folder / TRIALS).read_bytes()
    (folder / TRIALS).write_bytes(whole[:-20])
    with Store(folder, plan) as store:
        assert store.mended is not None
        assert "torn" in store.mended
        assert list(store.records) == [task.key for task in plan.tasks[:2]]
    assert (folder / TRIALS).read_bytes() == b"".join(whole.splitlines(keepends=True)[:2])


def test_a_damaged_line_is_told_with_its_place(tmp_path: Path, plan: Plan, alone: list[Record]) -> None:
    folder = tmp_path / "run"
    keep(folder, plan, alone[:3])
    lines = (folder / TRIALS).read_text().splitlines(keepends=True)
    (folder / TRIALS).write_text(lines[0] + "{]\n" + lines[2])
    with pytest.raises(InputError, match=f"{TRIALS}:2: this line is no trial's record"):
        Store(folder, plan)


def test_another_plans_folder_is_refused(tmp_path: Path, plan: Plan) -> None:
    Store(tmp_path / "run", plan).close()
    with pytest.raises(InputError, match="of another plan"):
        Store(tmp_path / "run", plan.of(seed=5))
    Store(tmp_path / "run", plan.of(trials=2)).close()


def test_a_folder_that_holds_something_else_is_refused(tmp_path: Path, plan: Plan) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="no evaluation"):
        Store(tmp_path, plan)


def test_two_do_not_write_into_one_folder(tmp_path: Path, plan: Plan) -> None:
    with Store(tmp_path / "run", plan), pytest.raises(InputError, match="is writing there"):
        Store(tmp_path / "run", plan)


# --- failures -------------------------------------------------------------------------------------------------------


def test_a_trial_that_fails_is_told_with_its_seed_and_line_and_tried_again(
    tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = staging.first_view

    def fails(rig: object, rng: object) -> object:
        if rig._seed == 1:  # type: ignore[attr-defined]  # The rig keeps its seed to itself.
            raise ZeroDivisionError("no luck")
        return real(rig, rng)  # type: ignore[arg-type]  # What it is given, it is given on.

    monkeypatch.setattr(staging, "first_view", fails)
    words = (plan.name, "--out", tmp_path / "run", "--jobs", 1, "--trials", 4, "--json")
    code, result, said = evaluate(*words)
    assert code == 1
    assert result is not None
    assert (result["done"], result["errors"]) == (2, 2)
    with Store(tmp_path / "run", plan) as store:
        errors = [record for record in store.records.values() if failed(record)]
    assert [record["seed"] for record in errors] == [1, 1]
    assert "ZeroDivisionError: no luck" in errors[0]["error"]
    assert "in fails: raise ZeroDivisionError" in errors[0]["error"]
    assert "seed 1 of" in said
    assert "ZeroDivisionError: no luck" in (tmp_path / "run" / "report.html").read_text()
    monkeypatch.undo()
    code, result, _ = evaluate(*words)
    assert code == 0
    assert result is not None
    assert (result["done"], result["errors"]) == (4, 0)


def test_wrong_input_is_no_failure_of_a_trial(tmp_path: Path) -> None:
    code, result, said = evaluate(plan_file(tmp_path, PLAN.replace("trials", "trial")), "--out", tmp_path / "run")
    assert (code, result) == (2, None)
    assert "plan.yaml:3:1" in said


# --- killing and interrupting ---------------------------------------------------------------------------------------


@pytest.fixture
def begun(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """``rig evaluate`` on its own, with its first trial done."""
    file, folder = plan_file(tmp_path, PLAN.replace("trials: 6", "trials: 400")), tmp_path / "run"
    command = [sys.executable, "-m", "rig.cli.app", "evaluate", str(file), "--out", str(folder), "--jobs", "2"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        until = time.monotonic() + 120.0
        while not (folder / TRIALS).exists() or not (folder / TRIALS).stat().st_size:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < until, "no trial was done in two minutes"
            time.sleep(0.02)
        yield process, folder
    finally:
        # The workers, too: they are of its session.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def test_killed_in_the_middle_and_resumed_it_ends_as_if_it_had_not_been(
    begun: tuple[subprocess.Popen[str], Path], tmp_path: Path
) -> None:
    process, folder = begun
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    done = len((folder / TRIALS).read_text().splitlines())
    file = tmp_path / "plan.yaml"
    code, result, _ = evaluate(file, "--out", folder, "--jobs", 1, "--trials", done + 4, "--json")
    assert code == 0
    assert result is not None
    assert result["done"] == done + 4
    plan = load_plan(str(file)).of(trials=done + 4)
    fresh = without_times(list(workers.here(plan.tasks, never)))
    wanted = {(task.row.key, task.number) for task in plan.tasks}
    assert [r for r in kept(folder, plan) if (r["row"], r["number"]) in wanted] == fresh


def test_interrupted_it_ends_clean_and_says_how_to_go_on(begun: tuple[subprocess.Popen[str], Path]) -> None:
    process, folder = begun
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert f"to go on: rig evaluate {folder.parent / 'plan.yaml'} --out {folder}" in said
    assert "Traceback" not in said
    for line in (folder / TRIALS).read_text().splitlines():
        assert not failed(json.loads(line))
    assert (folder / "report.html").exists()


def test_a_camera_is_told_right_as_near_as_its_last_motion_error_allows() -> None:
    still = RowEntry(name="still", models=["campus"])
    shaky = RowEntry(name="shaky", models=["campus"], noise=NoiseEntry(motion_sd_mm=5.0, motion_theta_sd_deg=1.0))
    assert tolerance(still) == (60.0, 1.0)
    assert tolerance(shaky) == pytest.approx((61.8, 3.16), abs=0.05)
