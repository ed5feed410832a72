"""Which parts a camera expects to see, and where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.recognition.synthetic import (
    INTERNALS,
    OBJECT_IN_RIG,
    SIZE,
    WIDTH,
    base_of,
    before_front,
    building,
    in_rig,
    three_buildings,
    visible,
    world_of,
)
from recognition.geometry import CameraPose, Pose4, camera_in_object
from recognition.layout import part_of
from recognition.modelbase import Face, ModelBase, ObjectModel, Part
from recognition.tracking import World
from recognition.visibility import Pairs, bounding_box, camera_in_objects, parts_in_view

FloatArray = npt.NDArray[np.float64]
PLACEMENT = np.array([np.radians(OBJECT_IN_RIG.theta_deg), *OBJECT_IN_RIG.translation_mm])
HERE = np.zeros(4)


def row(camera: CameraPose) -> FloatArray:
    return np.array([np.radians(camera.theta_deg), *camera.centre_mm])


def looking(world: World, camera: CameraPose, *, thing: int = 0, internals: FloatArray = INTERNALS) -> Pairs:
    """What one hypothesis expects: the object stands in the rig frame as it is, the camera is given in its frame."""
    return parts_in_view(
        world.layout, world.walls, np.array([thing]), HERE[None], row(camera), internals[None], SIZE, margin_px=4.0
    )


def names(world: World, pairs: Pairs) -> set[str]:
    return {world.layout.part_ids[p] for p in pairs.part}


@pytest.mark.parametrize(
    "camera",
    [
        before_front(200.0),
        before_front(500.0, turn_deg=30.0),
        before_front(820.0, 150.0, 400.0, turn_deg=25.0),
        CameraPose(55.0, 1150.0, 200.0, -250.0),
        CameraPose(90.0, 1100.0, 200.0, 220.0),
    ],
)
def test_parts_and_corners_are_those_of_the_projection_equations(camera: CameraPose) -> None:
    base = three_buildings()
    world = world_of(base)
    pairs = looking(world, camera)
    expected = {part.id: px for part, px in visible(base.objects[0], camera)}
    assert len(expected) >= 3
    assert set(expected) <= names(world, pairs)
    for part, corners, cosine in zip(pairs.part, pairs.corners_px, pairs.cosine, strict=True):
        if world.layout.part_ids[part] in expected:
            assert np.allclose(corners, expected[world.layout.part_ids[part]], atol=1e-9)
        assert (corners > 4).all()
        ray = part_of(world.layout, int(part)).centre_mm - camera.centre_mm
        assert cosine == pytest.approx(-float(ray @ part_of(world.layout, int(part)).normal) / np.linalg.norm(ray))


def test_the_picture_depends_only_on_where_the_camera_is_in_the_object_frame() -> None:
    base = three_buildings()
    world = world_of(base)
    camera = before_front(400.0, turn_deg=20.0)
    placed = parts_in_view(
        world.layout,
        world.walls,
        np.array([1]),
        PLACEMENT[None],
        row(in_rig(camera)),
        INTERNALS[None],
        SIZE,
        margin_px=4.0,
    )
    plain = looking(world, camera, thing=1)
    assert np.array_equal(placed.part, plain.part)
    assert np.allclose(placed.corners_px, plain.corners_px, atol=1e-6)


def test_camera_in_objects_agrees_with_the_module_that_owns_conversions() -> None:
    rng = np.random.default_rng(1)
    placements = np.concatenate([rng.uniform(-3, 3, (5, 1)), rng.uniform(-500, 500, (5, 3))], axis=1)
    camera = CameraPose(33.0, 120.0, -40.0, 77.0)
    pan, centre = camera_in_objects(placements, row(camera))
    for k, p in enumerate(placements):
        expected = camera_in_object(camera, Pose4.of(np.degrees(p[0]), p[1:]))
        assert np.allclose(centre[k], expected.centre_mm)
        assert np.cos(pan[k] - np.radians(expected.theta_deg)) == pytest.approx(1.0)


def test_nothing_is_seen_from_behind_or_inside() -> None:
    world = world_of(three_buildings())
    assert not len(looking(world, CameraPose(180.0, 400.0, 200.0, 900.0)).part)
    assert not len(looking(world, CameraPose(0.0, 400.0, 200.0, 200.0)).part)


def test_walls_seen_edge_on_show_nothing() -> None:
    world = world_of(base_of(building("tower", 0)))
    pairs = looking(world, CameraPose(84.0, 1900.0, 200.0, -60.0))
    assert not any(name.startswith("front") for name in names(world, pairs))


def test_a_wall_in_front_hides_what_is_behind_it() -> None:
    """An L-shaped building: its wing, in front, stands between the camera and half of the far wall."""
    far = [Part(f"far {k}", "DW4", _window_at(60.0 + 80 * k, 600.0), "far") for k in range(6)]
    wing_front = Face("wing front", np.array([[0, 0, 200], [280, 0, 200], [280, 300, 200], [0, 300, 200.0]]))
    wing_part = Part("wing 0", "DW4", _window_at(100.0, 200.0), "wing front")
    far_face = Face("far", np.array([[0, 0, 600], [600, 0, 600], [600, 300, 600], [0, 300, 600.0]]))
    camera = CameraPose(0.0, 290.0, 120.0, -500.0)
    lens = np.array([560.0, 560.0, WIDTH / 2, 240.0])
    hidden = world_of(base_of(ObjectModel("l", (*far, wing_part), (far_face, wing_front))))
    open_air = world_of(base_of(ObjectModel("l", (*far, wing_part), (far_face,))))
    assert names(open_air, looking(open_air, camera, internals=lens)) == {f"far {k}" for k in range(6)} | {"wing 0"}
    seen = names(hidden, looking(hidden, camera, internals=lens))
    # Rays to far windows cross z = 200 at 290 + (x - 290) * 7 / 11: 156, 207 and 258 mm lie on the wing, 309 does not.
    covered = {"far 0", "far 1", "far 2"}
    assert seen == {f"far {k}" for k in range(6)} - covered | {"wing 0"}


def test_a_part_hidden_in_part_is_not_expected_whole() -> None:
    """The wing ends before the middle of one far window: its edge still hides that window's left corners."""
    far = Part("far", "DW4", _window_at(200.0, 600.0), "far")
    camera = CameraPose(0.0, 290.0, 120.0, -500.0)
    names_seen = []
    # A ray to x on the far wall crosses z = 200 at 290 + (x - 290) * 7 / 11: its window at 233 to 258 mm.
    for end in (228.0, 240.0, 262.0):
        wing = Face("wing", np.array([[0, 0, 200], [end, 0, 200], [end, 300, 200], [0, 300, 200.0]]))
        world = world_of(base_of(ObjectModel("l", (far,), (wing,))))
        names_seen.append(names(world, looking(world, camera)))
    assert names_seen == [{"far"}, set(), set()]


