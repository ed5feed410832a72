"""Links say how one part stands in the frame of another."""

from __future__ import annotations

import numpy as np

from recognition.links import links, part_frame
from recognition.modelbase_io import load_model_base


def test_links_carry_the_neighbours_corners_into_the_object() -> None:
    thing = load_model_base("architecture").object("GH")
    parts = {part.id: part for part in thing.parts}
    found = links(thing, neighbours=5)
    assert len(found) == 5 * len(parts)
    for link in found:
        (r_from, t_from), (r_to, t_to) = part_frame(parts[link.from_id]), part_frame(parts[link.to_id])
        np.testing.assert_allclose(r_from @ link.rotation, r_to, atol=1e-12)
        np.testing.assert_allclose(r_from @ link.translation_mm + t_from, t_to, atol=1e-9)


def test_links_join_no_parts_that_face_away_from_each_other() -> None:
    thing = load_model_base("architecture").object("GH")
    normals = {part.id: part.normal for part in thing.parts}
    assert all(normals[link.from_id] @ normals[link.to_id] > -0.2 for link in links(thing, neighbours=60))


def test_a_link_turns_by_the_angle_between_the_walls_of_its_parts() -> None:
    thing = load_model_base("architecture").object("GH")
    face = {part.id: part.face for part in thing.parts}
    turns = {(face[link.from_id] == face[link.to_id], round(link.turn_deg, 6)) for link in links(thing, neighbours=60)}
    assert turns == {(True, 0.0), (False, 0.0), (False, 90.0)}


def test_a_part_frame_is_right_handed_with_y_down_and_z_into_the_wall() -> None:
    for part in load_model_base("architecture").object("LH").parts:
        rotation, _ = part_frame(part)
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0
        np.testing.assert_allclose(rotation[:, 1], [0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(rotation[:, 2], -part.normal, atol=1e-12)
