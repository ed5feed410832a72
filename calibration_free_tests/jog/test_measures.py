"""Sharpness and exposure are what a person steers focus and light by."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration_free_tests.guard.sample import bench
from calibration_free_tests.jog.bench import windows
from rig.devices import Picture
from rig.errors import HardwareError
from rig.hal import Image
from rig.jog.looking import LARGEST_PX, Looker, shrunk
from rig.jog.measures import exposure, sharpness

SHARP = windows(0, bench())


def flat(value: int) -> Image:
    return np.full((40, 60), value, np.uint8)


def test_sharpness_falls_with_every_bit_of_blur() -> None:
    blurred = [SHARP, *(np.asarray(cv2.GaussianBlur(SHARP, (0, 0), sd), np.uint8) for sd in (0.7, 1.0, 2.0, 4.0))]
    values = [sharpness(image) for image in blurred]
    assert values == sorted(values, reverse=True)
    assert values[0] > 4 * values[-1]


def test_sharpness_does_not_change_with_the_exposure() -> None:
    half = np.asarray(SHARP // 2, np.uint8)
    assert sharpness(half) == pytest.approx(sharpness(SHARP), rel=0.03)


def test_a_picture_without_structure_or_light_has_no_sharpness() -> None:
    assert sharpness(flat(0)) == sharpness(flat(90)) == 0.0


def test_exposure_counts_black_and_clipped_pixels() -> None:
    image = flat(128)
    image[:10], image[10:14] = 0, 255
    told = exposure(image)
    assert (told.dark, told.bright) == (0.25, 0.1)
    assert told.mean == pytest.approx(float(image.mean()) / 255)


def test_one_clipped_channel_is_clipped() -> None:
    image = np.zeros((10, 10, 3), np.uint8)
    image[..., 2] = 255
    assert exposure(image).bright == 1.0


@pytest.mark.parametrize(
    ("value", "verdict"), [(4, "too dark"), (128, "good"), (230, "over-exposed"), (255, "over-exposed")]
)
def test_the_verdict_is_a_word(value: int, verdict: str) -> None:
    assert exposure(flat(value)).verdict == verdict


def test_a_picture_is_looked_at_once_and_its_sharpness_has_a_course() -> None:
    pictures = iter([None, *(Picture(SHARP, n, float(n)) for n in (1, 1, 2, 4))])
    looker = Looker(lambda: next(pictures))
    for _ in range(5):
        looker.refresh()
    assert looker.look is not None
    assert (looker.look.sequence, looker.look.exposed_at_s, len(looker.look.course)) == (4, 4.0, 3)


def test_a_camera_that_fails_leaves_the_last_look() -> None:
    def fails() -> Picture:
        raise HardwareError("unplugged")

    looker = Looker(fails)
    looker.refresh()
    assert looker.look is None


def test_large_pictures_are_shown_small_and_small_ones_as_they_are() -> None:
    large = np.zeros((1000, 4000, 3), np.uint8)
    assert shrunk(large, LARGEST_PX).shape == (160, 640, 3)
    assert shrunk(SHARP, LARGEST_PX) is SHARP