def test_a_wall_seen_from_its_back_hides_nothing() -> None:
    """The back of a courtyard's near wall is not part of the model: only its outside is."""
    part = Part("far", "DW4", _window_at(100.0, 600.0), "far")
    facing_away = Face("near", np.array([[300, 0, 200], [0, 0, 200], [0, 300, 200], [300, 300, 200.0]]))
    world = world_of(base_of(ObjectModel("court", (part,), (facing_away,))))
    assert names(world, looking(world, CameraPose(0.0, 120.0, 120.0, -500.0))) == {"far"}


def test_a_part_is_not_hidden_by_its_own_wall() -> None:
    base = three_buildings()
    camera = before_front(400.0, turn_deg=25.0)
    bare = ModelBase(tuple(replace(thing, faces=()) for thing in base.objects), base.classes)
    assert names(world_of(base), looking(world_of(base), camera)) == names(
        world_of(bare), looking(world_of(bare), camera)
    )


def test_hypotheses_do_not_mix() -> None:
    world = world_of(three_buildings())
    camera = in_rig(before_front(400.0))
    others = PLACEMENT + np.array([[0, 0, 0, 0], [0.1, 30, 0, 0], [np.pi, 0, 0, 0], [0, 0, 0, 400.0]])
    things = np.array([2, 0, 1, 0])
    together = parts_in_view(world.layout, world.walls, things, others, row(camera), np.tile(INTERNALS, (4, 1)), SIZE)
    assert (np.diff(together.hypothesis) >= 0).all()
    for k in range(4):
        alone = parts_in_view(
            world.layout, world.walls, things[k : k + 1], others[k : k + 1], row(camera), INTERNALS[None], SIZE
        )
        mine = together.take(together.hypothesis == k)
        assert sorted(mine.part) == sorted(alone.part)
        assert (world.layout.object_of[mine.part] == things[k]).all()


def test_bounding_boxes_hold_all_corners() -> None:
    polygons = np.random.default_rng(0).uniform(0, 100, (7, 12, 2))
    low, high = bounding_box(polygons)
    assert np.array_equal(low, polygons.min(axis=1))
    assert np.array_equal(high, polygons.max(axis=1))


def _window_at(x: float, z: float) -> FloatArray:
    return np.array([[x, 90, z], [x + 40, 90, z], [x + 40, 145, z], [x, 145, z]])
