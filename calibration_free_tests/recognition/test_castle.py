"""A real castle, photographed: the object and the camera's place are found from one close-up and a few known moves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recognition.geometry import wrap_deg
from rig.cli.app import app

BENCH = Path(__file__).resolve().parents[2] / "examples" / "castle.yaml"


def recognised_from(castle: Path, start: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """What ``rig recognise`` prints for a start, as the issue's user would call it."""
    with pytest.raises(SystemExit) as end:
        app(
            [
                *("recognise", str(BENCH), "--grid", str(castle), "--models", str(castle / "modelbase.yaml")),
                *("--start", start, "--json"),
            ],
            prog_name="rig",
        )
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert end.value.code == (0 if result["outcome"] == "recognised" else 1)
    return result


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def true_camera(castle: Path, rig_pose: dict[str, float]) -> dict[str, float]:
    """The surveyed camera, in the object frame, of the picture that was taken at a rig pose."""
    keys = ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom")
    taken = [f["file"] for f in lines(castle / "frames.jsonl") if all(abs(f[k] - rig_pose[k]) < 1e-6 for k in keys)]
    (truth,) = [t["camera_in_object"] for t in lines(castle / "truth.jsonl") if t["file"] in taken]
    return dict(truth)


@pytest.mark.realdata
@pytest.mark.parametrize("start", ["p02_w_m0750", "p01_t_m0975", "p11_t_p0150"])
def test_a_castle_is_told_from_its_look_alikes_and_the_camera_placed(
    real_data: Path, start: str, capsys: pytest.CaptureFixture[str]
) -> None:
    castle = real_data / "castle"
    result = recognised_from(castle, f"images/{start}.jpg", capsys)
    assert (result["outcome"], result["object"]) == ("recognised", "castle")
    truth = true_camera(castle, result["views"][-1]["rig_pose"])
    away = [result["pose"][k] - truth[k] for k in ("x_mm", "y_mm", "z_mm")]
    assert np.linalg.norm(away) < 300.0
    assert abs(wrap_deg(result["pose"]["theta_deg"] - truth["theta_deg"])) < 2.0
    assert sum(result["posterior"].values()) == pytest.approx(1.0)
