"""Tells the part-class of outlines: canonical-frame invariants, upright sides, and brightness against the wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.detectors.profiles import sample
from recognition.modelbase import PartClass

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_EPS = 1e-9
_STEPS = np.linspace(-0.3, 0.3, 7)
_INNER = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 2)
"""Where the grey level near the centroid is taken, the corners being at -1 and 1."""
_SIDE = np.stack([np.linspace(-1.0, 1.0, 9), np.full(9, 1.3)], axis=-1)
_AROUND = np.concatenate([_SIDE, -_SIDE, _SIDE[:, ::-1], -_SIDE[:, ::-1]])
"""Where the wall's is taken."""


def upright_sides(polygons: FloatArray, vertical: npt.NDArray[np.bool_], tolerance_deg: float) -> npt.NDArray[np.bool_]:
    """``(K,)``: the sides marked in ``vertical`` ``(n,)`` of polygons ``(K, n, 2)`` are vertical in the picture.

    Side i runs from corner i to corner i + 1. An upright camera shows vertical edges vertical; corners that are not
    refined yet may be off by a pixel at either end.
    """
    side = (np.roll(polygons, -1, axis=1) - polygons)[:, vertical]
    allowed = np.tan(np.radians(tolerance_deg)) * np.abs(side[..., 1]) + 1.5
    return np.asarray((np.abs(side[..., 0]) <= allowed).all(axis=1) & (np.abs(side[..., 1]) > 3.0).all(axis=1))


def order_quadrilaterals(quads: FloatArray) -> FloatArray:
    """Quadrilaterals ``(K, 4, 2)``, clockwise, turned so that they start at the upper end of their left side."""
    left_side = quads[..., 0] + np.roll(quads[..., 0], -1, axis=1)  # of side i, corner i to i + 1
    first = (np.argmin(left_side, axis=1) + 1) % 4  # the left side runs upwards, so it ends top-left
    turned = (first[:, None] + np.arange(4)) % 4
    return np.take_along_axis(quads, turned[..., None], axis=1)


@dataclass(frozen=True, slots=True)
class Shape:
    """A part-class with more than four corners, ready for comparison.

    Attributes:
        name: of the class.
        canonical: ``(n, 2)``.
        vertical: ``(n,)`` which sides are vertical.
    """

    name: str
    canonical: FloatArray
    vertical: npt.NDArray[np.bool_]

    @staticmethod
    def of(part_class: PartClass) -> Shape:
        """Of a class that has canonical corners."""
        assert part_class.canonical is not None
        side = np.roll(part_class.canonical, -1, axis=0) - part_class.canonical
        return Shape(part_class.name, part_class.canonical, np.abs(side[:, 0]) < 1e-6)


def best_turns(polygons: FloatArray, shape: Shape, tolerance_deg: float = 5.0) -> tuple[FloatArray, FloatArray]:
    """Turn polygons ``(K, n, 2)`` so that they start at the class's first corner, and tell how well they fit.

    The invariants of the canonical frame: a homography from four corners takes the others to the class's own places
    (paper, section on part recognition); here it is the least-squares one of all corners, which is less noisy.

    Returns:
        The polygons turned, and per polygon the root mean square distance ``(K,)`` in pixels between its corners and
        the class's corners mapped into the picture (infinite where no turn has upright vertical sides).
    """
    n = len(shape.canonical)
    best, error = polygons.copy(), np.full(len(polygons), np.inf)
    for turn in range(n):
        turned = np.roll(polygons, -turn, axis=1)
        upright = upright_sides(turned, shape.vertical, tolerance_deg)
        if not upright.any():
            continue
        distance = np.full(len(polygons), np.inf)
        distance[upright] = homography_errors(shape.canonical, turned[upright])
        better = distance < error
        best[better], error[better] = turned[better], distance[better]
    return best, error


def homography_errors(canonical: FloatArray, polygons: FloatArray) -> FloatArray:
    """Root mean square distance ``(K,)``, pixels, after the algebraic least-squares homography canonical -> picture."""
    k, n = polygons.shape[:2]
    centre = polygons.mean(axis=1, keepdims=True)
    scale = np.abs(polygons - centre).max(axis=(1, 2), keepdims=True) + _EPS
    u, v = np.moveaxis((polygons - centre) / scale, -1, 0)
    x, y = (2 * canonical - 1).T
    rows = np.zeros((k, 2 * n, 9))
    rows[:, :n, :3] = rows[:, n:, 3:6] = np.stack([x, y, np.ones(n)], axis=-1)
    for start, w in ((0, u), (n, v)):
        rows[:, start : start + n, 6:] = -w[..., None] * np.stack([x, y, np.ones(n)], axis=-1)
    h = np.linalg.svd(rows)[2][:, -1].reshape(k, 3, 3)
    mapped = np.einsum("kij,nj->kni", h, np.stack([x, y, np.ones(n)], axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = mapped[..., :2] / mapped[..., 2:] - np.stack([u, v], axis=-1)
    distance = np.sqrt((gap**2).sum(axis=-1).mean(axis=-1)) * scale[:, 0, 0]
    same_side = (mapped[..., 2] > 0).all(axis=1) | (mapped[..., 2] < 0).all(axis=1)
    return np.where(same_side & np.isfinite(distance), distance, np.inf)


def inside_and_wall(planes: Float32Array, quads: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Median grey level near the centroid and on the wall around, each ``(K,)``, of quadrilaterals ``(K, 4, 2)``."""
    import cv2

    greys = (sample(planes[..., :1].copy(), _places(at, quads), cv2.INTER_NEAREST)[..., 0] for at in (_INNER, _AROUND))
    inside, wall = (np.median(grey, axis=1).astype(np.float64) for grey in greys)
    return inside, wall


def _places(at: FloatArray, quads: FloatArray) -> FloatArray:
    """Pixels ``(K, m, 2)`` of places ``(m, 2)`` in quadrilaterals whose corners are at -1 and 1, bilinearly."""
    x, y = at.T
    weights = np.stack([(1 - x) * (1 - y), (1 + x) * (1 - y), (1 + x) * (1 + y), (1 - x) * (1 + y)]) / 4
    return np.asarray(np.einsum("cm,kcd->kmd", weights, quads))


def four_corner_scores(
    classes: Sequence[PartClass], inside: FloatArray, wall: FloatArray, softness: float = 0.06
) -> dict[str, FloatArray]:
    """Probabilities ``(K,)`` of the four-corner classes from the grey level near the centroid against the wall's.

    The probability of being brighter is a logistic function of the logarithm of the ratio; classes that may be either
    share what the others leave, and what fits no class is "none of these".
    """
    bright = 1.0 / (1.0 + np.exp(-np.clip(np.log((inside + 2.0) / (wall + 2.0)) / softness, -30, 30)))
    fits = {c.name: np.ones_like(bright) if c.bright is None else bright if c.bright else 1 - bright for c in classes}
    total = sum(fits.values(), np.zeros_like(bright))
    return {name: fit / np.maximum(total, 1.0) for name, fit in fits.items()}
