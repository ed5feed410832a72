"""The recognise command: how its options reach the loop, which is scripted here."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from calibration_free_tests.scripted_run import scripted_steps
from recognition.modelbase_io import load_model_base
from recognition.settings import Effort, RecogniserSettings
from rig.cli import recognising
from rig.cli.app import app
from rig.hal import Rig
from rig.run import Steps
from sim_backends.simulate import draw_scene, rendered_rig, simulate


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rig = rendered_rig(draw_scene(load_model_base("architecture"), "GH", 1), zooms=(0.0,), size=(64, 48))
    return simulate(rig, list(rig.reachable())[:6], tmp_path_factory.mktemp("grids") / "gh")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the loop was asked to do; the loop itself is the scripted one."""
    seen: dict[str, Any] = {}

    def recognise(rig: Rig, models: Any, settings: RecogniserSettings) -> Steps:
        seen.update(start=rig.pose, models=models.name, settings=settings)
        return scripted_steps()

    monkeypatch.setitem(sys.modules, "recognition.recogniser", SimpleNamespace(recognise=recognise))
    # Whatever was compiled before: it must neither take the scripted loop for its own nor keep it.
    monkeypatch.setattr(recognising, "compile_first", lambda: None)
    monkeypatch.setattr(recognising, "chosen", lambda option, name, group: name)
    return seen


