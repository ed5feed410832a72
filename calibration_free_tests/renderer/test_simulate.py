"""A simulated scene is drawn from its seed, and its truth is what the picture shows."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration_free_tests.renderer.bench_building import model_base
from recognition.modelbase import ModelBase, PartClass
from rig.errors import InputError
from sim_backends.rendered_rig import Lattice
from sim_backends.simulate import draw_scene, rendered_rig, simulate, truth_record

SIZE = (320, 240)


def test_a_seed_draws_the_same_scene_and_another_seed_another_one() -> None:
    a, b, c = (draw_scene(model_base(), "bench building", seed, cluttered=True) for seed in (1, 1, 2))
    assert a.object_in_rig == b.object_in_rig != c.object_in_rig
    assert a.appearance == b.appearance != c.appearance
    assert len(a.clutter) == 3 * len(a.object_model.faces)
    assert not draw_scene(model_base(), "bench building", 1).clutter


def test_brightness_follows_the_part_classes() -> None:
    base = model_base()
    bright = ModelBase(base.objects, (PartClass("DW4", 4, None, True), PartClass("OPEN", 4, None, False)), base.name)
    assert draw_scene(bright, "bench building", 1).appearance.bright_classes == {"DW4"}


def test_an_object_that_does_not_exist_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"palace.*bench building"):
        draw_scene(model_base(), "palace", 1)


def test_the_truth_record_holds_camera_internals_and_parts() -> None:
    rig = rendered_rig(draw_scene(model_base(), "bench building", 3), size=SIZE, zooms=(0.5,))
    pose = rig.reachable()[4]
    record = json.loads(json.dumps(truth_record(rig, "a.png", pose)))
    truth = rig.truth(pose)
    assert record["camera_in_object"]["theta_deg"] == pytest.approx(truth.camera_in_object.theta_deg, abs=1e-6)
    assert record["fx"] == pytest.approx(truth.internals.fx)
    assert record["parts"]
    for part, seen in zip(record["parts"], rig.parts(pose), strict=True):
        np.testing.assert_allclose(part["corners_px"], seen.corners_px, atol=1e-3)
        assert (part["state"] == "visible") == (seen.visible_fraction >= 0.99)


def test_a_rendered_rig_can_offer_a_lattice() -> None:
    rig = rendered_rig(draw_scene(model_base(), "bench building", 3), size=SIZE, offers=Lattice(zooms=(0.0, 1.0)))
    assert rig.move_to(rig.nearest(rig.pose)) in rig.reachable()
    assert rig.capture().image.shape == (240, 320, 3)


def test_simulate_writes_pictures_poses_digests_and_truth(tmp_path: Path) -> None:
    rig = rendered_rig(draw_scene(model_base(), "bench building", 3), size=SIZE, zooms=(0.5,))
    poses = rig.reachable()[:3]
    grid = simulate(rig, poses, tmp_path / "grid")
    frames = [json.loads(line) for line in (grid / "frames.jsonl").read_text().splitlines()]
    truths = [json.loads(line) for line in (grid / "truth.jsonl").read_text().splitlines()]
    assert [f["file"] for f in frames] == [t["file"] for t in truths]
    for pose, frame, truth in zip(poses, frames, truths, strict=True):
        data = (grid / frame["file"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == frame["sha256"]
        rig.move_to(pose)
        assert np.array_equal(cv2.imread(str(grid / frame["file"])), rig.capture().image)
        assert (frame["x_mm"], frame["theta_deg"], frame["zoom"]) == (pose.x_mm, pose.theta_deg, pose.zoom)
        assert not {"fx", "camera_in_object", "parts"} & set(frame)
        assert truth["camera_in_object"]["x_mm"] != pytest.approx(frame["x_mm"], abs=0.1)
    with pytest.raises(InputError, match="already"):
        simulate(rig, poses, grid)
