"""A model base as arrays says what the model base says."""

from __future__ import annotations

import numpy as np

from calibration_free_tests.recognition.synthetic import base_of, building, regular, three_buildings
from recognition.layout import compile_layout, part_of
from recognition.modelbase import ModelBase, ObjectModel, Part, PartClass
from recognition.modelbase_io import load_model_base


def test_every_part_of_every_object_is_there_with_its_corners_and_class() -> None:
    base = three_buildings()
    layout = compile_layout(base)
    parts = [part for thing in base.objects for part in thing.parts]
    assert len(layout.part_ids) == len(parts)
    for index, part in enumerate(parts):
        assert part_of(layout, index) is part
        assert np.array_equal(layout.corners_mm[index, : layout.corner_count[index]], part.corners_mm)
        assert layout.class_names[layout.part_class[index]] == part.part_class
        assert base.objects[layout.object_of[index]].parts[index - layout.first[layout.object_of[index]]] is part


def test_corners_in_the_wall_rebuild_the_corners_in_space() -> None:
    layout = compile_layout(load_model_base("architecture"))
    s, y = layout.local_mm[..., 0], layout.local_mm[..., 1]
    rebuilt = layout.centre_mm[:, None] + s[..., None] * layout.along[:, None] + y[..., None] * np.array([0, 1.0, 0])
    assert np.abs(rebuilt - layout.corners_mm).max() < 1e-6


def test_right_in_the_wall_is_right_for_who_faces_it_from_outside() -> None:
    layout = compile_layout(base_of(building("tower", 0)))
    four = layout.local_mm[:, :4, 0]
    assert (four[:, 1] > four[:, 0]).all(), "top-right is right of top-left"
    down = np.array([0.0, 1.0, 0.0])
    # Right x down points into the wall in a right-handed frame, against the outward normal.
    assert np.allclose(np.cross(layout.along, down), -layout.normal)


def test_shorter_polygons_are_padded_by_their_last_corner() -> None:
    layout = compile_layout(load_model_base("architecture"))
    longest = layout.corners_mm.shape[1]
    assert longest == 12
    for index in range(0, len(layout.part_ids), 17):
        n = int(layout.corner_count[index])
        assert (layout.corners_mm[index, n:] == layout.corners_mm[index, n - 1]).all()


def test_equal_windows_share_one_shape_and_different_ones_do_not() -> None:
    layout = compile_layout(base_of(regular("block")))
    assert len(layout.shape_example) == 1
    wide = _rectangle("wide", 60.0, 55.0)
    near = _rectangle("near", 40.4, 55.0)
    plain = _rectangle("plain", 40.0, 55.0)
    mixed = compile_layout(base_of(ObjectModel("mixed", (plain, near, wide))))
    assert mixed.shape[0] == mixed.shape[1], "windows of one kind scatter by a hundredth of their size"
    assert mixed.shape[0] != mixed.shape[2]


def test_equal_outlines_of_different_classes_are_different_shapes() -> None:
    layout = compile_layout(base_of(ObjectModel("two", (_rectangle("a"), _rectangle("b", part_class="OPEN")))))
    assert layout.shape[0] != layout.shape[1]


def test_the_extent_of_an_object_is_that_of_its_parts() -> None:
    layout = compile_layout(base_of(regular("block", columns=6, rows=2), regular("long", columns=11, rows=2)))
    assert np.allclose(layout.extent_mm, [5 * 80.0, 10 * 80.0])


def test_a_part_need_not_have_four_corners() -> None:
    outline = np.array([[0, 0], [60, 0], [60, 30], [30, 30], [30, 60], [0, 60.0]])
    corners = np.concatenate([outline, np.zeros((6, 1))], axis=1)
    base = ModelBase((ObjectModel("one", (Part("l", "L", corners),)),), (PartClass("L", 6, outline / 60.0),))
    layout = compile_layout(base)
    assert layout.corner_count.tolist() == [6]
    assert np.allclose(layout.size_mm, [[60.0, 60.0]])


def _rectangle(name: str, wide: float = 40.0, high: float = 55.0, part_class: str = "DW4") -> Part:
    flat = np.array([[0, 0], [wide, 0], [wide, high], [0, high]])
    return Part(name, part_class, np.concatenate([flat, np.zeros((4, 1))], axis=1))