@pytest.fixture
def rig(grid: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int | str | None]:
    """Run ``rig recognise`` on the small grid in an empty folder; returns the exit code."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> int | str | None:
        with pytest.raises(SystemExit) as end:
            app(["recognise", "--grid", str(grid), "--models", "architecture", *arguments], prog_name="rig")
        return end.value.code

    return run


def frames(grid: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (grid / "frames.jsonl").read_text().splitlines()]


def test_start_is_a_picture_of_the_grid(grid: Path, rig: Callable[..., int], asked: dict[str, Any]) -> None:
    wanted = frames(grid)[3]
    assert rig("--start", wanted["file"], "--json") == 0
    assert (asked["start"].x_mm, asked["start"].theta_deg) == (wanted["x_mm"], wanted["theta_deg"])


def test_start_is_snapped_to_the_nearest_pose(grid: Path, rig: Callable[..., int], asked: dict[str, Any]) -> None:
    wanted = frames(grid)[4]
    near = ",".join(str(wanted[axis]) for axis in ("x_mm", "y_mm", "z_mm")) + f",{wanted['theta_deg']}"
    assert rig("--start", near, "--json") == 0
    assert (asked["start"].x_mm, asked["start"].theta_deg) == (wanted["x_mm"], wanted["theta_deg"])


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("images/nothing.png", "no picture is called"),
        ("1,2,3", "3 numbers"),
        ("1e9,0,0,0", "x_mm"),
        ("nan,0,0,0", "x_mm"),
    ],
)
def test_impossible_start_is_bad_input(
    rig: Callable[..., int], asked: dict[str, Any], capsys: pytest.CaptureFixture[str], start: str, message: str
) -> None:
    assert rig("--start", start) == 2
    assert message in capsys.readouterr().err
    assert not asked


def test_a_start_beyond_the_benchs_limits_is_bad_input(
    grid: Path, tmp_path: Path, rig: Callable[..., int], asked: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    """A picture of the grid, at a pose that the bench file does not allow."""
    low, high = sorted(frames(grid), key=lambda frame: float(frame["x_mm"]))[:: len(frames(grid)) - 1]
    limit = (low["x_mm"] + high["x_mm"]) / 2
    bench = tmp_path / "bench.yaml"
    bench.write_text(f"schema: 1\nkind: mock\naxes:\n  x_mm: {{lower: {low['x_mm'] - 1}, upper: {limit}}}\n")
    assert rig(str(bench), "--start", high["file"]) == 2
    assert "x_mm" in capsys.readouterr().err
    assert not asked


def test_paper_mode_brings_its_own_policy_and_threshold(rig: Callable[..., int], asked: dict[str, Any]) -> None:
    rig("--mode", "paper", "--json")
    assert (asked["settings"].mode, asked["settings"].policy, asked["settings"].threshold) == ("paper", "paper", 1.0)
    rig("--mode", "paper", "--policy", "random", "--threshold", "0.9", "--json")
    assert (asked["settings"].policy, asked["settings"].threshold) == ("random", 0.9)


@pytest.mark.parametrize("option", ["--pose-sd-mm", "--pose-sd-deg"])
def test_paper_mode_refuses_to_go_on_for_a_surer_pose(
    rig: Callable[..., int], asked: dict[str, Any], capsys: pytest.CaptureFixture[str], option: str
) -> None:
    assert rig("--mode", "paper", option, "3") == 2
    told = capsys.readouterr().err
    assert option in told
    assert "graded" in told
    assert not asked


def test_options_reach_the_loop(rig: Callable[..., int], asked: dict[str, Any]) -> None:
    options = ["--max-views", "3", "--pose-sd-mm", "40", "--pose-sd-deg", "0.2", "--seed", "7", "--threshold", "0.95"]
    assert rig(*options, "--json") == 0
    settings = asked["settings"]
    assert (settings.max_views, settings.pose_sd_mm, settings.pose_sd_deg, settings.seed) == (3, 40.0, 0.2, 7)
    assert (settings.threshold, settings.mode, settings.policy) == (0.95, "graded", "information")
    assert asked["models"] == "architecture"


@pytest.mark.parametrize("option", [("--threshold", "1.5"), ("--max-views", "0"), ("--pose-sd-mm", "nan")])
def test_settings_out_of_range_are_bad_input(
    rig: Callable[..., int], asked: dict[str, Any], capsys: pytest.CaptureFixture[str], option: tuple[str, str]
) -> None:
    assert rig(*option) == 2
    assert option[0] in capsys.readouterr().err


def test_bench_limits_and_bounds_reach_the_loop(
    grid: Path, asked: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(
        f"schema: 1\nkind: mock\ngrid: {grid}\nmount: {{z_mm: 12.5}}\nobject: {{distance_mm: [100, 900]}}\n"
    )
    with pytest.raises(SystemExit) as end:
        app(["recognise", str(bench), "--models", "architecture", "--json"], prog_name="rig")
    assert end.value.code == 0
    assert asked["settings"].mount.z_mm == 12.5
    assert asked["settings"].bounds.distance_max_mm == 900.0
    assert json.loads(capsys.readouterr().out)["outcome"] == "recognised"


def test_detector_and_goal_of_the_bench_reach_the_loop_unless_the_user_asks_otherwise(
    grid: Path, asked: dict[str, Any], tmp_path: Path
) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(
        f"schema: 1\nkind: mock\ngrid: {grid}\n"
        "detection: {found: 0.5, clutter: 90}\ngoal: {pose_sd_mm: 8, pose_sd_deg: 0.25}\n"
    )
    command = ["recognise", str(bench), "--models", "architecture", "--json"]
    with pytest.raises(SystemExit):
        app(command, prog_name="rig")
    settings = asked["settings"]
    assert (settings.rates.found, settings.rates.clutter) == (0.5, 90.0)
    assert settings.effort == Effort.for_clutter(90.0) != Effort()
    assert (settings.pose_sd_mm, settings.pose_sd_deg) == (8.0, 0.25)
    with pytest.raises(SystemExit):
        app([*command, "--pose-sd-mm", "3"], prog_name="rig")
    settings = asked["settings"]
    assert (settings.pose_sd_mm, settings.pose_sd_deg) == (3.0, 0.25)


def test_run_is_kept_under_runs_unless_a_script_asks(rig: Callable[..., int], asked: dict[str, Any]) -> None:
    rig("--json")
    assert not Path("runs").exists()
    rig()
    (folder,) = Path("runs").iterdir()
    assert (folder / "report.html").is_file()
    rig("--json", "--out", "mine")
    assert json.loads(Path("mine/result.json").read_text())["object"] == "tower"
    start = json.loads((folder / "events.jsonl").read_text().splitlines()[0])
    assert start["settings"]["policy"] == "information"


def test_missing_picture_needs_allow_partial(
    grid: Path, asked: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shutil

    broken = tmp_path / "broken"
    shutil.copytree(grid, broken)
    name = frames(grid)[0]["file"]
    (broken / name).unlink()
    command = ["recognise", "--grid", str(broken), "--models", "architecture", "--json"]
    for extra, code in (([], 2), (["--allow-partial"], 0)):
        with pytest.raises(SystemExit) as end:
            app([*command, *extra], prog_name="rig")
        assert end.value.code == code
        assert name in capsys.readouterr().err


def test_neither_bench_nor_grid_is_bad_input(asked: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app(["recognise", "--models", "architecture"], prog_name="rig")
    assert end.value.code == 2
    assert "--grid" in capsys.readouterr().err
