"""What can be seen is painted, what cannot is not, and the truth agrees with the picture."""

from __future__ import annotations

import numpy as np
import pytest

from calibration_free_tests.renderer.bench_building import building, camera_at, part_on, wall_face
from recognition.geometry import Pose4
from recognition.modelbase import ObjectModel
from sim_backends.appearance import HIGH_CONTRAST, PERFECT, Appearance
from sim_backends.clutter import JuttingWall, Pipe, Tree, draw_clutter
from sim_backends.ordering import paint_order
from sim_backends.renderer import Internals, Scene, render, visible_parts

PLACE = Pose4(9.0, -40.0, 8.0, 25.0)
SIZE = (640, 480)
INNER = Internals(880.0, 875.0, 322.0, 236.0)
# An L: two wings at the front (z = 0) and at the back, with a court between x = 0 and 240, z < 200.
COURT = ((-240.0, 0.0), (0.0, 0.0), (0.0, 200.0), (240.0, 200.0), (240.0, 400.0), (-240.0, 400.0))


def seen(scene: Scene, theta: float, x: float, y: float, z: float) -> dict[str, float]:
    parts = visible_parts(scene, camera_at(theta, x, y, z, PLACE), INNER, SIZE)
    return {part.id: part.visible_fraction for part in parts}


def test_only_faces_that_face_the_camera_are_seen() -> None:
    ids = seen(Scene(building(), PLACE), 0, 0, -150, -900)
    assert ids
    assert all(part_id.startswith("F0") for part_id in ids)


def test_both_faces_of_a_corner_are_seen() -> None:
    ids = seen(Scene(building(), PLACE), 40, 500, -150, -350)
    assert {part_id[:2] for part_id in ids} == {"F0", "F1"}


def test_a_wing_hides_the_wall_behind_it() -> None:
    scene = Scene(building(COURT), PLACE)
    in_court = seen(scene, 0, 120, -150, -200)
    assert any(i.startswith("F2") for i in in_court)
    # From far left of the front wing, the back wall of the court lies behind that wing.
    behind_wing = seen(scene, -20, -400, -150, -500)
    assert not any(i.startswith("F2") and f > 0.99 for i, f in behind_wing.items())
    assert any(i.startswith("F0") and f > 0.99 for i, f in behind_wing.items())


def test_parts_partly_behind_a_wing_show_partly() -> None:
    scene = Scene(building(COURT), PLACE)
    shares = [f for theta in (-25, -15, -5) for f in seen(scene, theta, -100, -150, -420).values()]
    assert any(0.02 < f < 0.9 for f in shares)


def test_near_walls_are_painted_over_far_ones() -> None:
    scene = Scene(building(COURT), PLACE)
    assert not scene.hides[2, 1]
    assert scene.hides[0, 2]  # the front wing, from the left, hides the court's back wall
    assert not scene.hides[2, 0]
    # Seen by its distance alone, the long back wall of the court would be painted over the wing.
    order = paint_order([0, 1, 2], scene.hides, np.array([900.0, 500.0, 100.0]))
    assert order.index(2) < order.index(0)


@pytest.mark.parametrize("item", ["tree", "pipe", "wall"])
def test_clutter_hides_what_is_behind_it_and_moves_with_parallax(item: str) -> None:
    plain = Scene(building(), PLACE)
    front = plain.walls[0]
    things = {
        "tree": Tree((0.0, 0.0, -60.0), 190.0, 45.0),
        "pipe": Pipe((-210.0 + 85.0 - 20.0, 0.0, -20.0), 300.0, 9.0),
        "wall": JuttingWall.on(front, 120.0, 30.0, 30.0, 250.0),
    }
    scene = Scene(building(), PLACE, Appearance(), (things[item],))
    hidden = []
    for x in (-60, 60):
        before, after = seen(plain, 0, x, -130, -420), seen(scene, 0, x, -130, -420)
        hidden.append({i for i in before if after.get(i, 0.0) < before[i] - 0.05})
        assert all(after.get(i, 0.0) <= f + 1e-9 for i, f in before.items())
    assert hidden[0] | hidden[1]
    assert hidden[0] != hidden[1] or item == "wall"


def test_clutter_behind_the_object_is_hidden() -> None:
    tree = Tree((0.0, 0.0, 420.0), 200.0, 60.0)
    camera = camera_at(0, 0, -130, -500, PLACE)
    with_tree, without = (
        render(Scene(building(), PLACE, Appearance(), c), camera, INNER, SIZE, rng=np.random.default_rng(0))
        for c in ((tree,), ())
    )
    assert np.array_equal(with_tree, without)


