"""Corners in the picture lie where the projection equations put them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.renderer.bench_building import OUTLINES, camera_at, part_on, wall_face
from recognition.geometry import CameraPose, Pose4, camera_in_object
from recognition.modelbase import ObjectModel
from recognition.modelbase_io import load_model_base
from rig.errors import InputError
from sim_backends.appearance import HIGH_CONTRAST, PERFECT
from sim_backends.coverage import coverage
from sim_backends.renderer import Internals, Scene, render, visible_parts

PLACE = Pose4(-8.0, 31.0, -12.0, 57.0)
SIZE = (640, 480)


def one_part_scene(part_class: str, recess_mm: float = 5.0) -> Scene:
    face = wall_face("F", np.array([-400.0, 200.0, 0.0]), np.array([400.0, 200.0, 0.0]), 400.0)
    part = part_on(face, "p", part_class, 380.0, 175.0, 40.0, 50.0, recess_mm)
    return Scene(ObjectModel("o", (part,), (face,)), PLACE, HIGH_CONTRAST)


def projected(scene: Scene, camera: CameraPose, inner: Internals) -> np.ndarray:
    """The equations of design §2, written out once more, independently of the renderer."""
    pose = camera_in_object(camera, scene.object_in_rig)
    t = np.radians(pose.theta_deg)
    rotation = np.array([[np.cos(t), 0, np.sin(t)], [0, 1, 0], [-np.sin(t), 0, np.cos(t)]])
    cam = (scene.object_model.parts[0].corners_mm - [pose.x_mm, pose.y_mm, pose.z_mm]) @ rotation.T
    x, y = cam[:, 0] / cam[:, 2], cam[:, 1] / cam[:, 2]
    bend = 1 + inner.k1 * (x**2 + y**2)
    return np.stack([inner.fx * x * bend + inner.u0, inner.fy * y * bend + inner.v0], axis=-1)


def measured_edge(dark: np.ndarray, a: np.ndarray, b: np.ndarray, inner: Internals) -> np.ndarray:
    """The homogeneous line of the edge from a to b, from the picture alone: dark area across the edge, row by row.

    Points are taken to normalised coordinates before the fit, where edges are straight whatever the radial term.
    """
    steep = abs(b[1] - a[1]) > abs(b[0] - a[0])
    main, cross = (1, 0) if steep else (0, 1)
    image = dark if steep else dark.T
    low, high = sorted((a[main], b[main]))
    lines = np.arange(int(np.ceil(low + 6)), int(high - 6))
    points = []
    for line in lines:
        middle = a[cross] + (b[cross] - a[cross]) * (line - a[main]) / (b[main] - a[main])
        first, last = round(middle) - 4, round(middle) + 5
        profile = image[line, first:last]
        dark_first = profile[0] > 0.5
        at = first - 0.5 + profile.sum() if dark_first else last - 0.5 - profile.sum()
        points.append((at, line) if steep else (line, at))
    flat = inner.undistort(np.array(points))
    mean = flat.mean(axis=0)
    direction = np.linalg.svd(flat - mean)[2][0]
    normal = np.array([-direction[1], direction[0]])
    return np.array([*normal, -normal @ mean])


def measured_corners(image: np.ndarray, near: np.ndarray, inner: Internals) -> np.ndarray:
    grey = image[..., 0].astype(float)
    dark = 1.0 - grey / 220.0
    n = len(near)
    lines = [measured_edge(dark, near[i], near[(i + 1) % n], inner) for i in range(n)]
    meets = [np.cross(lines[i - 1], lines[i]) for i in range(n)]
    return inner.distort(np.array([m[:2] / m[2] for m in meets]))


@pytest.mark.parametrize("k1", [0.0, -0.15, 0.25])
@pytest.mark.parametrize("part_class", [name for name in OUTLINES if name != "OPEN"])
def test_corners_lie_within_a_twentieth_of_a_pixel(part_class: str, k1: float) -> None:
    scene = one_part_scene(part_class)
    worst = 0.0
    for n, (theta, x, y, z) in enumerate([(0, 3, -5, -95), (24, 48, 12, -120), (-33, -70, -4, -105)]):
        inner = Internals(700 + 37.7 * n, 713.0, 322.3 + 11 * n, 236.1 + 13 * n, k1)
        camera = camera_at(theta, x, y, z, PLACE)
        truth = projected(scene, camera, inner)
        image = render(scene, camera, inner, SIZE, rng=np.random.default_rng(0), sensor=PERFECT)
        found = measured_corners(image, truth, inner)
        worst = max(worst, float(np.abs(found - truth).max()))
    assert worst < 0.01  # asked for: 0.05


def test_truth_follows_the_projection_equations() -> None:
    scene, inner = one_part_scene("DW6L"), Internals(900, 871, 300, 260, -0.1)
    camera = camera_at(10, 25, 3, -130, PLACE)
    (part,) = visible_parts(scene, camera, inner, SIZE)
    np.testing.assert_allclose(part.corners_px, projected(scene, camera, inner), atol=1e-9)
    assert part.fully_in_frame
    assert part.visible_fraction == 1.0


def test_coverage_is_the_area_inside_each_pixel() -> None:
    cover = coverage(np.array([[0.25, 0.0], [2.5, 0.0], [2.5, 1.75], [0.25, 1.75]]), (10, 8))
    assert cover is not None
    columns = np.array([0.25, 1.0, 1.0])  # x from 0.25 to 2.5: pixels 0 (to 0.5), 1 (to 1.5), 2 (to 2.5)
    rows = np.array([0.5, 1.0, 0.25])  # y from 0 to 1.75, likewise
    assert (cover.x, cover.y) == (0, 0)
    np.testing.assert_allclose(cover.fraction, rows[:, None] * columns[None, :], atol=1e-6)


def test_coverage_of_a_polygon_beyond_the_frame_keeps_its_inside() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        angles = 0.9 * (np.arange(7) + rng.uniform(0, 0.8, 7))  # all around, so that the outline does not cross itself
        shape = np.stack([np.cos(angles), np.sin(angles)], -1) * rng.uniform(5, 60, (7, 1)) + rng.uniform(-5, 45, 2)
        small, large = coverage(shape, (40, 30)), coverage(shape + 100, (300, 300))
        assert large is not None
        full = np.zeros((300, 300))
        full[large.window] = large.fraction
        x, y = shape.T
        assert full.sum() == pytest.approx(0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)), rel=1e-4)
        part = np.zeros((30, 40))
        if small is not None:
            part[small.window] = small.fraction
        np.testing.assert_allclose(part, full[100:130, 100:140], atol=1e-5)


def test_internals_refuse_a_lens_that_folds_back() -> None:
    scene = one_part_scene("DW4")
    with pytest.raises(InputError, match="folds"):
        visible_parts(scene, camera_at(0, 0, 0, -100, PLACE), Internals(400, 400, 320, 240, -0.9), SIZE)


def test_undistort_inverts_distort() -> None:
    for k1 in (-0.2, 0.0, 0.3):
        inner = Internals(700, 690, 310, 250, k1)
        pixels = np.random.default_rng(1).uniform(0, 640, (50, 2))
        np.testing.assert_allclose(inner.distort(inner.undistort(pixels)), pixels, atol=1e-7)


@pytest.mark.realdata
def test_corners_agree_with_the_surveyed_castle(real_data: Path) -> None:
    """Real photographs' corners were projected by the survey's own program; ours must give the same to its rounding."""
    scene = Scene(load_model_base(real_data / "castle" / "modelbase.yaml").object("castle"))
    compared = 0
    with (real_data / "castle" / "truth.jsonl").open() as lines:
        views = [json.loads(line) for line in lines]
    for view in views[::10]:
        at = view["camera_in_object"]
        camera = CameraPose(at["theta_deg"], at["x_mm"], at["y_mm"], at["z_mm"])
        inner = Internals(view["fx"], view["fy"], view["u0"], view["v0"])
        surveyed = {part["id"]: np.array(part["corners_px"]) for part in view["parts"]}
        for part in visible_parts(scene, camera, inner):
            if part.id in surveyed:
                np.testing.assert_allclose(part.corners_px, surveyed[part.id], atol=0.05)
                compared += 1
    assert compared > 100
