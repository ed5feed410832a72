"""The README's way to an answer: a grid from `rig simulate` and no bench file, so that all bounds are wide."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recognition.geometry import wrap_deg
from rig.cli.app import app

AXES = ("x_mm", "y_mm", "z_mm")
VIEWS = 40


def call(*arguments: str) -> int | str | None:
    """Run ``rig`` and return its exit code."""
    with pytest.raises(SystemExit) as end:
        app(list(arguments), prog_name="rig")
    return end.value.code


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grids") / "lh"
    asked = ("--views", str(VIEWS), "--jpeg", "93", "--seed", "1")
    assert call("simulate", "architecture", "LH", str(folder), *asked) == 0
    return folder


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def true_camera(grid: Path, rig_pose: dict[str, float]) -> dict[str, float]:
    """The camera in the object frame, of the picture that was taken at a rig pose."""
    (file,) = [f["file"] for f in lines(grid / "frames.jsonl") if all(abs(f[k] - rig_pose[k]) < 1e-6 for k in rig_pose)]
    return dict(next(t["camera_in_object"] for t in lines(grid / "truth.jsonl") if t["file"] == file))


@pytest.mark.parametrize("picture", [1, VIEWS // 2, VIEWS])
def test_a_grid_alone_is_enough_to_be_recognised(grid: Path, picture: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Distances from 5 cm to 100 m and any lens from 2 to 120 degrees are allowed: the known moves settle the scale."""
    capsys.readouterr()
    command = ("recognise", "--grid", str(grid), "--models", "architecture", "--start", f"images/{picture:05d}.jpg")
    assert call(*command, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["outcome"], result["object"], result["pose_sure"]) == ("recognised", "LH", True)
    truth = true_camera(grid, result["views"][-1]["rig_pose"])
    assert np.linalg.norm([result["pose"][k] - truth[k] for k in AXES]) < 30.0
    assert abs(wrap_deg(result["pose"]["theta_deg"] - truth["theta_deg"])) < 2.0
