"""A trial is drawn from its seed alone, on the bench and before the object that its conditions say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.evaluate.sample import small_plan
from rig.evaluate.bound import least_views
from rig.evaluate.plan import Row, Task
from rig.evaluate.plan_file import NoiseEntry, RowEntry, ToldEntry
from rig.evaluate.staging import Stage, model_base, staged
from sim_backends.corner_rig import CornerRig
from sim_backends.scenes.stranger import stranger

CONDITIONS = RowEntry(name="a", models=("architecture",), noise=NoiseEntry(missed=0.2, corner_sd_px=1.0))


def stage(seed: int = 4, policy: str = "information", **changes: object) -> Stage:
    return staged(Task(Row("architecture", policy, CONDITIONS.model_copy(update=changes)), 0, seed))


def test_policies_meet_the_same_trial() -> None:
    one, other = stage(policy="information"), stage(policy="random")
    assert isinstance(one.rig, CornerRig)
    assert isinstance(other.rig, CornerRig)
    assert (one.true_object, one.rig.pose, one.rig.truth()) == (other.true_object, other.rig.pose, other.rig.truth())
    first, second = (rig.detect(rig.capture().image) for rig in (one.rig, other.rig))
    assert [part.corners_px.tobytes() for part in first] == [part.corners_px.tobytes() for part in second]
    assert (one.settings.policy, other.settings.policy) == ("information", "random")


def test_another_seed_is_another_trial() -> None:
    starts = {(stage(seed).true_object, stage(seed).rig.pose) for seed in range(4)}
    assert len(starts) == 4


def test_the_first_view_shows_a_whole_part() -> None:
    for seed in range(5):
        assert stage(seed).rig.parts()


def test_the_recogniser_is_told_the_noise_unless_told_otherwise() -> None:
    told = stage(noise=NoiseEntry(missed=0.3, false_parts=0.2, motion_sd_mm=4.0)).settings
    assert (told.rates.found, told.rates.clutter, told.bounds.motion_sd_mm) == (0.7, 1.0, 4.0)
    other = stage(told=ToldEntry(found=0.5, motion_sd_mm=0.0)).settings
    assert (other.rates.found, other.rates.corner_sd_px, other.bounds.motion_sd_mm) == (0.5, 1.0, 0.0)
    assert told.effort.second_looks == 0


def test_pictures_come_with_a_detector_of_their_own() -> None:
    rendered = stage(views="rendered", noise=None, clutter=True)
    assert rendered.detector is None
    assert rendered.rig.scene.clutter
    assert rendered.rig.capture().image.any()
    assert not stage(views="rendered", noise=None).rig.scene.clutter


# --- one axis -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", ["architecture", "campus"])
def test_a_turntable_moves_its_rotary_alone_and_keeps_the_whole_object_in_view(base: str) -> None:
    task = Task(Row(base, "information", CONDITIONS.model_copy(update={"bench": "one_axis"})), 0, 4)
    set_up = staged(task)
    poses = set_up.rig.reachable()
    assert {(pose.x_mm, pose.y_mm, pose.z_mm, pose.zoom) for pose in poses} == {(0.0, 0.0, 0.0, 0.0)}
    assert len({pose.theta_deg for pose in poses}) == len(poses) == 24
    points = np.concatenate([part.corners_mm for part in set_up.rig.scene.object_model.parts])
    for pose in poses:
        truth = set_up.rig.truth(pose)
        to_camera = truth.camera_in_object.to_camera()
        pixels = truth.internals.pixels(points @ to_camera.rotation.T + to_camera.translation_mm)
        inside = ((pixels >= 0) & (pixels <= np.array(set_up.rig.size) - 1)).all(axis=1)
        # The lens changes by 5 % and its centre by 40 px in every view.
        assert inside.mean() > 0.95
        assert (
            set_up.settings.bounds.distance_min_mm < depth(to_camera.rotation, to_camera.translation_mm, points)
        ).all()


def depth(rotation: np.ndarray, shift: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray((points @ rotation.T + shift)[:, 2])


# --- strangers ------------------------------------------------------------------------------------------------------


def test_a_stranger_shares_four_fifths_of_its_parts_places() -> None:
    thing = model_base("campus").object("library")
    other = stranger(thing, np.random.default_rng(1))
    gone = np.array([np.abs(a.corners_mm - b.corners_mm).max() for a, b in zip(thing.parts, other.parts, strict=True)])
    assert (gone == 0).mean() == pytest.approx(0.8, abs=0.005)
    assert (gone[gone > 0] > 10.0).all()
    assert other.id != thing.id
    assert other.id not in {known.id for known in model_base("campus").objects}


def test_no_part_of_a_stranger_lies_on_another_nor_off_its_wall() -> None:
    other = stranger(model_base("architecture").object("DS"), np.random.default_rng(2))
    faces = {face.id: face.corners_mm for face in other.faces}
    boxes: dict[str, list[np.ndarray]] = {}
    for part in other.parts:
        assert part.face is not None
        a, b, _, d = faces[part.face]
        axes = np.stack([(b - a) / np.linalg.norm(b - a), (d - a) / np.linalg.norm(d - a)], axis=1)
        flat = (part.corners_mm - a) @ axes
        low, high = flat.min(axis=0), flat.max(axis=0)
        assert (low >= 0).all()
        assert (high <= [np.linalg.norm(b - a), np.linalg.norm(d - a)]).all()
        for other_low, other_high in boxes.get(part.face, []):
            assert ((low >= other_high) | (high <= other_low)).any()
        boxes.setdefault(part.face, []).append(np.stack([low, high]))


def test_a_stranger_stands_before_the_rig_and_is_not_in_the_base() -> None:
    open_set = stage(object="stranger")
    assert not open_set.in_base
    assert open_set.true_object not in {thing.id for thing in open_set.base.objects}
    assert open_set.rig.scene.object_model.id == open_set.true_object


# --- the bound ------------------------------------------------------------------------------------------------------


def test_two_objects_that_look_the_same_need_a_second_view(tmp_path: Path) -> None:
    from calibration_free_tests.recognition.synthetic import base_of, building
    from recognition.modelbase_write import model_base_to_yaml

    one = building("one", 0)
    alone, twins = tmp_path / "alone.yaml", tmp_path / "twins.yaml"
    alone.write_text(model_base_to_yaml(base_of(one), "one"))
    twins.write_text(model_base_to_yaml(base_of(one, replace(one, id="two")), "two"))
    assert 1.0 <= least_views(str(alone), "one_axis") < 2.0
    # Every view of one is a view of the other.
    assert least_views(str(twins), "one_axis") == pytest.approx(2.0)


def test_small_plan_is_read_with_its_model_base(tmp_path: Path) -> None:
    assert len(model_base(small_plan(tmp_path).rows[0].source).objects) == 3
