"""Batched refinement: exact on clean corners, honest about its uncertainty, indifferent to padding and to outliers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.pose.scenes import SIZE, TWO_FACES
from recognition.geometry import rotation_y
from recognition.priors import Priors
from recognition.varpro import Refined, refine_batch

FloatArray = npt.NDArray[np.float64]
CAMERAS = np.array([[0.0, 0, 0, 0], [np.radians(12), -40, 5, 10], [np.radians(-9), 30, -10, -15]])
SPREAD = np.array([0.08, 8.0, 8.0, 20.0])


def views(
    rng: np.random.Generator, h: int, noise_px: float, shared: bool, n_views: int = 3
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
    """True placements ``(h, 4)``, pixels ``(h, 12 n_views, 2)`` and view of each point, internals drawn at random."""
    phi, z = np.radians(rng.uniform(30, 60, h)), rng.uniform(200, 400, h)
    centre = np.stack([rng.uniform(-20, 20, h), rng.uniform(-20, 20, h), z], axis=1)
    shift = centre - rotation_y(phi) @ TWO_FACES.mean(axis=0)
    world = TWO_FACES @ rotation_y(phi).transpose(0, 2, 1) + shift[:, None]
    pixels = []
    internals = random_internals(rng, z)
    for camera in CAMERAS[:n_views]:
        seen = (world - camera[1:]) @ rotation_y(camera[0]).T
        pixels.append(internals[:, None, :2] * seen[..., :2] / seen[..., 2:] + internals[:, None, 2:])
        internals = internals if shared else random_internals(rng, z)
    noisy = np.concatenate(pixels, axis=1)
    noisy += noise_px * rng.standard_normal(noisy.shape)
    view = np.broadcast_to(np.repeat(np.arange(n_views), len(TWO_FACES)), noisy.shape[:2])
    return np.concatenate([phi[:, None], shift], axis=1), noisy, view.astype(np.int64)


def random_internals(rng: np.random.Generator, distance: FloatArray) -> FloatArray:
    f = distance * rng.uniform(5, 8, len(distance))
    aspect = np.exp(0.005 * rng.standard_normal(len(f)))
    return np.stack([f, f * aspect, 640 + 30 * rng.standard_normal(len(f)), 480 + 30 * rng.standard_normal(len(f))], 1)


def refine(start: FloatArray, pixels: FloatArray, view: npt.NDArray[np.int64], **options: Any) -> Refined:
    """``refine_batch`` on the two faces, one weight for all, internals free in each view unless ``group`` is given."""
    h, n = pixels.shape[:2]
    points = np.broadcast_to(np.tile(TWO_FACES, (n // len(TWO_FACES), 1)), (h, n, 3))
    sigma = float(options.pop("sigma_px", 1.0))
    group = options.pop("group", np.arange(3))
    weight = options.pop("weight", np.full((h, n), 1.0 / sigma))
    return refine_batch(start, points, pixels, weight, view, CAMERAS, group, **options)


@pytest.mark.parametrize("group", [[0, 1, 2], [0, 0, 0]])
def test_clean_corners_give_the_placement_back(rng: np.random.Generator, group: list[int]) -> None:
    truth, pixels, view = views(rng, 50, 0.0, shared=group == [0, 0, 0])
    start = truth + SPREAD * rng.standard_normal(truth.shape)
    found = refine(start, pixels, view, group=np.array(group), iterations=50, tolerance=1e-15)
    assert found.valid.all()
    np.testing.assert_allclose(found.placement, truth, atol=1e-6)


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("priors", [None, Priors(image_size=SIZE)])
def test_the_covariance_tells_the_spread(rng: np.random.Generator, shared: bool, priors: Priors | None) -> None:
    truth, pixels, view = views(rng, 600, 0.5, shared)
    group = np.zeros(3, dtype=int) if shared else np.arange(3)
    found = refine(truth, pixels, view, group=group, sigma_px=0.5, priors=priors, iterations=20)
    error = found.placement - truth
    nees = np.einsum("ha,hab,hb->h", error, np.linalg.inv(found.covariance), error)
    assert 3.5 < nees.mean() < 4.6  # expected: 4, the degrees of freedom


def test_padding_changes_nothing(rng: np.random.Generator) -> None:
    truth, pixels, view = views(rng, 5, 0.5, shared=False)
    plain = refine(truth, pixels, view)
    padded = np.concatenate([pixels, np.full((5, 12, 2), 1e4)], axis=1)
    weight = np.concatenate([np.ones((5, 36)), np.zeros((5, 12))], axis=1)
    view = np.concatenate([view, np.zeros((5, 12), dtype=np.int64)], axis=1)
    other = refine(truth, padded, view, weight=weight)
    np.testing.assert_allclose(other.placement, plain.placement, atol=1e-9)
    np.testing.assert_allclose(other.covariance, plain.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(other.rms_px, plain.rms_px, rtol=1e-9)


def test_an_outlying_corner_loses_its_pull(rng: np.random.Generator) -> None:
    truth, pixels, view = views(rng, 100, 0.5, shared=True)
    pixels[:, 5] += [25.0, -15.0]
    group = np.zeros(3, dtype=int)
    start = truth + 0.3 * SPREAD * rng.standard_normal(truth.shape)
    robust = refine(start, pixels, view, group=group, sigma_px=0.5, tail_sd=3.0, iterations=30)
    plain = refine(start, pixels, view, group=group, sigma_px=0.5, iterations=30)
    off = np.abs(robust.placement - truth)[:, 3], np.abs(plain.placement - truth)[:, 3]
    assert np.median(off[0]) < 0.3 * np.median(off[1])


def test_points_behind_a_camera_and_negative_focal_lengths_are_not_valid(rng: np.random.Generator) -> None:
    truth, pixels, view = views(rng, 1, 0.0, shared=True)
    behind = truth * [1, 1, 1, -1]
    assert not refine(behind, pixels, view).valid.any()
    mirrored = pixels * [-1, 1]
    assert not refine(truth, mirrored, view, group=np.zeros(3, dtype=int), iterations=0).valid.any()


def test_a_placement_prior_adds_what_it_knows(rng: np.random.Generator) -> None:
    truth, pixels, view = views(rng, 3, 0.5, shared=False, n_views=1)
    precision = np.broadcast_to(np.diag([1e4, 1.0, 1.0, 4.0]), (3, 4, 4))
    found = refine(truth, pixels, view, placement_prior=(truth, precision), sigma_px=0.5)
    plain = refine(truth, pixels, view, sigma_px=0.5)
    assert np.all(found.covariance[:, 3, 3] < np.minimum(plain.covariance[:, 3, 3], 0.25))


def test_priors_lose_to_data_far_from_what_they_expect(rng: np.random.Generator) -> None:
    truth, pixels, view = views(rng, 40, 0.3, shared=True)
    shifted = pixels + np.array([0.0, 360.0])
    group = np.zeros(3, dtype=int)
    found = refine(truth, shifted, view, group=group, sigma_px=0.3, priors=Priors(image_size=SIZE), iterations=30)
    np.testing.assert_allclose(found.internals[:, 0, 3], 840, atol=110)
    error = found.placement - truth
    nees = np.einsum("ha,hab,hb->h", error, np.linalg.inv(found.covariance), error)
    assert np.median(nees) < 6
