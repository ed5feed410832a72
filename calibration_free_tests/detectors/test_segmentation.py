"""The paper's detector finds parts of every class, exactly, and tells what they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.detectors.drawing import as_photo, draw_polygon
from recognition.detectors.segmentation import make_detector
from recognition.modelbase import PartClass
from recognition.modelbase_io import load_model_base
from recognition.part_classes import BUILT_IN_CLASSES
from recognition.parts import DetectedPart
from rig.errors import InputError
from rig.hal import Image
from sim_backends.simulate import draw_scene, rendered_rig

FloatArray = npt.NDArray[np.float64]
WALL, DARK, BRIGHT = 150.0, 60.0, 225.0
DW4_DARK = PartClass("DW4", 4, None, bright=False)
CLASSES = [DW4_DARK, *(c for c in BUILT_IN_CLASSES.values() if c.name != "DW4")]
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def picture(*polygons: tuple[FloatArray, float], noise: float = 2.0, seed: int = 1) -> Image:
    image = np.full((360, 480), WALL)
    for corners, grey in polygons:
        draw_polygon(image, corners, grey)
    return as_photo(image, np.random.default_rng(seed), noise)


def oblique(canonical: FloatArray, left: float = 120.0, top: float = 80.0, size: float = 160.0) -> FloatArray:
    """The unit square as an upright camera sees it from the side: vertical sides stay vertical."""
    x, y = canonical.T
    depth = 1.0 + 0.25 * x
    return np.stack([left + size * 1.25 * x / depth, top + size / 2 + size * (y - 0.5) / depth + 6 * x], axis=-1)


def nearest(parts: list[DetectedPart], corners: FloatArray) -> tuple[DetectedPart, float]:
    alike = [part for part in parts if len(part.corners_px) == len(corners)]
    errors = [float(np.linalg.norm(part.corners_px - corners, axis=1).max()) for part in alike]
    if not errors:
        return DetectedPart(np.full_like(corners, np.nan), {"none": 0.0}, 0.0), float("inf")
    return alike[int(np.argmin(errors))], min(errors)


def outline_of(name: str) -> FloatArray:
    canonical = BUILT_IN_CLASSES[name].canonical
    return SQUARE if canonical is None else canonical


@pytest.mark.parametrize("name", sorted(BUILT_IN_CLASSES))
def test_each_class_is_found_seen_obliquely_and_named(name: str) -> None:
    corners = oblique(outline_of(name))
    parts = list(make_detector(CLASSES).detect(picture((corners, BRIGHT if name == "OPEN" else DARK))))
    part, error = nearest(parts, corners)
    assert error < 0.5
    assert part.part_class == name
    assert part.class_scores[name] > 0.9
    assert sum(part.class_scores.values()) <= 1.0 + 1e-9


def test_a_bright_outline_of_many_corners_is_found_too() -> None:
    corners = oblique(outline_of("DW8T"))
    part, error = nearest(list(make_detector(CLASSES).detect(picture((corners, BRIGHT)))), corners)
    assert error < 0.5
    assert part.part_class == "DW8T"


def test_corners_start_where_the_class_starts() -> None:
    for name in ("DW6L", "DW6R", "DW12", "DW4"):
        corners = oblique(outline_of(name))
        part, _ = nearest(list(make_detector(CLASSES).detect(picture((corners, DARK)))), corners)
        np.testing.assert_allclose(part.corners_px, corners, atol=0.5)


def test_corners_are_unbiased_to_a_tenth_of_a_pixel() -> None:
    errors = []
    rng = np.random.default_rng(5)
    for seed in range(12):
        corners = oblique(SQUARE, *rng.uniform([40, 40, 60], [200, 120, 180]))
        part, _ = nearest(list(make_detector(CLASSES).detect(picture((corners, DARK), seed=seed))), corners)
        errors.append(part.corners_px - corners)
    assert np.abs(np.mean(errors, axis=(0, 1))).max() < 0.05
    assert np.median(np.linalg.norm(errors, axis=-1)) < 0.15


def test_a_window_that_may_be_either_is_found_brighter_and_darker() -> None:
    either = [BUILT_IN_CLASSES["DW4"]]
    for grey in (DARK, BRIGHT):
        part, error = nearest(list(make_detector(either).detect(picture((oblique(SQUARE), grey)))), oblique(SQUARE))
        assert error < 0.5
        assert part.class_scores["DW4"] > 0.99


def test_a_bright_quadrilateral_is_none_of_the_dark_classes() -> None:
    parts = list(make_detector([DW4_DARK]).detect(picture((oblique(SQUARE), BRIGHT))))
    assert all(part.class_scores["DW4"] < 0.1 for part in parts)


def test_a_small_part_of_twelve_pixels_is_found() -> None:
    corners = np.array([100.3, 90.7]) + np.array([[0.0, 0.0], [12.0, 1.0], [12.0, 13.5], [0.0, 12.0]])
    assert nearest(list(make_detector(CLASSES).detect(picture((corners, DARK)))), corners)[1] < 0.7


def test_parts_that_touch_the_border_are_left_out() -> None:
    cut = np.array([[-20.0, 60.0], [60.0, 60.0], [60.0, 160.0], [-20.0, 160.0]])
    assert not make_detector(CLASSES).detect(picture((cut, DARK), noise=0.0))


def test_leaning_quadrilaterals_are_no_parts_of_an_upright_camera() -> None:
    leaning = 100 + 120 * np.array([[0.2, 0.0], [1.2, 0.1], [1.0, 1.1], [0.0, 1.0]])
    upright = 100 + 120 * np.array([[0.1, 0.0], [1.1, 0.1], [1.1, 1.1], [0.1, 1.0]])
    assert not make_detector(CLASSES).detect(picture((leaning, DARK), noise=0.0))
    assert make_detector(CLASSES).detect(picture((upright, DARK), noise=0.0))


def test_nested_outlines_are_both_returned_and_the_outer_one_ranks_first() -> None:
    frame = np.array([[100.0, 80.0], [260.0, 80.0], [260.0, 280.0], [100.0, 280.0]])
    inner = frame + 16.0 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    parts = list(make_detector(CLASSES).detect(picture((frame, 105.0), (inner, 50.0))))
    (outer_part, outer_error), (inner_part, inner_error) = nearest(parts, frame), nearest(parts, inner)
    assert max(outer_error, inner_error) < 0.5
    assert outer_part is not inner_part
    assert outer_part.confidence > inner_part.confidence
    assert [part.confidence for part in parts] == sorted((part.confidence for part in parts), reverse=True)


def test_no_two_parts_are_the_same() -> None:
    parts = make_detector(CLASSES).detect(picture((oblique(SQUARE), DARK), (oblique(SQUARE, 320.0, 100.0, 80.0), DARK)))
    quads = [part.corners_px for part in parts if len(part.corners_px) == 4]
    gaps = [np.abs(a - b).max() for i, a in enumerate(quads) for b in quads[:i]]
    assert min(gaps, default=9.0) > 2.0


def test_a_window_that_differs_in_hue_alone_is_found() -> None:
    image = np.full((360, 480, 3), 120.0)
    draw_polygon(image, oblique(SQUARE), (85.0, 120.0, 138.0))
    either = [BUILT_IN_CLASSES["DW4"]]
    found = make_detector(either).detect(as_photo(image, np.random.default_rng(4), 1.0))
    assert nearest(list(found), oblique(SQUARE))[1] < 1.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 1, 3), (2, 9), (9, 9), (40, 3, 3), (64, 64), (64, 64, 3), (64, 64, 1)])
@pytest.mark.parametrize("grey", [0, 255])
def test_tiny_black_and_white_pictures_hold_no_parts(shape: tuple[int, ...], grey: int) -> None:
    assert not make_detector(CLASSES).detect(np.full(shape, grey, np.uint8))


def test_noise_alone_gives_few_parts_of_little_confidence() -> None:
    noise = np.random.default_rng(3).normal(128, 12, (360, 480, 3)).clip(0, 255).astype(np.uint8)
    parts = make_detector(CLASSES).detect(noise)
    assert len(parts) <= 30
    assert all(part.confidence < 0.1 for part in parts)


def test_grey_and_colour_pictures_give_the_same_parts() -> None:
    grey = picture((oblique(SQUARE), DARK))
    colour = np.repeat(grey[..., None], 3, axis=2)
    a, b = (nearest(list(make_detector(CLASSES).detect(p)), oblique(SQUARE))[0] for p in (grey, colour))
    np.testing.assert_allclose(a.corners_px, b.corners_px, atol=0.1)


def test_the_picture_is_left_as_it_was() -> None:
    image = picture((oblique(SQUARE), DARK))
    before = image.copy()
    make_detector(CLASSES).detect(image)
    assert np.array_equal(image, before)


@pytest.mark.parametrize("bad", [np.zeros((9, 9)), np.zeros((9, 9, 4), np.uint8), np.zeros(9, np.uint8)])
def test_what_is_no_8_bit_picture_is_refused(bad: npt.NDArray[Any]) -> None:
    with pytest.raises(InputError, match="cannot be searched"):
        make_detector(CLASSES).detect(bad)


def test_rendered_views_meet_the_figures() -> None:
    """Recall >= 98 %, corner error median <= 0.3 px, class right >= 99 %, on 24 views of all three buildings."""
    base = load_model_base("architecture")
    detector = make_detector(base.classes)
    rng = np.random.default_rng(7)
    total, errors, right = 0, [], []
    for number, thing in enumerate(base.objects):
        rig = rendered_rig(draw_scene(base, thing.id, 40 + number), distances_mm=(200, 350, 600), size=(960, 720))
        poses = rig.reachable()
        for index in rng.choice(len(poses), 8, replace=False):
            rig.move_to(poses[index])
            image = rig.capture().image
            parts = list(detector.detect(image))
            for seen in rig.parts():
                corners = seen.corners_px
                inside = (corners >= 2).all() and (corners <= np.array([957, 717])).all()
                if not inside or seen.visible_fraction < 0.999 or np.ptp(corners, axis=0).min() < 12:
                    continue
                total += 1
                part, error = nearest(parts, corners)
                if error < 3.0:
                    errors.extend(np.linalg.norm(part.corners_px - corners, axis=1))
                    right.append(part.part_class == seen.part_class)
    assert total >= 60
    assert len(right) >= 0.98 * total
    assert np.median(errors) <= 0.3
    assert np.mean(right) >= 0.99


@pytest.mark.realdata
def test_castle_windows_are_found_among_the_first_hundred(real_data: Path) -> None:
    """On every 25th photograph at least two in three of the confirmed windows, wide and tele together."""
    castle = real_data / "castle"
    detector = make_detector(load_model_base(castle / "modelbase.yaml").classes)
    found: list[bool] = []
    for line in (castle / "truth.jsonl").read_text().splitlines()[::25]:
        truth = json.loads(line)
        parts = detector.detect(np.asarray(cv2.imread(str(castle / truth["file"])), dtype=np.uint8))[:100]
        for part in truth["parts"]:
            if part["edges_confirmed"] == 4 and part["fully_in_frame"] and part["state"] != "near_vehicle":
                corners = np.array(part["corners_px"])
                found.append(any(np.linalg.norm(p.corners_px - corners, axis=1).max() < 3 for p in parts))
    assert len(found) > 40
    assert np.mean(found) > 0.67
