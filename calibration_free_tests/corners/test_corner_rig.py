"""The corner rig shows what a picture would show, disturbs it as asked, and repeats itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration_free_tests.rigs.conformance import RigConformance
from recognition.geometry import Mount, camera_in_object, camera_in_rig, project, wrap_deg
from recognition.modelbase import ModelBase
from recognition.modelbase_io import load_model_base
from recognition.parts import DetectedPart
from recognition.rates import DetectionRates
from recognition.recogniser import recognise
from recognition.settings import BenchBounds, RecogniserSettings
from recognition.steps import Answer, Outcome, Step
from rig.errors import InputError
from rig.hal import AxisLimits, Rig, RigPose
from sim_backends.corner_noise import CornerNoise
from sim_backends.corner_rig import CornerRig, corner_rig
from sim_backends.renderer import visible_parts
from sim_backends.simulate import draw_scene
from sim_backends.viewpoints import limits_around, viewing_poses

DISTANCES_MM = (150.0, 300.0)
PERFECT = CornerNoise(focal_sd=0.0, aspect_sd=0.0, centre_sd_px=0.0)
SETTINGS = RecogniserSettings(
    bounds=BenchBounds(distance_min_mm=60, distance_max_mm=2000, view_angle_min_deg=15, view_angle_max_deg=70),
    rates=DetectionRates(found=0.97, clutter=0.2, corner_sd_px=0.5),
)


@cache
def base(name: str) -> ModelBase:
    return load_model_base(name)


def make(
    noise: CornerNoise | None = None,
    models: str = "architecture",
    thing: str = "LH",
    distances_mm: tuple[float, ...] = DISTANCES_MM,
) -> CornerRig:
    scene = draw_scene(base(models), thing, 3)
    return corner_rig(scene, base(models).classes, noise, distances_mm=distances_mm, seed=3)


def make_far(noise: CornerNoise, models: str = "architecture", thing: str = "LH") -> CornerRig:
    """From afar, a view shows many parts."""
    return make(noise, models, thing, (600.0,))


def some_poses(rig: CornerRig, count: int = 150) -> list[RigPose]:
    poses = list(rig.reachable())
    return [poses[int(k)] for k in np.random.default_rng(1).permutation(len(poses))[:count]]


class TestCornerRig(RigConformance):
    @pytest.fixture
    def rig(self) -> Rig:
        models = base("architecture")
        scene = draw_scene(models, "GH", 1)
        poses = viewing_poses(scene.object_model, scene.object_in_rig, (250.0,), step_mm=200.0, zooms=(0.0, 1.0))
        return CornerRig(scene, limits_around(poses), poses, models.classes)


# --- what is shown --------------------------------------------------------------------------------------------------


def test_without_noise_detections_are_the_projected_corners() -> None:
    rig = make_far(CornerNoise())
    thing = rig.scene.object_model
    seen = 0
    for pose in some_poses(rig):
        truth = rig.truth(pose)
        to_camera = truth.camera_in_object.to_camera()
        inner = truth.internals
        expected = {
            part.id: project(
                part.corners_mm @ to_camera.rotation.T + to_camera.translation_mm,
                np.array([inner.fx, inner.fy, inner.u0, inner.v0]),
            )
            for part in thing.parts
        }
        shown = {part.id: part.corners_px for part in rig.parts(pose)}
        for name, corners in shown.items():
            np.testing.assert_allclose(corners, expected[name], atol=1e-6)
        assert sorted(map(first_corner, rig.detections(pose))) == sorted(tuple(c[0]) for c in shown.values())
        seen += len(shown)
    assert seen > 300


def first_corner(part: DetectedPart) -> tuple[float, float]:
    return float(part.corners_px[0, 0]), float(part.corners_px[0, 1])


@pytest.mark.parametrize("thing", ["LH", "DS"])
def test_the_parts_shown_are_those_that_a_picture_shows_whole(thing: str) -> None:
    """The painter of pictures is the judge: another way of telling what hides what."""
    rig = make_far(CornerNoise(), thing=thing)
    both = only_here = only_there = 0
    for pose in some_poses(rig, 40):
        painted = visible_parts(rig.scene, camera_in_rig(pose), rig.truth(pose).internals)
        whole = {
            part.id
            for part in painted
            if part.fully_in_frame and part.visible_fraction > 0.995 and part.cos_incidence > 0.2 and part.size_px > 15
        }
        shown = {part.id for part in rig.parts(pose) if part.size_px > 15}
        both, only_here, only_there = (
            both + len(shown & whole),
            only_here + len(shown - whole),
            only_there + len(whole - shown),
        )
    assert both > 60
    assert only_here + only_there < 0.02 * both


def test_scores_name_the_true_class_where_nothing_is_confused() -> None:
    rig = make()
    for pose in some_poses(rig, 40):
        found = Counter(part.part_class for part in rig.detections(pose))
        assert found == Counter(part.part_class for part in rig.parts(pose))


def test_an_empty_picture_of_the_asked_size_takes_no_memory() -> None:
    rig = make()
    image = rig.capture().image
    assert image.shape == (960, 1280)
    assert image.strides == (0, 0)


def test_the_detector_tells_of_the_last_picture() -> None:
    rig = make()
    ahead, behind = (next(pose for pose in some_poses(rig, 500) if len(rig.parts(pose)) == n) for n in (2, 4))
    for pose in (ahead, behind):
        rig.move_to(pose)
        assert tuple(rig.detect(rig.capture().image)) == rig._found
        assert len(rig.detect(rig.capture().image)) == len(rig.parts(pose))


# --- noise ----------------------------------------------------------------------------------------------------------


def all_views(rig: CornerRig) -> tuple[int, list[DetectedPart]]:
    """Parts shown, and detections, of many views together."""
    poses = some_poses(rig, 500)
    return sum(len(rig.parts(pose)) for pose in poses), [found for pose in poses for found in rig.detections(pose)]


def test_the_asked_share_of_parts_is_missed() -> None:
    shown, found = all_views(make_far(CornerNoise(missed=0.2)))
    assert shown > 1000
    assert 1.0 - len(found) / shown == pytest.approx(0.2, abs=0.03)


def test_false_parts_come_per_part_found() -> None:
    shown, found = all_views(make_far(CornerNoise(missed=0.4, false_parts=0.15), "campus", "tower"))
    true = 0.6 * shown
    assert (len(found) - true) / true == pytest.approx(0.15, abs=0.04)
    for part in found:
        assert (part.corners_px >= 0).all()
        assert (part.corners_px <= [1279, 959]).all()


def test_false_parts_are_of_all_classes_and_outlined_like_them() -> None:
    models = base("architecture")
    clean, dirty = make_far(CornerNoise()), make_far(CornerNoise(false_parts=1.0))
    corners = {kind.name: kind.corner_count for kind in models.classes}
    false = [
        part
        for pose in some_poses(clean)
        for part in dirty.detections(pose)
        if first_corner(part) not in {first_corner(true) for true in clean.detections(pose)}
    ]
    assert {part.part_class for part in false} == set(corners)
    assert all(len(part.corners_px) == corners[part.part_class] for part in false)


def test_the_asked_share_of_classes_is_wrong_among_classes_with_as_many_corners() -> None:
    rig = make_far(CornerNoise(class_errors=0.1))
    corners = {kind.name: kind.corner_count for kind in base("architecture").classes}
    wrong = total = 0
    for pose in some_poses(rig, 500):
        true = {tuple(part.corners_px[0]): part.part_class for part in rig.parts(pose)}
        for part in rig.detections(pose):
            told, real = part.part_class, true[first_corner(part)]
            assert corners[told] == corners[real]
            total += corners[real] == 4
            wrong += told != real and corners[real] == 4
    assert total > 800
    assert wrong / total == pytest.approx(0.1, abs=0.025)


def test_where_no_other_class_has_as_many_corners_an_error_is_doubt() -> None:
    rig = make_far(CornerNoise(class_errors=0.5), "campus", "tower")
    scores = [part.class_scores["DW4"] for pose in some_poses(rig, 60) for part in rig.detections(pose)]
    assert set(scores) == {0.95, 0.3}
    assert np.mean(np.array(scores) < 0.5) == pytest.approx(0.5, abs=0.06)


def test_corners_scatter_as_asked() -> None:
    clean, noisy = make_far(CornerNoise()), make_far(CornerNoise(corner_sd_px=1.0))
    gaps = []
    for pose in some_poses(clean):
        true = np.array([part.corners_px[0] for part in clean.parts(pose)]).reshape(-1, 2)
        for part in noisy.detections(pose):
            off = part.corners_px[0] - true
            gaps.append(off[np.abs(off).max(axis=1).argmin()])
            assert part.sigma_px == 1.0
    assert np.std(gaps) == pytest.approx(1.0, abs=0.08)


def test_the_true_pose_is_off_by_the_motion_error_and_the_one_read_back_is_not() -> None:
    rig = make(CornerNoise(motion_theta_sd_deg=1.0, motion_sd_mm=5.0))
    mm, deg = [], []
    for pose in some_poses(rig, 400):
        assert rig.move_to(pose) == pose == rig.capture().rig_pose
        told = camera_in_object(camera_in_rig(pose), rig.scene.object_in_rig)
        real = rig.truth().camera_in_object
        mm.append(real.centre_mm - told.centre_mm)
        deg.append(wrap_deg(real.theta_deg - told.theta_deg))
    assert np.std(mm, axis=0) == pytest.approx([5.0] * 3, abs=0.6)
    assert np.std(deg) == pytest.approx(1.0, abs=0.12)


def test_axes_that_cannot_move_have_no_motion_error() -> None:
    models = base("architecture")
    scene = draw_scene(models, "GH", 1)
    still, arm = AxisLimits(0.0, 0.0, 100.0), Mount(z_mm=-3000.0)
    limits = replace(limits_around([RigPose(0, 0, 0, 0)]), x_mm=still, y_mm=still, z_mm=still)
    noise = CornerNoise(motion_theta_sd_deg=1.0, motion_sd_mm=5.0)
    poses = [RigPose(0.0, 0.0, 0.0, float(turn)) for turn in range(0, 180, 30)]
    rig = CornerRig(scene, limits, poses, models.classes, noise, mount=arm)
    for pose in poses:
        told = camera_in_object(camera_in_rig(pose, arm), scene.object_in_rig)
        turned = np.radians(wrap_deg(rig.truth(pose).camera_in_object.theta_deg - told.theta_deg))
        gap = np.linalg.norm(rig.truth(pose).camera_in_object.centre_mm - told.centre_mm)
        assert gap == pytest.approx(2 * 3000.0 * abs(np.sin(turned / 2)), abs=1e-6)
        assert turned != 0.0


def test_internals_differ_in_every_view_unless_asked_not_to() -> None:
    rig = make()
    assert not rig.internals_fixed_by_zoom
    drawn = [rig.truth(pose).internals for pose in some_poses(rig)]
    assert len(set(drawn)) == len(drawn)
    still = make(PERFECT)
    assert len({still.truth(pose).internals for pose in some_poses(still) if pose.zoom == 0.0}) == 1
    assert still.internals_fixed_by_zoom


@pytest.mark.parametrize(
    ("values", "said"),
    [({"missed": 1.2}, "missed: 1.2 is not a share"), ({"corner_sd_px": float("nan")}, "corner_sd_px: nan is not")],
)
def test_noise_that_makes_no_sense_is_refused(values: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        CornerNoise(**values)


# --- repeating itself -----------------------------------------------------------------------------------------------

FIELD = CornerNoise(
    missed=0.2, false_parts=0.05, class_errors=0.02, corner_sd_px=1.0, motion_theta_sd_deg=1.0, motion_sd_mm=5.0
)


def outlines(parts: Sequence[DetectedPart]) -> list[tuple[object, ...]]:
    return [(part.corners_px.tobytes(), *sorted(part.class_scores.items())) for part in parts]


def test_a_view_depends_on_seed_and_pose_but_not_on_the_views_before_it() -> None:
    one, other = make_far(FIELD), make_far(FIELD)
    poses = some_poses(one, 12)
    last = next(pose for pose in poses if len(one.parts(pose)) > 3)
    for pose in [*poses, last]:
        one.move_to(pose)
        one.capture()
    other.move_to(last)
    assert outlines(one.detect(one.capture().image)) == outlines(other.detect(other.capture().image))
    assert one.truth() == other.truth()


def test_another_seed_is_another_noise() -> None:
    scene = draw_scene(base("architecture"), "LH", 3)
    rigs = [corner_rig(scene, base("architecture").classes, FIELD, distances_mm=DISTANCES_MM, seed=s) for s in (1, 2)]
    pose = next(pose for pose in some_poses(rigs[0]) if len(rigs[0].parts(pose)) > 3)
    assert outlines(rigs[0].detections(pose)) != outlines(rigs[1].detections(pose))


# --- recognising ----------------------------------------------------------------------------------------------------


def run(rig: CornerRig, models: str) -> tuple[list[Step], Answer]:
    poses = list(rig.reachable())
    order = np.random.default_rng(4).permutation(len(poses))
    rig.move_to(next(poses[int(k)] for k in order if len(rig.parts(poses[int(k)])) >= 2))
    loop = recognise(rig, base(models), SETTINGS, detector=rig)
    steps: list[Step] = []
    while True:
        try:
            steps.append(next(loop))
        except StopIteration as end:
            return steps, end.value


@pytest.mark.parametrize(("models", "thing"), [("architecture", "LH"), ("campus", "library")])
def test_a_building_without_noise_is_recognised_and_the_camera_placed(models: str, thing: str) -> None:
    rig = make(models=models, thing=thing)
    steps, answer = run(rig, models)
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, thing)
    assert answer.pose is not None
    true = rig.truth(steps[-1].frame.rig_pose).camera_in_object
    assert np.linalg.norm(answer.pose.centre_mm - true.centre_mm) < 20.0
    assert abs(wrap_deg(answer.pose.theta_deg - true.theta_deg)) < 5.0


def test_the_same_seed_gives_the_same_run() -> None:
    (first, one), (second, other) = (run(make(FIELD), "architecture") for _ in range(2))
    assert [step.frame.rig_pose for step in first] == [step.frame.rig_pose for step in second]
    assert [step.belief.posterior for step in first] == [step.belief.posterior for step in second]
    assert one == other
