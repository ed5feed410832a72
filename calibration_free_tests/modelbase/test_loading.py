"""What a model base file says is what is loaded, in every form that it may take, and writing gives it back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.modelbase.test_degenerate_parts import sound
from recognition.geometry import rotation_y
from recognition.modelbase import Face, ModelBase, ObjectModel, Part
from recognition.modelbase_io import describe, load_model_base, parse_model_base
from recognition.modelbase_write import model_base_to_yaml
from recognition.part_classes import BUILT_IN_CLASSES
from recognition.part_rules import POLYGON_RULES, misses_its_outline, starts_at_the_wrong_corner

LOCAL = [[-15, -20, 0], [15, -20, 0], [15, 20, 0], [-15, 20, 0]]


def part(name: str, part_id: str = "p", shift: int = 0) -> str:
    corners = [[shift, 0, 0], [shift + 30, 0, 0], [shift + 30, 40, 0], [shift, 40, 0]]
    return f"  - {{id: {part_id}, class: {name}, corners_mm: {corners}}}\n"


@given(st.floats(-180, 180), st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3))
def test_a_local_frame_with_a_pose_gives_the_same_corners_as_the_object_frame(turn: float, shift: list[float]) -> None:
    rotation = rotation_y(np.radians(turn))
    entry = {
        "id": "p",
        "class": "DW4",
        "vertices_mm": LOCAL,
        "pose": {"rotation": rotation.tolist(), "translation_mm": shift},
    }
    base = parse_model_base("objects:\n- id: o\n  parts: [" + json.dumps(entry) + "]\n")
    np.testing.assert_allclose(base.objects[0].parts[0].corners_mm, np.array(LOCAL) @ rotation.T + shift, atol=1e-9)


def test_a_window_may_be_darker_or_brighter_unless_open_ones_are_told_apart_by_that() -> None:
    def bright(text: str) -> dict[str, bool | None]:
        return {known.name: known.bright for known in parse_model_base(text).classes}

    head = "objects:\n- id: o\n  parts:\n"
    both = head + part("DW4") + part("OPEN", "q", 70)
    assert bright(head + part("DW4")) == {"DW4": None}
    assert bright(both) == {"DW4": False, "OPEN": True}
    assert bright("classes: [{name: DW4, bright: null}]\n" + both) == {"DW4": None, "OPEN": True}
    assert bright("classes: [{name: DW4, bright: true}]\n" + head + part("DW4")) == {"DW4": True}


def test_an_overridden_class_keeps_its_built_in_outline() -> None:
    corners = (np.array(BUILT_IN_CLASSES["DW8T"].canonical) * 40).tolist()
    points = json.dumps([[x, y, 0] for x, y in corners])
    part_line = f"{{id: p, class: DW8T, corners_mm: {points}}}"
    text = f"classes: [{{name: DW8T, bright: true}}]\nobjects: [{{id: o, parts: [{part_line}]}}]"
    (loaded,) = parse_model_base(text).classes
    assert loaded.bright is True
    np.testing.assert_array_equal(loaded.canonical, BUILT_IN_CLASSES["DW8T"].canonical)


def test_a_class_of_the_file_may_have_its_own_outline() -> None:
    text = (
        "classes:\n- {name: PENTAGON, bright: null, corners: [[0, 0.5], [0.5, 0], [1, 0.5], [1, 1], [0, 1]]}\n"
        "objects:\n- id: o\n  parts:\n  - {id: p, class: PENTAGON, corners_mm: "
        "[[0, 20, 0], [20, 0, 0], [40, 20, 0], [40, 40, 0], [0, 40, 0]]}\n"
    )
    assert [(c.name, c.corner_count, c.bright) for c in parse_model_base(text).classes] == [("PENTAGON", 5, None)]


def test_classes_that_no_part_uses_are_left_out() -> None:
    text = "classes: [{name: DOOR}]\nobjects:\n- id: o\n  parts:\n" + part("DW4")
    assert [known.name for known in parse_model_base(text).classes] == ["DW4"]


@pytest.mark.parametrize("name", [n for n, known in BUILT_IN_CLASSES.items() if known.canonical is not None])
def test_built_in_outlines_keep_the_rules_and_differ_from_all_others(name: str) -> None:
    outline = np.asarray(BUILT_IN_CLASSES[name].canonical)
    flat = np.column_stack([outline, np.zeros(len(outline))])[None]
    assert not any(rule.broken(flat)[0] for rule in POLYGON_RULES)
    assert not starts_at_the_wrong_corner(flat, outline)[0]
    assert BUILT_IN_CLASSES[name].corner_count == len(outline)
    for other in BUILT_IN_CLASSES.values():
        if other.name != name and other.canonical is not None and other.corner_count == len(outline):
            turned = [np.roll(other.canonical, k, axis=0) for k in range(len(outline))]
            assert all(misses_its_outline(flat, t)[0] or starts_at_the_wrong_corner(flat, t)[0] for t in turned)


def test_loaded_arrays_cannot_be_changed() -> None:
    corners = parse_model_base("objects:\n- id: o\n  parts:\n" + part("DW4")).objects[0].parts[0].corners_mm
    with pytest.raises(ValueError, match="read-only"):
        corners[0, 0] = 1.0


ids = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=12)
traps = st.sampled_from(
    ["on", "null", "010", "1:30", "1e3", "yes", "~", "a: b", "- x", "#", "'", '"', "\\", "\u2028", "😀"]
)


@st.composite
def model_bases(draw: st.DrawFn) -> ModelBase:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    objects = []
    for object_id in draw(st.lists(ids | traps, min_size=1, max_size=3, unique=True)):
        names = draw(st.lists(ids | traps, min_size=1, max_size=5, unique=True))
        kinds = st.sampled_from(sorted(BUILT_IN_CLASSES))
        looks = st.none() | ids
        parts = []
        for name in names:
            kind, recess = draw(kinds), draw(st.floats(0, 9))
            parts.append(Part(name, kind, np.round(sound(kind, rng), 3), None, draw(looks), round(recess, 3)))
        face = Face("wall", np.round(10 * sound("DW4", rng), 3))
        objects.append(ObjectModel(object_id, tuple(parts), (face,)))
    used = {part.part_class for thing in objects for part in thing.parts}
    classes = tuple(known for known in BUILT_IN_CLASSES.values() if known.name in used)
    return ModelBase(tuple(objects), classes, draw(ids | traps))


@settings(max_examples=60, deadline=None)
@given(model_bases())
def test_writing_then_loading_gives_the_model_base_back(base: ModelBase) -> None:
    text = model_base_to_yaml(base, "a comment\nof two lines")
    again = parse_model_base(text)
    assert model_base_to_yaml(again, "a comment\nof two lines") == text
    assert again.name == base.name
    assert [(c.name, c.bright, c.corner_count) for c in again.classes] == [
        (c.name, c.bright, c.corner_count) for c in base.classes
    ]
    for thing, other in zip(base.objects, again.objects, strict=True):
        assert thing.id == other.id
        np.testing.assert_allclose(thing.faces[0].corners_mm, other.faces[0].corners_mm, atol=1e-9)
        for one, two in zip(thing.parts, other.parts, strict=True):
            assert (one.id, one.part_class, one.look, one.recess_mm) == (
                two.id,
                two.part_class,
                two.look,
                two.recess_mm,
            )
            np.testing.assert_allclose(one.corners_mm, two.corners_mm, atol=1e-9)


def test_a_file_is_named_by_its_stem_unless_it_says_otherwise(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("objects:\n- id: o\n  parts:\n" + part("DW4"))
    assert load_model_base(file).name == "mine"
    file.write_text("name: other\n" + file.read_text())
    assert load_model_base(str(file)).name == "other"
    assert describe(load_model_base(file)).by_object_and_class == {"o": {"DW4": 1}}
