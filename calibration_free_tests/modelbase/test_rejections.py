"""Model bases that would give confident nonsense are refused, naming the line."""

from __future__ import annotations

from pathlib import Path

import pytest

from recognition.modelbase_io import load_model_base, parse_model_base
from rig.errors import InputError, ModelBaseError

GOOD_CORNERS = "[[0, 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]]"
OTHER_CORNERS = "[[70, 0, 0], [100, 0, 0], [100, 40, 0], [70, 40, 0]]"
WALL = "[[-50, -50, 0], [150, -50, 0], [150, 90, 0], [-50, 90, 0]]"
NOTCHED = "[[0, 0, 0], [30, 0, 0], [30, 17, 0], [23, 17, 0], [23, 24, 0], [30, 24, 0], [30, 40, 0], [0, 40, 0]]"


def base(second: str = f"{{id: b, class: DW4, corners_mm: {OTHER_CORNERS}}}", more: str = "") -> str:
    """A model base whose part under test stands in line 5; ``more`` follows it, within the object."""
    first = f"{{id: a, class: DW4, face: f, corners_mm: {GOOD_CORNERS}}}"
    return f"objects:\n- id: one\n  parts:\n  - {first}\n  - {second}\n{more}"


def part(corners: str, name: str = "DW4", extra: str = "") -> str:
    return f"{{id: b, class: {name}, {extra}corners_mm: {corners}}}"


def posed(rotation: str, translation: str = "[70, 0, 0]") -> str:
    pose = f"{{rotation: {rotation}, translation_mm: {translation}}}"
    return f"{{id: b, class: DW4, vertices_mm: {GOOD_CORNERS}, pose: {pose}}}"


def refusal(text: str) -> ModelBaseError:
    with pytest.raises(ModelBaseError) as caught:
        parse_model_base(text, "m.yaml")
    return caught.value


def test_the_base_that_the_others_are_variants_of_is_good() -> None:
    assert [p.id for p in parse_model_base(base()).objects[0].parts] == ["a", "b"]
    assert parse_model_base(base(posed("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"))).objects[0].parts[1].corners_mm[0, 0] == 70
    parse_model_base(base(part(NOTCHED, "DW8HANDLE")))


REFUSED: dict[str, tuple[str, str]] = {
    "three corners": (part("[[0, 0, 0], [30, 0, 0], [30, 40, 0]]"), "needs at least 4 entries, has 3"),
    "two-dimensional corners": (part("[[0, 0], [30, 0], [30, 40], [0, 40]]"), "entry 3 is missing"),
    "repeated corner": (part("[[0, 0, 0], [30, 0, 0], [30, 40, 0], [30, 40, 0]]"), "same place"),
    "repeated corner, not a neighbour": (part("[[0, 0, 0], [30, 0, 0], [0, 0, 0], [0, 40, 0]]"), "same place"),
    "all corners the same": (part("[[1, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 1]]"), "same place"),
    "collinear corners": (part("[[0, 0, 0], [10, 0, 0], [20, 0, 0], [30, 0, 0]]"), "lie on one line"),
    "a triangle": (part("[[0, 0, 0], [15, 0, 0], [30, 0, 0], [15, 40, 0]]"), "three neighbouring corners"),
    "a spike": (part("[[0, 0, 0], [30, 0, 0], [30, 40, 0], [30, 20, 0]]"), "three neighbouring corners"),
    "bent": (part("[[0, 0, 0], [30, 0, 0], [30, 40, 9], [0, 40, 0]]"), "leave their plane"),
    "crossing sides": (part("[[0, 0, 0], [30, 40, 0], [30, 0, 0], [0, 40, 0]]"), "cross each other"),
    "first corner wrong": (part("[[30, 0, 0], [30, 40, 0], [0, 40, 0], [0, 0, 0]]"), "do not start at the top-left"),
    "anticlockwise": (part("[[0, 0, 0], [0, 40, 0], [30, 40, 0], [30, 0, 0]]"), "run anticlockwise"),
    "anticlockwise from the top-right": (
        part("[[30, 0, 0], [0, 0, 0], [0, 40, 0], [30, 40, 0]]", extra="face: f, "),
        "as seen from outside the face 'f' the corners run anticlockwise",
    ),
    "too many corners": (part(NOTCHED), "8 corners, but the class 'DW4' has 4"),
    "too few corners": (part(GOOD_CORNERS, "DW12"), "4 corners, but the class 'DW12' has 12"),
    "other outline": (part(NOTCHED, "DW8T"), "do not have the outline of the class 'DW8T'"),
    "no such class": (part(GOOD_CORNERS, "DW8HANDEL"), "no class 'DW8HANDEL'. Did you mean 'DW8HANDLE'?"),
    "part id twice": (f"{{id: a, class: DW4, corners_mm: {OTHER_CORNERS}}}", "'a' stands twice. It stands at m.yaml:4"),
    "not a number": (part("[[.nan, 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]]"), "not a finite number"),
    "infinite": (part("[[1e999, 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]]"), "too large"),
    "huge": (part("[[1e300, 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]]"), "less than or equal to 1000000000"),
    "text": (part("[['0', 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]]"), "should be a number"),
    "one part in metres": (part("[[0, 0, 0], [0.03, 0, 0], [0.03, 0.04, 0], [0, 0.04, 0]]"), "another unit"),
    "stretched rotation": (posed("[[1.001, 0, 0], [0, 1, 0], [0, 0, 1]]"), "no rotation"),
    "skewed rotation": (posed("[[1, 0.01, 0], [0, 1, 0], [0, 0, 1]]"), "no rotation"),
    "rounded rotation": (posed("[[0.866, 0, 0.5], [0, 1, 0], [-0.5, 0, 0.866]]"), "no rotation"),
    "reflection": (posed("[[1, 0, 0], [0, 1, 0], [0, 0, -1]]"), "reflection"),
    "rotation of zeros": (posed("[[0, 0, 0], [0, 0, 0], [0, 0, 0]]"), "no rotation"),
    "no corners": ("{id: b, class: DW4}", "give either corners_mm, or vertices_mm together with pose"),
    "vertices without pose": (f"{{id: b, class: DW4, vertices_mm: {GOOD_CORNERS}}}", "give either"),
    "both forms": (part(GOOD_CORNERS, extra=f"vertices_mm: {GOOD_CORNERS}, "), "give either"),
    "negative recess": (part(GOOD_CORNERS, extra="recess_mm: -1, "), "greater than or equal to 0"),
    "unknown key": (part(GOOD_CORNERS, extra="recces_mm: 1, "), "unknown key. Did you mean 'recess_mm'?"),
    "empty id": (f"{{id: '', class: DW4, corners_mm: {GOOD_CORNERS}}}", "at least 1 character"),
    "no class": (f"{{id: b, corners_mm: {GOOD_CORNERS}}}", "class: this key is missing"),
}


