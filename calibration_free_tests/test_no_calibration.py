"""The heart of the project: nothing anywhere needs, asks for or does a calibration."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
import re
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import drivers
import recognition
import rig
from calibration_free_tests.pose.scenes import TWO_FACES, picture
from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    Faults,
    SyntheticRig,
    around_the_corner,
    before_front,
    changing,
    fixed,
    off,
    run,
    seen_from,
    three_buildings,
    world_of,
)
from recognition import Priors, View, estimate_pose
from recognition.belief import Belief, update, weigh
from recognition.geometry import CameraPose, Mount, Pose4, camera_in_object
from recognition.invariants import choose_triplets, ratio_invariants
from recognition.modelbase import ModelBase
from recognition.parts import DetectedPart, Detector
from recognition.rates import DetectionRates
from recognition.recogniser import recognise
from recognition.seen import Seen
from recognition.settings import BenchBounds, Effort, RecogniserSettings
from recognition.steps import Answer, Outcome
from recognition.summary import leading_group, pose_sd
from rig.bench import BenchFile
from rig.hal import Camera, Frame, Rig, RigPose, Zoom

INTERNALS_WORD = re.compile(
    r"^(k|kmat|camera_matrix|intrinsics?|internals?|calibration|calib|focal\w*|f_px|fx|fy|cx|cy|u0|v0|principal\w*"
    r"|dist(ortion)?(_coeffs)?|pixel_(size|pitch)\w*|sensor_(width|size)\w*)$",
    re.IGNORECASE,
)
CALIBRATING = re.compile(
    r"calibrat|solvepnp|undistort|getoptimalnewcameramatrix|findchessboard|findcirclesgrid|stereorectify"
    r"|recoverpose|findessentialmat|projectpoints|charuco",
    re.IGNORECASE,
)
CAMERAS = [
    np.array([800.0, 812.0, 655.0, 470.0]),
    np.array([3100.0, 2950.0, 100.0, 900.0]),
    np.array([400.0, 400.0, 639.5, 479.5]),
    np.array([1200.0, 1100.0, -350.0, 1400.0]),
]
BASE = three_buildings()
POSE = Pose4(38.0, 6.0, -14.0, 260.0)


# --- the mathematics ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("internals", CAMERAS)
def test_invariants_are_those_of_a_camera_with_unit_internals(internals: np.ndarray) -> None:
    plain, zoomed = picture(TWO_FACES, POSE, np.array([1.0, 1, 0, 0])), picture(TWO_FACES, POSE, internals)
    for axis in (0, 1):
        triplets = choose_triplets(plain[:, axis])
        np.testing.assert_allclose(
            ratio_invariants(zoomed[:, axis], triplets), ratio_invariants(plain[:, axis], triplets), rtol=1e-9
        )


@pytest.mark.parametrize("internals", CAMERAS)
def test_an_estimate_is_the_same_for_any_internals(internals: np.ndarray) -> None:
    found = estimate_pose(TWO_FACES, picture(TWO_FACES, POSE, internals)).pose
    assert (found.theta_deg, *found.translation_mm) == pytest.approx((POSE.theta_deg, *POSE.translation_mm), abs=1e-6)


def test_an_estimate_from_several_views_is_the_same_if_each_has_other_internals() -> None:
    cameras = [CameraPose(38.0 + turn, 10.0 * turn, 0.0, 4.0 * turn) for turn in (0.0, 8.0, -6.0, 3.0)]
    in_first = POSE.inverse() @ cameras[0].to_camera()  # rig -> object

    def views(internals: list[np.ndarray]) -> list[View]:
        return [
            View(TWO_FACES, picture(TWO_FACES, camera.to_camera() @ in_first.inverse(), k), camera, f"view {n}")
            for n, (camera, k) in enumerate(zip(cameras, internals, strict=True))
        ]

    alike, different = estimate_pose(views=views(CAMERAS[:1] * 4)), estimate_pose(views=views(CAMERAS))
    for found in (alike, different):
        assert found.pose.theta_deg == pytest.approx(POSE.theta_deg, abs=1e-6)
        np.testing.assert_allclose(found.pose.translation_mm, POSE.translation_mm, atol=1e-6)


def test_soft_knowledge_of_cameras_loses_to_the_data() -> None:
    """Four parts' worth of corners off the centre by half a picture: the prior costs a fraction of a degree."""
    shifted = np.array([800.0, 800.0, 639.5, 840.0])
    found = estimate_pose(TWO_FACES, picture(TWO_FACES, POSE, shifted), priors=Priors(image_size=(1280, 960)))
    assert found.pose.theta_deg == pytest.approx(POSE.theta_deg, abs=0.5)
    np.testing.assert_allclose(found.pose.translation_mm, POSE.translation_mm, atol=6.0)


