"""Edges where a part is expected speak for it, a bare wall speaks against it, and new corners sharpen the pose."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from calibration_free_tests.recognition.synthetic import (
    HEIGHT,
    INTERNALS,
    OBJECT_IN_RIG,
    WIDTH,
    base_of,
    before_front,
    building,
    seen_from,
    visible,
    world_of,
)
from recognition.detectors.edges import EdgeField
from recognition.geometry import CameraPose
from recognition.hypotheses import Hypotheses, no_matches
from recognition.modelbase import ObjectModel
from recognition.rates import DetectionRates
from recognition.second_look import look_again
from recognition.seen import Seen
from recognition.tracking import rescore, settle

TOWER, MILL = building("tower", 0), building("mill", 1)
BASE = base_of(TOWER, MILL)
WORLD = world_of(BASE, DetectionRates(found=0.6, clutter=80.0, corner_sd_px=0.5))
CAMERAS = [before_front(300.0, turn_deg=15.0), before_front(430.0, 200.0, 360.0, turn_deg=-10.0)]
PLACEMENT = np.array([np.radians(OBJECT_IN_RIG.theta_deg), *OBJECT_IN_RIG.translation_mm])


def picture(thing: ObjectModel, camera: CameraPose, seed: int = 0) -> npt.NDArray[np.uint8]:
    """Dark or bright windows on a plain wall, with noise."""
    fine = 8
    large = np.full((fine * HEIGHT, fine * WIDTH), 150, dtype=np.uint8)
    for part, px in visible(thing, camera):
        shade = 230 if part.part_class == "OPEN" else 60
        cv2.fillPoly(large, [np.rint(fine * (px + 0.5) - 0.5).astype(np.int32)], shade)
    image = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0, 2.0, image.shape)
    return np.asarray(np.clip(image + noise, 0, 255), dtype=np.uint8)


def view(camera: CameraPose, group: int, found: slice = slice(None), *, edges: bool = True) -> Seen:
    """What a detector that misses some parts sees of the tower, and the picture for a second look."""
    seen = seen_from(BASE, TOWER, camera, group=group)
    kept = np.arange(seen.count)[found]
    return replace(
        seen,
        corners_px=seen.corners_px[kept],
        corner_count=seen.corner_count[kept],
        sigma_px=np.full(len(kept), 0.5),
        class_score=seen.class_score[kept],
        source=np.arange(len(kept)),
        edges=EdgeField(picture(TOWER, camera)) if edges else None,
    )


def unfitted(views: list[Seen], things: tuple[int, ...]) -> Hypotheses:
    """Hypotheses where the tower stands, of these objects, without any matches yet."""
    n = len(things)
    return Hypotheses(
        np.array(things),
        np.tile(PLACEMENT, (n, 1)),
        np.zeros((n, 4, 4)),
        np.tile(INTERNALS, (n, len(views), 1)),
        np.zeros(n),
        np.zeros((n, len(views))),
        tuple(no_matches(n, v) for v in views),
    )


def settled(views: list[Seen], things: tuple[int, ...] = (0, 1)) -> Hypotheses:
    """Tower and mill where the tower stands, matched and fitted."""
    return settle(WORLD, unfitted(views, things), views)


def test_parts_that_the_detector_missed_are_found_where_they_are_expected() -> None:
    views = [view(camera, k, slice(None, None, 2)) for k, camera in enumerate(CAMERAS)]
    before = settled(views)
    after = look_again(WORLD, before, views)
    for k, camera in enumerate(CAMERAS):
        assert (after.odds[0, k]) > before.odds[0, k] + 1.0
        truth = {WORLD.layout.part_ids.index(part.id): px for part, px in visible(TOWER, camera)}
        part = after.matches[k].part[0]
        assert set(part[part >= 0].tolist()) == set(truth)
        for one, corners in zip(part[part >= 0], after.matches[k].corners_px[0][part >= 0], strict=True):
            assert np.abs(corners - truth[int(one)]).max() < 0.7


def test_a_bare_wall_where_parts_are_expected_speaks_louder_than_parts_missed() -> None:
    """The detector misses four of ten windows, so to miss some tells little; no edges either tells more."""
    blank = np.asarray(np.random.default_rng(0).normal(150, 2.0, (HEIGHT, WIDTH)).clip(0, 255), dtype=np.uint8)
    views = [view(CAMERAS[0], 0), replace(view(CAMERAS[1], 0, slice(0, 0)), edges=EdgeField(blank))]
    before = rescore(WORLD, settled(views, (0,)), views, range(2))
    after = look_again(WORLD, before, views)
    assert before.odds[0, 1] < 0.0
    assert after.odds[0, 1] < before.odds[0, 1] - 0.5
    assert after.odds[0, 0] > 5.0


def test_the_object_that_is_there_stays_ahead_of_one_that_shares_most_of_its_parts() -> None:
    views = [view(camera, k, slice(None, None, 2)) for k, camera in enumerate(CAMERAS)]
    after = look_again(WORLD, settled(views), views)
    assert after.log_weight[0] > after.log_weight[1] + 5.0


def test_corners_found_again_make_the_pose_surer_and_keep_it_right() -> None:
    views = [view(camera, k, slice(0, 2)) for k, camera in enumerate(CAMERAS)]
    before = settled(views, (0,))
    after = look_again(WORLD, before, views)
    sd_before, sd_after = (np.sqrt(np.diag(h.covariance[0])) for h in (before, after))
    assert (sd_after < sd_before).all()
    assert np.abs(after.placement[0] - PLACEMENT)[1:].max() < 15.0


def test_without_a_picture_nothing_changes() -> None:
    views = [view(camera, k, edges=False) for k, camera in enumerate(CAMERAS)]
    before = settled(views)
    after = look_again(WORLD, before, views)
    assert np.array_equal(after.odds, before.odds)
    assert np.array_equal(after.placement, before.placement)


def test_no_hypotheses_are_no_special_case() -> None:
    views = [view(CAMERAS[0], 0)]
    assert len(look_again(WORLD, settled(views).take(np.empty(0, dtype=np.int64)), views)) == 0