@pytest.mark.parametrize(("second", "words"), REFUSED.values(), ids=REFUSED.keys())
def test_an_unusable_part_is_refused_naming_its_line(second: str, words: str) -> None:
    error = refusal(base(second))
    assert all(line.startswith("m.yaml:5:") for line in str(error).splitlines())
    assert words in str(error)


FACES = f"  faces:\n  - {{id: f, corners_mm: {WALL}}}\n"


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (base(part(OTHER_CORNERS, extra="face: g, "), FACES), 5, "no face 'g'. Known here: f."),
        (base(part(OTHER_CORNERS.replace(", 0]", ", 20]"), extra="face: f, "), FACES), 5, "20 mm off its face"),
        (base(more=FACES + f"  - {{id: f, corners_mm: {WALL}}}\n"), 8, "the face 'f' stands twice"),
        (base(more=FACES.replace("150, -50, 0", "150, 90, 0")), 7, "same place"),
        (base(more=f"- id: one\n  parts: [{part(GOOD_CORNERS)}]\n"), 6, "the object 'one' stands twice"),
        (base(more="- id: two\n  parts: []\n"), 7, "needs at least 1 entries"),
        (base(more="classes:\n- {name: X}\n- {name: X}\n"), 8, "the class 'X' stands twice"),
        (base(more="classes:\n- {name: X, corners: [[0, 0], [1, 0], [1, 1]]}\n"), 7, "at least 4"),
        (base(more="classes:\n- {name: X, corners: [[0, 0], [1, 0], [1, 2], [0, 1]]}\n"), 7, "less than or equal to 1"),
        (base(more="classes:\n- {name: X, corners: [[0, 0], [0, 1], [1, 1], [1, 0]]}\n"), 7, "runs anticlockwise"),
        (base(more="classes:\n- {name: X, corners: [[0, 0], [1, 1], [1, 0], [0, 1]]}\n"), 7, "cross each other"),
        ("objects: []\n", 1, "at least 1"),
        ("parts: []\n", 1, "unknown key"),
        ("version: 2\n" + base(), 1, "should be 1"),
    ],
)
def test_a_broken_object_face_or_class_is_refused_naming_its_line(text: str, line: int, words: str) -> None:
    error = refusal(text)
    assert str(error).startswith(f"m.yaml:{line}:")
    assert words in str(error)


@pytest.mark.parametrize(
    ("scale", "words"), [(0.001, "looks like metres"), (0.03937, "looks like metres"), (1e5, "looks like another unit")]
)
def test_another_unit_is_noticed_at_the_object(scale: float, words: str) -> None:
    corners = [[0, 0, 0], [30 * scale, 0, 0], [30 * scale, 40 * scale, 0], [0, 40 * scale, 0]]
    error = refusal(f"objects:\n- id: one\n  parts:\n  - {{id: a, class: DW4, corners_mm: {corners}}}\n")
    assert str(error).startswith("m.yaml:2:3: objects[0]: ")
    assert words in str(error)


def test_all_unusable_parts_are_told_at_once_in_the_order_of_the_file() -> None:
    bad = REFUSED["crossing sides"][0].replace("id: b", "id: c")
    lines = str(refusal(base(REFUSED["bent"][0], f"  - {bad}\n"))).splitlines()
    assert [line.split(" ")[0] for line in lines] == ["m.yaml:5:37:", "m.yaml:6:37:"]


def test_corners_out_of_plane_by_survey_noise_are_accepted() -> None:
    parse_model_base(base(part("[[0, 0, 0], [2300, 0, 9], [2300, 2300, 0], [0, 2300, 5]]")))


def test_a_wall_that_leans_and_a_window_that_slants_are_accepted() -> None:
    parse_model_base(base(part("[[0, 0, 1], [30, 12, 1], [30, 52, 0], [0, 40, 0]]")))


def test_names_that_do_not_ship_get_a_guess() -> None:
    with pytest.raises(InputError, match="Did you mean 'campus'"):
        load_model_base("kampus")


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(ModelBaseError, match="no such file"):
        load_model_base(tmp_path / "gone.yaml")
