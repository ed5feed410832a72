"""``rig scan`` as a person and a script meet it: estimate first, one message for what is wrong, and Ctrl-C ends it."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration_free_tests.imagegrid.sample import lattice, write_grid
from rig.cli.app import app
from rig.imagegrid import read_grid

ROOT = Path(__file__).resolve().parents[2]
PLAN = """schema: 1
lattice: {x_mm: {from: 0, to: 20, step: 10}, y_mm: [0, 10], z_mm: 5, theta_deg: [-15, 0, 15], zoom: [0.25, 0.75]}
"""
MOVING_RIG = """
import sys, threading
import rig.bench
from calibration_free_tests.scan.sample import FakeRig
from rig.cli.app import app
from rig.errors import HardwareError

class MovingRig(FakeRig):
    held = threading.Event()

    def move_to(self, pose):
        if len(self.captured) == 4:  # The first is for the estimate.
            print("moving", file=sys.stderr, flush=True)
            assert self.held.wait(30.0)
            raise HardwareError("motion was held on the way")
        return super().move_to(pose)

    def hold(self):
        if HOLDS:
            self.held.set()

    def stop(self, by):
        print("STOP", file=sys.stderr, flush=True)

rig.bench.open_rig = lambda *_, **__: MovingRig()
app(sys.argv[1:], prog_name="rig")
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN)
    return path


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return write_grid(tmp_path / "grid", lattice())


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        app(["scan", *map(str, arguments)], prog_name="rig")
    return int(end.value.code or 0)