# --- recognition ----------------------------------------------------------------------------------------------------


def views_through(internals: Callable[[int], np.ndarray]) -> tuple[list[Seen], CameraPose]:
    """Three views of the tower from fixed places, every picture through internals of its own."""
    places = [before_front(300.0, turn_deg=15.0), before_front(480.0, 210.0, 360.0, -10.0), before_front(390.0, 240.0)]
    views = [
        seen_from(BASE, BASE.objects[0], camera, group=n, internals=internals(n)) for n, camera in enumerate(places)
    ]
    return views, places[-1]


AXES = ("x_mm", "y_mm", "z_mm")


def belief_of(views: list[Seen]) -> Belief:
    world = world_of(BASE)
    hypotheses = None
    for k in range(1, len(views) + 1):
        hypotheses = update(world, hypotheses, views[:k], Effort())
    assert hypotheses is not None
    return weigh(world, hypotheses)


@pytest.mark.parametrize(
    "internals",
    [
        lambda _n: np.array([560.0, 560.0, 319.5, 239.5]),
        lambda _n: np.array([620.0, 622.0, 350.0, 215.0]),
        lambda n: np.array([[560.0, 560, 319, 239], [500, 503, 300, 260], [630, 626, 340, 230]])[n],
        lambda n: np.array([[480.0, 482, 330, 250], [640, 640, 345, 235], [540, 538, 290, 222]])[n],
    ],
    ids=["plain", "zoomed and shifted", "another in every view", "yet others"],
)
def test_a_recognition_does_not_depend_on_the_internals_of_its_views(
    internals: Callable[[int], np.ndarray],
) -> None:
    views, truth = views_through(internals)
    belief = belief_of(views)
    placement = belief.hypotheses.placement[0]
    camera = camera_in_object(views[-1].camera, Pose4.of(float(np.degrees(placement[0])), placement[1:]))
    assert belief.by_object(3)[0] > 0.99
    # A principal point 30 px aside, where the prior has an sd of 19 px, pulls the pose: as far as its sd tells.
    world = world_of(BASE)
    sd = pose_sd(belief, views, leading_group(world, belief, views))
    assert np.linalg.norm(camera.centre_mm - truth.centre_mm) < 3.0 * np.linalg.norm([sd[k] for k in AXES])
    assert max(sd[k] for k in AXES) < 8.0
    assert abs(camera.theta_deg - truth.theta_deg) < 1.5


@pytest.mark.parametrize("seed", range(4))
def test_a_run_ends_the_same_with_other_internals_in_every_view(seed: int) -> None:
    for internals in (fixed(), changing(seed), changing(seed + 100)):
        bench = SyntheticRig(BASE.objects[seed % 3], around_the_corner(), internals, Faults(noise_px=0.3), seed=seed)
        _, answer = run(bench, BASE)
        away_mm, away_deg = off(answer, bench)
        assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, BASE.objects[seed % 3].id)
        assert away_mm < 40.0
        assert away_deg < 4.0


def test_what_the_rig_vouches_for_may_be_used_but_is_not_needed() -> None:
    for vouched in (False, True):
        bench = SyntheticRig(BASE.objects[1], around_the_corner(), fixed(), internals_fixed_by_zoom=vouched)
        _, answer = run(bench, BASE)
        assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, "mill")


# --- what is asked of a user ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("function", [recognise, estimate_pose, View, RecogniserSettings, BenchBounds, Frame, RigPose])
def test_no_public_entry_requires_internals(function: Callable[..., Any]) -> None:
    needed = [
        name
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.default is inspect.Parameter.empty and INTERNALS_WORD.match(name)
    ]
    assert needed == []


@pytest.mark.parametrize("value", [RecogniserSettings, BenchBounds, Frame, RigPose, ModelBase, DetectedPart])
def test_no_value_that_a_user_gives_holds_internals(value: type) -> None:
    assert [f.name for f in dataclasses.fields(value) if INTERNALS_WORD.match(f.name)] == []


