"""The shipped model bases have the paper's counts, come from their generators, and look alike only close by."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from itertools import pairwise
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

from recognition.modelbase import ModelBase, ObjectModel
from recognition.modelbase_file import json_schema
from recognition.modelbase_io import describe, load_model_base, shipped_model_bases
from sim_backends.scenes import architecture
from sim_backends.scenes.ship import shipped_texts
from sim_backends.scenes.surroundings import differences, share_with_a_twin

DATA = Path(str(resources.files("rig"))) / "data"
NAMES = ("architecture", "campus")


@cache
def shipped(name: str) -> ModelBase:
    return load_model_base(name)


def test_both_model_bases_ship() -> None:
    assert set(NAMES) <= set(shipped_model_bases())


def test_architecture_has_the_counts_of_the_paper() -> None:
    counts = describe(shipped("architecture"))
    assert counts.by_object == {"LH": 167, "DS": 170, "GH": 122}
    assert counts.by_class == {
        **{"DW4": 374, "DW6L": 24, "DW6R": 24, "OPEN": 21},
        **{"DW8HANDLE": 6, "DW8T": 6, "DW12": 4},
    }


def test_every_class_is_found_in_every_object_of_the_architecture() -> None:
    assert all(len(found) == 7 for found in describe(shipped("architecture")).by_object_and_class.values())


def test_campus_has_1979_windows_of_one_kind_and_size_in_eight_buildings() -> None:
    counts = describe(shipped("campus"))
    assert counts.by_class == {"DW4": 1979}
    assert len(counts.by_object) == 8
    sizes = {tuple(np.round(np.ptp(p.corners_mm, axis=0)[[0, 2]].max(keepdims=True), 6)) for p in all_parts("campus")}
    assert sizes == {(30.0,)}
    assert {round(float(np.ptp(p.corners_mm[:, 1])), 6) for p in all_parts("campus")} == {40.0}


def all_parts(name: str) -> list[object]:
    return [part for thing in shipped(name).objects for part in thing.parts]


def test_shipped_files_are_what_the_generators_give_for_their_seed() -> None:
    for name, text in shipped_texts().items():
        assert (DATA / name).read_text(encoding="utf-8") == text, f"run python -m sim_backends.scenes.ship ({name})"


def test_other_seeds_give_other_buildings_with_the_same_counts() -> None:
    one, other = architecture.generate(1), architecture.generate(2)
    assert describe(one).by_object_and_class == describe(other).by_object_and_class
    assert architecture.to_yaml(1) != architecture.to_yaml(2)


@pytest.mark.parametrize("name", NAMES)
def test_no_two_places_have_the_same_surroundings(name: str) -> None:
    # Within four bays; and by two parts at least, so that one missed part does not make two places the same.
    unlike = differences(shipped(name).objects, 280.0)
    np.fill_diagonal(unlike, 99)
    assert unlike.min() >= 2


@pytest.mark.parametrize(("name", "cross", "block"), [("architecture", 0.75, 0.55), ("campus", 0.95, 0.9)])
def test_most_close_ups_are_found_in_another_object_too(name: str, cross: float, block: float) -> None:
    objects = shipped(name).objects
    assert share_with_a_twin(objects, 85.0, in_another_object=True) >= cross
    assert share_with_a_twin(objects, 110.0, in_another_object=True) >= block


def test_two_campus_buildings_share_four_fifths_of_their_layout() -> None:
    base = shipped("campus")
    one, other = ({tuple(p.centre_mm.round(1)) for p in base.object(name).parts} for name in ("physics", "annex"))
    assert 0.75 <= len(one & other) / len(one) <= 0.85


@pytest.mark.parametrize("name", NAMES)
def test_parts_overlap_neither_each_other_nor_the_edges_of_their_wall(name: str) -> None:
    for thing in shipped(name).objects:
        for face in thing.faces:
            along = (face.corners_mm[1] - face.corners_mm[0]) / np.linalg.norm(face.corners_mm[1] - face.corners_mm[0])
            flat = [
                np.column_stack([p.corners_mm @ along, p.corners_mm[:, 1]]) for p in thing.parts if p.face == face.id
            ]
            low, high = np.array([f.min(axis=0) for f in flat]), np.array([f.max(axis=0) for f in flat])
            wall = np.column_stack([face.corners_mm @ along, face.corners_mm[:, 1]])
            assert (low > wall.min(axis=0) + 5).all()
            assert (high < wall.max(axis=0) - 5).all()
            clear = ((low[:, None] > high[None] + 5) | (high[:, None] < low[None] - 5)).any(axis=2)
            np.fill_diagonal(clear, True)
            assert clear.all()


@pytest.mark.parametrize("name", NAMES)
def test_walls_stand_on_the_ground_face_outwards_and_follow_each_other(name: str) -> None:
    for thing in shipped(name).objects:
        feet = [face.corners_mm[[3, 2]] for face in thing.faces]
        assert all(np.all(foot[:, 1] == 0) for foot in feet)
        assert all(np.array_equal(one[1], two[0]) for one, two in pairwise([*feet, feet[0]]))
        outline = np.array([foot[0, [0, 2]] for foot in feet])
        after = np.roll(outline, -1, axis=0)
        assert (outline[:, 0] * after[:, 1] - outline[:, 1] * after[:, 0]).sum() > 0
        assert max(np.ptp(outline, axis=0)) <= 1200


def test_courtyards_leave_room_for_the_camera() -> None:
    for name, thing in [("architecture", "DS"), ("campus", "physics"), ("campus", "annex")]:
        court = next(face for face in shipped(name).object(thing).faces if face.id == "front2")
        assert np.linalg.norm(court.corners_mm[1] - court.corners_mm[0]) >= 500


@pytest.mark.parametrize("name", NAMES)
def test_recesses_are_three_to_eight_millimetres(name: str) -> None:
    assert all(3 <= part.recess_mm <= 8 for thing in shipped(name).objects for part in thing.parts)


def test_the_published_schema_is_current_and_is_a_schema() -> None:
    published = json.loads((DATA / "modelbase.schema.json").read_text())
    assert published == json_schema()
    jsonschema.Draft202012Validator.check_schema(published)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_model_bases_fit_the_published_schema(name: str) -> None:
    fits_schema(DATA / f"{name}.yaml")


@pytest.mark.realdata
def test_the_castle_fits_the_published_schema(real_data: Path) -> None:
    fits_schema(real_data / "castle" / "modelbase.yaml")


def fits_schema(file: Path) -> None:
    published = json.loads((DATA / "modelbase.schema.json").read_text())
    data = yaml.load(file.read_text(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    # Every object, but only some parts of each: jsonschema is slow, and parts are all written alike.
    for thing in data["objects"]:
        thing["parts"] = thing["parts"][::10]
    jsonschema.Draft202012Validator(published).validate(data)
    del data["objects"][0]["parts"][0]["corners_mm"]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(published).validate(data)


def test_a_wall_of_a_generated_object_is_where_its_parts_are() -> None:
    thing: ObjectModel = shipped("architecture").object("DS")
    for part in thing.parts:
        face = next(face for face in thing.faces if face.id == part.face)
        assert abs((part.corners_mm - face.corners_mm[0]) @ part.normal).max() < 1e-9
