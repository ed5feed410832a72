"""The picture shows each façade as it is seen from outside, and can be written in three formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recognition.modelbase_io import load_model_base, parse_model_base
from rig.errors import InputError
from rig.modelshow import draw, unfold


def clockwise_area(corners: np.ndarray) -> float:
    after = np.roll(corners, -1, axis=0)
    return float((corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]).sum() / 2)


@pytest.mark.parametrize("name", ["architecture", "campus"])
def test_unfolding_keeps_sizes_and_shows_parts_from_outside(name: str) -> None:
    for thing in load_model_base(name).objects:
        faces = unfold(thing)
        assert [face.name for face in faces] == [face.id for face in thing.faces]
        assert sum(len(face.polygons) for face in faces) == len(thing.parts)
        for face in faces:
            for part, corners in face.polygons:
                assert corners[:, 0].min() >= face.left_mm
                assert corners[:, 0].max() <= face.right_mm
                sides = np.linalg.norm(np.diff(part.corners_mm, axis=0), axis=1)
                np.testing.assert_allclose(np.linalg.norm(np.diff(corners, axis=0), axis=1), sides, atol=1e-9)
                assert clockwise_area(corners) > 0


@pytest.mark.realdata
def test_the_castle_unfolds_without_known_walls(real_data: Path) -> None:
    thing = load_model_base(real_data / "castle" / "modelbase.yaml").object("castle")
    faces = unfold(thing)
    assert len(faces) == 8
    assert all(clockwise_area(corners) > 0 for face in faces for _, corners in face.polygons)
    assert all(np.ptp(corners, axis=0).min() > 900 for face in faces for _, corners in face.polygons)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_picture_is_written(suffix: str, tmp_path: Path) -> None:
    file = draw(load_model_base("architecture"), tmp_path / f"m{suffix}")
    assert file.stat().st_size > 10_000


def test_parts_without_a_face_and_parts_of_a_roof_are_drawn(tmp_path: Path) -> None:
    text = (
        "objects:\n- id: o\n  parts:\n"
        "  - {id: a, class: DW4, corners_mm: [[0, 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]]}\n"
        "  - {id: b, class: DW4, face: roof, corners_mm: [[0, 0, 40], [30, 0, 40], [30, 0, 0], [0, 0, 0]]}\n"
    )
    draw(parse_model_base(text), tmp_path / "m.svg")


def test_other_formats_and_missing_folders_are_input_errors(tmp_path: Path) -> None:
    base = load_model_base("architecture")
    with pytest.raises(InputError, match=r"Use one of \.png"):
        draw(base, tmp_path / "m.bmp")
    with pytest.raises(InputError, match="cannot be written"):
        draw(base, tmp_path / "none" / "m.png")