def test_a_scan_of_a_mock_grid_is_a_grid_with_the_same_pictures(
    tmp_path: Path, plan: Path, grid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "scan"
    assert run(plan, "--grid", grid, "--out", out, "--json") == 0
    streams = capsys.readouterr()
    result = json.loads(streams.out)
    assert {key: result[key] for key in ("folder", "outcome", "planned", "kept", "taken")} == {
        "folder": str(out),
        "outcome": "done",
        "planned": 36,
        "kept": 0,
        "taken": 36,
    }
    assert result["estimate"]["frames"] == 36
    assert "36 pictures to take: about" in streams.err
    before, after = read_grid(grid), read_grid(out)
    assert after.is_full_lattice
    pictures = {frame.pose: before.load(frame) for frame in before.frames}
    for frame in after.frames:
        assert np.array_equal(after.load(frame), pictures.pop(frame.pose))
    assert not pictures
    assert sorted(path.name for path in out.iterdir()) == ["frames.jsonl", "grid.yaml", "images", "scan.yaml"]


def test_a_bench_file_names_the_grid_and_jpegs_may_be_stored(tmp_path: Path, plan: Path, grid: Path) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text("schema: 1\nkind: mock\ngrid: grid\n")
    plan.write_text(PLAN + "picture: {format: jpg, jpeg_quality: 70}\nnote: by hand\n")
    assert run(plan, "--bench", bench, "--out", tmp_path / "scan") == 0
    found = read_grid(tmp_path / "scan")
    assert {Path(frame.file).suffix for frame in found.frames} == {".jpg"}
    assert found.info.provenance.endswith("bench.yaml; by hand")


def test_without_out_a_new_folder_is_named_by_the_plan(
    tmp_path: Path, plan: Path, grid: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(plan, "--grid", grid) == 0
    (folder,) = (tmp_path / "grids").iterdir()
    assert folder.name.endswith("_plan")


def test_resuming_takes_what_is_missing_and_says_so(
    tmp_path: Path, plan: Path, grid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "scan"
    assert run(plan, "--grid", grid, "--out", out) == 0
    (out / "images" / "00007.png").write_bytes(b"damaged")
    capsys.readouterr()
    assert run(plan, "--grid", grid, "--out", out, "--resume", "--json") == 0
    streams = capsys.readouterr()
    assert (json.loads(streams.out)["kept"], json.loads(streams.out)["taken"]) == (35, 1)
    assert "mended:" in streams.err
    assert "00007.png: is missing or damaged" in streams.err
    assert run(plan, "--grid", grid, "--out", out, "--resume", "--json") == 0
    assert json.loads(capsys.readouterr().out)["taken"] == 0
    assert len(read_grid(out).frames) == 36


def test_resuming_where_nothing_was_begun_begins(tmp_path: Path, plan: Path, grid: Path) -> None:
    (tmp_path / "scan").mkdir()
    assert run(plan, "--grid", grid, "--out", tmp_path / "scan", "--resume") == 0
    assert len(read_grid(tmp_path / "scan").frames) == 36


def test_resuming_in_a_folder_that_is_not_there_is_refused_and_makes_none(
    tmp_path: Path, plan: Path, grid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(plan, "--grid", grid, "--out", tmp_path / "mispelt", "--resume") == 2
    assert "there is no such folder" in capsys.readouterr().err
    assert not (tmp_path / "mispelt").exists()


def test_another_plan_or_bench_is_refused_and_nothing_changed(
    tmp_path: Path, plan: Path, grid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "scan"
    bench = tmp_path / "bench.yaml"
    bench.write_text("schema: 1\nkind: mock\n")
    assert run(plan, "--grid", grid, "--bench", bench, "--out", out) == 0
    (out / "images" / "00007.png").unlink()
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    capsys.readouterr()

    plan.write_text(PLAN.replace("y_mm: [0, 10]", "y_mm: [0]"))
    assert run(plan, "--grid", grid, "--bench", bench, "--out", out, "--resume") == 2
    assert "begun with another plan" in capsys.readouterr().err
    plan.write_text(f"# the same, in other words\n{PLAN}")

    bench.write_text("schema: 1\nkind: mock\ntiming: {settle_s: 1}\n")
    assert run(plan, "--grid", grid, "--bench", bench, "--out", out, "--resume") == 2
    assert re.search(r"begun with another bench .*; what differs is timing", capsys.readouterr().err)
    bench.write_text("schema: 1  # the same\nkind: mock\n")

    other = write_grid(tmp_path / "other", lattice(), suffix=".jpg")
    assert run(plan, "--grid", other, "--bench", bench, "--out", out, "--resume") == 2
    assert "begun with another bench" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    assert run(plan, "--grid", grid, "--bench", bench, "--out", out, "--resume") == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "o"], "Name a bench file"),
        (["--grid", "{grid}", "--resume"], "Name its folder with --out"),
        (["--grid", "{grid}", "--out", "{grid}"], "the folder is not empty"),
        (["--grid", "{grid}", "--out", "{grid}", "--resume"], "there is no scan in this folder"),
        (["--grid", "{grid}", "--out", "{plan}"], "cannot be made"),
        (["--bench", "nowhere.yaml"], "no such file"),
    ],
)
def test_bad_usage_is_told(
    plan: Path, grid: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(plan, *(word.format(grid=grid, plan=plan) for word in arguments)) == 2
    assert message in capsys.readouterr().err


def test_a_finished_scan_is_not_written_over(
    tmp_path: Path, plan: Path, grid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(plan, "--grid", grid, "--out", tmp_path / "scan") == 0
    assert run(plan, "--grid", grid, "--out", tmp_path / "scan") == 2
    assert "holds a scan already. Go on with --resume" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "message"), [("y_mm: [0, 10, 99]", "18 of 54 poses"), ("y_mm: 5", "the nearest that can be is RigPose(")]
)
def test_a_pose_out_of_reach_is_refused_before_anything_is_made(
    tmp_path: Path, plan: Path, grid: Path, value: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    plan.write_text(PLAN.replace("y_mm: [0, 10]", value))
    assert run(plan, "--grid", grid, "--out", tmp_path / "scan") == 2
    error = capsys.readouterr().err
    assert str(plan) in error
    assert message in error
    assert not (tmp_path / "scan").exists()


def test_a_disk_that_is_too_small_is_told_before_anything_is_made(
    tmp_path: Path, plan: Path, grid: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**9, 10**9 - 10**6, 10**6))
    assert run(plan, "--grid", grid, "--out", tmp_path / "scan") == 2
    assert "36 pictures need 67" in (error := capsys.readouterr().err)
    assert "1 MB are free. Free some space" in error
    assert not (tmp_path / "scan").exists()


def moving(tmp_path: Path, plan: Path, holds: bool) -> subprocess.Popen[str]:
    plan.write_text(PLAN.replace("z_mm: 5", "z_mm: 0"))
    bench = tmp_path / "bench.yaml"
    bench.write_text("schema: 1\nkind: mock\n")
    script = MOVING_RIG.replace("HOLDS", str(holds))
    arguments = ["scan", str(plan), "--bench", str(bench), "--out", str(tmp_path / "scan"), "--json"]
    streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", script, *arguments], cwd=ROOT, **streams)


def wait_for(process: subprocess.Popen[str], word: str) -> None:
    assert process.stderr is not None
    while word not in (line := process.stderr.readline()):
        assert line, f"ended before it said {word}"


def test_ctrl_c_holds_the_motion_keeps_the_picture_in_hand_and_ends(tmp_path: Path, plan: Path) -> None:
    with moving(tmp_path, plan, holds=True) as process:
        wait_for(process, "moving")
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "motion was held on the way" in error
    assert "--resume" in error
    assert "STOP\n" not in error.replace("Ctrl-C again: STOP\n", "")
    assert (json.loads(out)["outcome"], json.loads(out)["taken"]) == ("interrupted", 3)
    assert len(read_grid(tmp_path / "scan").frames) == 3


def test_ctrl_c_twice_is_stop(tmp_path: Path, plan: Path) -> None:
    with moving(tmp_path, plan, holds=False) as process:
        wait_for(process, "moving")
        process.send_signal(signal.SIGINT)
        wait_for(process, "holding")
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(out)["outcome"] == "interrupted"
    assert "STOP\n" in error
    assert len(read_grid(tmp_path / "scan").frames) == 3