@pytest.mark.parametrize("protocol", [Rig, Camera, Zoom, Detector])
def test_no_device_and_no_detector_is_asked_for_internals(protocol: type) -> None:
    for name, member in inspect.getmembers(protocol):
        if name.startswith("_"):
            continue
        assert not INTERNALS_WORD.match(name)
        if callable(member):
            assert not any(INTERNALS_WORD.match(p) for p in inspect.signature(member).parameters)


def test_a_bench_needs_no_word_about_its_camera() -> None:
    camera = BenchFile.model_validate({"schema": 1, "kind": "mock"}).camera
    assert (camera.internals, camera.view_angle_deg) == (None, None)


@pytest.mark.parametrize("entry", [{"fx": 800.0}, {"internals": [800.0, 800.0, 640.0, 480.0]}, {"camera_matrix": 1}])
def test_a_bench_has_no_place_for_internals(entry: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        BenchFile.model_validate({"schema": 1, "kind": "mock", "camera": entry})


def test_an_answer_speaks_of_the_pose_and_never_of_internals() -> None:
    assert [f.name for f in dataclasses.fields(Answer) if INTERNALS_WORD.match(f.name)] == []


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in getattr(group, "commands", {}).items():
        yield (*path, name), command
        yield from commands(command, (*path, name))


def test_no_option_of_the_command_line_takes_internals() -> None:
    from typer.main import get_command

    from rig.cli.app import app

    found = list(commands(get_command(app)))
    assert ("recognise",) in [path for path, _ in found]
    for path, command in found:
        assert "calibrate" not in path
        assert [p.name for p in command.params if INTERNALS_WORD.match(p.name)] == []


def keys_of(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for inner in schema.values():
            yield from keys_of(inner)
    elif isinstance(schema, list):
        for inner in schema:
            yield from keys_of(inner)


def test_a_model_base_has_no_key_for_internals() -> None:
    keys = set(keys_of(json.loads(files("rig.data").joinpath("modelbase.schema.json").read_text())))
    assert "corners_mm" in keys
    assert [key for key in keys if INTERNALS_WORD.match(key)] == []


# --- what the code does ---------------------------------------------------------------------------------------------


def sources() -> Iterator[Path]:
    """Not of the simulators, which play lenses."""
    for package in (rig, recognition, drivers):
        yield from Path(next(iter(package.__path__))).rglob("*.py")


def names_called(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute):
                yield node.func.attr
            elif isinstance(node.func, ast.Name):
                yield node.func.id


def test_nothing_calls_a_calibration_or_a_calibrated_solver() -> None:
    seen = list(sources())
    assert len(seen) > 50
    for path in seen:
        called = [name for name in names_called(ast.parse(path.read_text())) if CALIBRATING.search(name)]
        assert called == [], path


def test_the_only_knowledge_of_the_lens_is_a_range() -> None:
    """A bench may say which angles of view the lens can have, and nothing finer."""
    told = {f.name for value in (BenchBounds, DetectionRates, Mount) for f in dataclasses.fields(value)}
    of_objects_and_moves = {"distance_min_mm", "distance_max_mm", "motion_sd_mm", "motion_sd_deg"}
    of_the_detector = {"found", "clutter", "corner_sd_px", "measured"}
    # How the camera hangs and how straight the axes are: all of it outside the camera.
    of_the_mount = {"x_mm", "y_mm", "z_mm", "pan_zero_deg", "roll_deg", "pitch_deg"}
    of_the_axes = {"x_scale", "y_scale", "z_scale", "xy_deg", "xz_deg", "yz_deg"}
    known = of_objects_and_moves | of_the_detector | of_the_mount | of_the_axes
    assert told - known == {"view_angle_min_deg", "view_angle_max_deg"}
    assert known <= told


@pytest.mark.parametrize("angles_deg", [(30.0, 60.0), (10.0, 100.0), (2.0, 120.0)])
def test_a_run_ends_the_same_however_wide_that_range_is(angles_deg: tuple[float, float]) -> None:
    """The lens here has 43 to 56 degrees."""
    bounds = BenchBounds(60.0, 2500.0, *angles_deg)
    bench = SyntheticRig(BASE.objects[2], around_the_corner(), changing(4), Faults(noise_px=0.3), seed=4)
    _, answer = run(bench, BASE, dataclasses.replace(SETTINGS, bounds=bounds))
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, "barn")
    assert off(answer, bench)[0] < 40.0
