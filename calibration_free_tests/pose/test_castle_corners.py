"""On the surveyed castle, whose lens is shifted by 10 sd of the prior, known moves fix the pose (surveyed corners)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from recognition import Priors, View, estimate_pose
from recognition.geometry import CameraPose, Pose4, wrap_deg


def castle_views(folder: Path, rng: np.random.Generator) -> list[tuple[View, CameraPose]]:
    """Views of the real grid with 1 px noise on the surveyed corners of visible parts, and the true cameras."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    objects = yaml.load((folder / "modelbase.yaml").read_text(), Loader=loader)["objects"]
    parts = {p["id"]: p["corners_mm"] for o in objects if o["id"] == "castle" for p in o["parts"]}
    places = {f["file"]: f for f in map(json.loads, (folder / "frames.jsonl").read_text().splitlines())}
    keys = ("theta_deg", "x_mm", "y_mm", "z_mm")
    out = []
    for truth in map(json.loads, (folder / "truth.jsonl").read_text().splitlines()):
        seen = [p for p in truth["parts"] if p["edges_confirmed"] == 4 and p["fully_in_frame"]]
        if not seen:
            continue
        points = np.vstack([parts[p["id"]] for p in seen])
        pixels = np.vstack([p["corners_px"] for p in seen])
        pixels = pixels + rng.standard_normal(pixels.shape)
        camera = CameraPose(*(places[truth["file"]][k] for k in keys))
        view = View(points, pixels, camera, truth["zoom"], sigma_px=1.0)
        out.append((view, CameraPose(*(truth["camera_in_object"][k] for k in keys))))
    return out


@pytest.mark.realdata
def test_two_views_with_a_known_move_place_the_camera_in_the_castle(real_data: Path, rng: np.random.Generator) -> None:
    views = castle_views(real_data / "castle", rng)
    errors = []
    for _ in range(16):
        first = int(rng.integers(len(views)))
        same = [k for k, (v, _) in enumerate(views) if v.internals_group == views[first][0].internals_group]
        second = int(rng.choice([k for k in same if k != first]))
        pair = [views[first][0], views[second][0]]
        found = estimate_pose(views=pair, priors=Priors(image_size=(1280, 960)))
        assert isinstance(found.pose, Pose4)
        camera, truth = CameraPose.from_to_camera(found.pose), views[first][1]
        errors.append(
            (np.linalg.norm(camera.centre_mm - truth.centre_mm), abs(wrap_deg(camera.theta_deg - truth.theta_deg)))
        )
    off_mm, off_deg = np.median(np.array(errors), axis=0)
    assert off_mm < 120.0
    assert off_deg < 0.25
    assert np.mean([mm < 300.0 and deg < 2.0 for mm, deg in errors]) >= 0.75
