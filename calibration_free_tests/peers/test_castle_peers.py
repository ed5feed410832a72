"""The SIFT peer of the castle: its map, its localisation on clean matches, and what its answers are called."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.peers.castle import Score, frames_of, from_same_places, score, spread_starts, table
from benchmarks.peers.localise import ALL, FOCAL, GIVEN, Located, Matches, locate
from benchmarks.peers.sift_map import (
    Features,
    Observations,
    Reference,
    SiftMap,
    build,
    match,
    on_line,
    partners,
    triangulated,
)
from benchmarks.trials import RIGHT, UNDECIDED, WRONG, Trial
from recognition.geometry import CameraPose

FloatArray = npt.NDArray[np.float64]
SIZE = (1280, 960)
CENTRED, SHIFTED = np.array([1500.0, 1500.0, 639.5, 479.5]), np.array([1500.0, 1530.0, 655.0, 640.0])
TRUE = CameraPose(179.5, 1000.0, -500.0, 2000.0)

needs_pycolmap = pytest.mark.skipif(
    find_spec("pycolmap") is None, reason="pycolmap is not installed: it comes with the extra 'peers'"
)


def reference(x_mm: float, theta_deg: float = 0.0, internals: FloatArray = SHIFTED) -> Reference:
    return Reference(f"x{x_mm:g}_{theta_deg:g}.jpg", CameraPose(theta_deg, x_mm, 0.0, 0.0), internals, 0.25, SIZE)


def scene(count: int = 60) -> FloatArray:
    """Points, m, 15 to 25 m ahead."""
    rng = np.random.default_rng(2)
    return np.column_stack([rng.uniform(-4, 4, count), rng.uniform(-3, 3, count), rng.uniform(15, 25, count)])


def seen(points: FloatArray, by: Reference) -> FloatArray:
    camera = (points - by.centre_m) @ by.rotation.T
    return np.asarray(by.internals[:2] * camera[:, :2] / camera[:, 2:] + by.internals[2:])


def three_photographs() -> tuple[SiftMap, FloatArray]:
    """Three photographs from different places; each point has its own descriptor, the same in all."""
    points, cameras = scene(), [reference(0.0), reference(3000.0, 6.0), reference(-3000.0, -6.0)]
    descriptors = np.linalg.qr(np.random.default_rng(3).standard_normal((128, 128)))[0][: len(points)]
    features = [Features(seen(points, one), descriptors.astype(np.float32)) for one in cameras]
    return build(cameras, features), points


@pytest.mark.parametrize(
    ("camera", "inliers", "kind"),
    [
        (TRUE, 30, RIGHT),
        (TRUE, 29, UNDECIDED),
        (replace(TRUE, x_mm=1299.0), 30, RIGHT),
        (replace(TRUE, x_mm=1301.0), 30, WRONG),
        (replace(TRUE, x_mm=1301.0), 29, UNDECIDED),
        (replace(TRUE, theta_deg=-179.0), 30, RIGHT),  # 1.5 degrees the short way round
        (replace(TRUE, theta_deg=-178.0), 30, WRONG),
    ],
)
def test_an_answer_is_right_within_the_tolerance_and_told_only_where_enough_agree(
    camera: CameraPose, inliers: int, kind: str
) -> None:
    assert score("peer", "a.jpg", 1, Located(camera, inliers), TRUE, 30).kind == kind


def test_no_answer_is_undecided_and_infinitely_far_off() -> None:
    assert score("peer", "a.jpg", 2, None, TRUE, 30) == Score("peer", "a.jpg", 2, UNDECIDED, np.inf, np.inf, 0)


def test_the_table_counts_each_start_once_and_gives_medians_of_the_right_ones_and_of_all() -> None:
    scores = [Score("ours", f"{k}", k, RIGHT, 10.0 * k, 0.1 * k, 0) for k in (1, 2, 3)]
    scores += [Score("ours", "4", 2, WRONG, 900.0, 3.0, 0), Score("one view", "1", 1, UNDECIDED, np.inf, np.inf, 0)]
    _, ours, peer = table(scores).splitlines()
    assert " ".join(ours.split()) == "ours 3 (75%) 1 (25%) 0 (0%) 20 mm 0.20° 20 mm 0.20° 2.00"
    assert "1 (100%)" in peer
    assert "inf mm" in peer


def test_descriptors_match_where_each_is_the_others_nearest_and_clearly_so() -> None:
    e = np.eye(128, dtype=np.float32)
    between = (e[2] + e[3]) / np.sqrt(2.0)  # as near to two others: refused
    one = np.stack([e[0], e[1], between, e[5]]).astype(np.float32)
    other = np.stack([e[1], e[0], e[2], e[3]]).astype(np.float32)
    assert match(one, other).tolist() == [[0, 1], [1, 0]]
    assert len(match(one[:1], other)) == 0


def test_a_match_off_its_epipolar_line_is_dropped() -> None:
    one, other = reference(0.0), reference(3000.0, 6.0)
    first, second = seen(scene(), one), seen(scene(), other)
    pairs = np.column_stack([np.arange(60), np.arange(60)])
    second[7, 1] += 10.0
    kept = on_line(one, other, first, second, pairs)
    assert np.flatnonzero(~kept).tolist() == [7]


def test_photographs_are_paired_if_they_look_at_the_same_from_different_places() -> None:
    away = reference(2000.0, 180.0)
    same_place = reference(0.0, 4.0)
    assert partners([reference(0.0), reference(3000.0, 6.0), away, same_place]) == {(0, 1), (1, 3)}


def test_the_map_holds_clean_points_where_they_are() -> None:
    sift, points = three_photographs()
    known = triangulated(sift, [])
    assert len(known.image) == 3 * len(points)
    np.testing.assert_allclose(known.points_m, points[known.feature], atol=1e-5)


def test_a_photograph_that_is_left_out_lends_the_map_nothing() -> None:
    sift, points = three_photographs()
    # A false match in photograph 2 would pull the points of the others.
    sift.features[2].pixels[:] += 1.0
    known = triangulated(sift, [2])
    assert set(known.image) == {0, 1}
    np.testing.assert_allclose(known.points_m, points[known.feature], atol=1e-5)
    assert len(triangulated(sift, [1, 2]).image) == 0


def test_points_whose_views_disagree_are_not_trusted() -> None:
    one, other = reference(0.0), reference(3000.0, 6.0)
    first, second = seen(scene(), one), seen(scene(), other)
    second[7, 1] += 10.0
    numbers = np.arange(60)
    rows = Observations(np.zeros(60, dtype=np.int64), numbers, np.ones(60, dtype=np.int64), numbers)
    features = [Features(pixels, np.zeros((60, 128), dtype=np.float32)) for pixels in (first, second)]
    assert 7 not in triangulated(SiftMap([one, other], features, rows), []).feature


@needs_pycolmap
@pytest.mark.parametrize(("how", "internals"), [(FOCAL, CENTRED), (ALL, SHIFTED), (GIVEN, SHIFTED)])
@pytest.mark.parametrize("views", [1, 3])
def test_clean_matches_locate_the_camera_of_the_last_view(how: str, internals: FloatArray, views: int) -> None:
    own = [reference(x, theta, internals) for x, theta in ((500.0, 0.0), (2500.0, 7.0), (-1000.0, -5.0))][:views]
    points = scene()
    found = locate([Matches(points, seen(points, one)) for one in own], own, how)
    assert found is not None
    assert found.inliers == views * len(points)
    assert np.linalg.norm(found.camera.centre_mm - own[-1].camera.centre_mm) < 5.0
    assert abs(found.camera.theta_deg - own[-1].camera.theta_deg) < 0.01


@needs_pycolmap
def test_a_feature_matched_to_many_points_counts_once() -> None:
    one, points = reference(0.0, 0.0, SHIFTED), scene()
    twice = Matches(np.vstack([points, points]), np.vstack([seen(points, one)] * 2))
    found = locate([twice], [one], GIVEN)
    assert found is not None
    assert found.inliers == len(points)


@needs_pycolmap
@pytest.mark.parametrize("views", [1, 2])
def test_without_matches_there_is_no_answer(views: int) -> None:
    none = Matches(np.zeros((0, 3)), np.zeros((0, 2)))
    assert locate([none] * views, [reference(0.0), reference(1000.0)][:views], FOCAL) is None


def test_photographs_from_the_same_places_are_those_of_any_view() -> None:
    listed = [reference(0.0), reference(0.0, 7.5), reference(5000.0), reference(9000.0)]
    assert from_same_places(listed, [listed[0], listed[3]]) == [0, 1, 3]


def test_starts_are_spread_over_the_whole_list() -> None:
    files = [str(k) for k in range(80)]
    assert spread_starts(files, 4) == ["0", "20", "40", "60"]
    assert spread_starts(files, 100) == files


def test_the_peer_gets_the_views_that_ours_took() -> None:
    log = ["view 1 images/a.jpg at (0, 0, 0) mm", "view 2 images/b.jpg at (1, 0, 0) mm"]
    trial = Trial("a", RIGHT, True, "", None, "", 2, 0, 0.0, 0.0, 0.0, 0.0, [], 0.0, 0.0, "", log)
    assert frames_of(trial) == ["images/a.jpg", "images/b.jpg"]