def test_the_picture_shows_a_part_where_the_truth_says_so() -> None:
    scene = Scene(building(), PLACE, HIGH_CONTRAST)
    met = set()
    for theta, x, z in ((25, 150, -380), (-35, -420, -260)):
        camera = camera_at(theta, x, -140, z, PLACE)
        image = render(scene, camera, INNER, SIZE, rng=np.random.default_rng(0), sensor=PERFECT)[..., 0]
        for part in visible_parts(scene, camera, INNER, SIZE):
            if part.fully_in_frame and len(part.corners_px) == 4:
                u, v = np.rint(part.corners_px.mean(axis=0)).astype(int)
                assert image[v, u] > 200 if part.part_class == "OPEN" else image[v, u] == 0
                met.add(part.part_class)
    assert met == {"OPEN", "DW4"}


def test_two_walls_that_meet_leave_no_seam() -> None:
    scene = Scene(building(), PLACE, HIGH_CONTRAST)  # walls 220, background 128
    camera = camera_at(40, 420, -150, -250, PLACE)
    image = render(scene, camera, INNER, SIZE, rng=np.random.default_rng(0), sensor=PERFECT)[..., 0]
    cam = camera.to_camera() @ PLACE
    foot, top = (cam.rotation @ [240.0, y, 0.0] + cam.translation_mm for y in (-145.0, -155.0))
    (u, low), (_, high) = (INNER.pixels(p) for p in (foot, top))
    assert (image[round(high) : round(low), round(u) - 2 : round(u) + 3] >= 219).all()


def test_a_wall_that_reaches_behind_the_camera_is_cut() -> None:
    face = wall_face("F", np.array([0.0, 100.0, -500.0]), np.array([0.0, 100.0, 500.0]), 200.0)
    part = part_on(face, "p", "DW4", 560.0, 80.0, 30.0, 40.0, 5.0)
    scene = Scene(ObjectModel("o", (part,), (face,)), PLACE, HIGH_CONTRAST)
    # The wall faces +X; the camera stands 60 mm from it and looks along it.
    camera = camera_at(20, 60, 0, -60, PLACE)
    image = render(scene, camera, INNER, SIZE, rng=np.random.default_rng(0), sensor=PERFECT)[..., 0]
    assert (image[:, :40] >= 218).mean() > 0.7
    assert [p.id for p in visible_parts(scene, camera, INNER, SIZE)] == ["p"]


def test_an_object_without_faces_gets_walls() -> None:
    with_faces = building()
    bare = ObjectModel("bare", with_faces.parts)
    nameless = ObjectModel("nameless", tuple(p.__class__(p.id, p.part_class, p.corners_mm) for p in with_faces.parts))
    for model in (bare, nameless):
        walls = Scene(model).walls
        assert len(walls) == 4
        given = {tuple(np.round(w.normal, 6) + 0.0) for w in Scene(with_faces).walls}
        assert {tuple(np.round(w.normal, 6) + 0.0) for w in walls} == given
        assert sorted(i for w in walls for i in w.parts) == list(range(len(model.parts)))


def test_pictures_depend_on_the_generator_only_by_noise() -> None:
    scene = Scene(building(), PLACE, Appearance(), draw_clutter(building(), np.random.default_rng(2)))
    camera = camera_at(10, 60, -140, -300, PLACE)
    a, b, c = (render(scene, camera, INNER, SIZE, rng=np.random.default_rng(s)).astype(int) for s in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)
    assert 1.5 < (a - c).std() / np.sqrt(2) < 2.5


def test_open_windows_are_brighter_and_all_others_darker_than_the_wall() -> None:
    scene = Scene(building(), PLACE)
    met = set()
    for theta, x, z in ((0, 0, -450), (-35, -420, -260), (40, 500, -300), (180, 0, 800)):
        camera = camera_at(theta, x, -150, z, PLACE)
        grey = render(scene, camera, INNER, SIZE, rng=np.random.default_rng(0)).mean(axis=2)
        for part in visible_parts(scene, camera, INNER, SIZE):
            corners = part.corners_px
            if not (part.fully_in_frame and part.visible_fraction == 1 and part.size_px > 20 and len(corners) == 4):
                continue
            beside = np.rint((corners[0] + corners[1]) / 2 + (0, -6)).astype(int)
            within = np.rint(corners.mean(axis=0)).astype(int)
            if beside[1] >= 0:
                ratio = grey[within[1], within[0]] / grey[beside[1], beside[0]]
                assert ratio > 1.15 if part.part_class == "OPEN" else ratio < 0.75
                met.add(part.part_class)
    assert met == {"OPEN", "DW4"}
