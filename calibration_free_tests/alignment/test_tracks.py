"""Points followed through pictures: matches that fit one geometry, tracks that meet each view once."""

from __future__ import annotations

import numpy as np

from calibration_free_tests.alignment.synthetic import HUNG, LENS, SIZE, lattice
from calibration_free_tests.alignment.textured_wall import pictures, textured_wall
from recognition.alignment.moves import Moves
from recognition.alignment.tracks import Features, Tracks, find_features, follow, match, pairs
from recognition.geometry import camera_in_rig
from rig.hal import RigPose
from sim_backends.projection import View

POSES = [RigPose(-30.0, 0.0, 0.0, -6.0), RigPose(0.0, 10.0, 20.0, 0.0), RigPose(30.0, -10.0, 0.0, 6.0)]


def made_up(rng: np.random.Generator, count: int) -> Features:
    look = rng.random((count, 128))
    return Features(rng.uniform((0, 0), SIZE, (count, 2)), (look / np.linalg.norm(look, axis=1)[:, None]).astype("f4"))


def test_a_track_is_one_point_of_the_wall() -> None:
    scene = textured_wall(1)
    images = pictures(scene, POSES, HUNG, LENS, np.random.default_rng(1))
    tracks = follow([find_features(image) for image in images], Moves.of(POSES))
    assert tracks.count > 300
    # Back from each picture to the wall's plane: all views of a point must say the same place.
    places = np.zeros_like(tracks.pixels)
    for k, pose in enumerate(POSES):
        view = View.of(camera_in_rig(pose, HUNG), scene.object_in_rig, LENS, SIZE, HUNG.tilt)
        here = tracks.view == k
        rays = np.column_stack([LENS.undistort(tracks.pixels[here]), np.ones(here.sum())]) @ view.rotation
        places[here] = (view.centre_mm - rays * (view.centre_mm[2] / rays[:, 2])[:, None])[:, :2]
    first = np.searchsorted(tracks.point, np.arange(tracks.count))
    spread = np.linalg.norm(places - places[first][tracks.point], axis=1)
    assert np.median(spread[spread > 0]) < 0.15  # mm; a pixel is 0.5 mm of the wall
    assert (spread < 2.0).mean() > 0.98


def test_large_pictures_give_features_in_their_own_pixels() -> None:
    image = next(pictures(textured_wall(1), POSES[:1], HUNG, LENS, np.random.default_rng(1)))
    large = np.kron(image, np.ones((4, 4, 1), dtype=np.uint8))
    small, found = find_features(image), find_features(large)
    # The middle of the small picture's pixel (0, 0) is that of the pixels 0..3: 1.5.
    wanted = small.pixels * 4.0 + 1.5
    nearest = np.linalg.norm(found.pixels[:, None] - wanted[None], axis=2).min(axis=1)
    assert np.median(nearest) < 1.0


def test_a_picture_without_texture_has_no_features() -> None:
    assert len(find_features(np.full((480, 640), 128, dtype=np.uint8)).pixels) == 0
    assert match(find_features(np.zeros((480, 640, 3), np.uint8)), made_up(np.random.default_rng(0), 50)).shape == (
        0,
        2,
    )


def test_features_that_nothing_joins_do_not_match() -> None:
    rng = np.random.default_rng(2)
    assert len(match(made_up(rng, 100), made_up(rng, 100))) == 0


def test_a_track_that_meets_a_view_twice_is_left_out() -> None:
    rng = np.random.default_rng(3)
    plain = made_up(rng, 60)
    away = np.linalg.qr(np.column_stack([rng.normal(size=(128, 2))]))[0].T

    def view(shift_px: float, *turns_deg: float) -> Features:
        """The plain features, and others whose looks differ by the angles between them."""
        turns = np.radians(turns_deg)[:, None]
        odd = np.cos(turns) * away[0] + np.sin(turns) * away[1]
        at = [[300.0 + k / 2, 200.0] for k in range(len(turns))]
        return Features(np.vstack([plain.pixels, at]) + shift_px, np.vstack([plain.descriptors, odd]).astype("f4"))

    good = follow([view(0.0, 0.0), view(3.0, 20.0), view(6.0, 34.0)], Moves.of(POSES))
    assert (good.count, len(good.pixels)) == (61, 183)
    # The first view's looks most like the third view's second (14 degrees), the second view's most like its first.
    torn = follow([view(0.0, 0.0), view(3.0, 20.0), view(6.0, 34.0, -14.0)], Moves.of(POSES))
    assert (torn.count, len(torn.pixels)) == (60, 180)


def test_all_views_hang_together() -> None:
    poses = lattice() + [RigPose(400.0 + x, 0.0, 0.0, 60.0) for x in (0.0, 10.0, 20.0)]
    reached = {0}
    found = list(pairs(Moves.of(poses)))
    assert len(found) == len(set(found))
    assert all(a < b for a, b in found)
    for _ in poses:
        reached |= {b for a, b in found if a in reached} | {a for a, b in found if b in reached}
    assert reached == set(range(len(poses)))


def test_points_seen_too_rarely_are_left_out() -> None:
    tracks = Tracks.of(np.arange(12.0).reshape(6, 2), np.array([0, 1, 2, 0, 1, 0]), np.array([7, 7, 7, 3, 3, 9]))
    assert tracks.count == 2
    assert tracks.point.tolist() == [0, 0, 1, 1, 1]
    kept, left = tracks.take(np.array([True, False, True, True, True]))
    assert (kept.count, left.tolist(), kept.view.tolist()) == (1, [1], [0, 1, 2])
