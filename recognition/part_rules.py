"""What makes a part's corners unusable: rules on many polygons at once, each with the words to say it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

REPEATED = 1e-3
"""Two corners nearer than this share of the part's size are one corner."""
NARROW = 1e-2
"""A part narrower than this share of its length is a line."""
STRAIGHT_SINE = float(np.sin(np.radians(2.0)))
"""A corner that turns by less than this (or turns back on itself) is no corner."""
OUT_OF_PLANE = 0.02
"""Corners may leave their plane by this share of the part's size (real walls are not flat)."""
OUTLINE_ERROR = 0.08
"""Corners may leave their class' outline by this share of its sides; more is another shape or another order."""
UPRIGHT = 0.5
"""The side of a part on an upright wall that the class draws downwards must go down with at least this cosine."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule that all parts must keep: ``broken`` maps ``(n, k, 3)`` corners to ``(n,)``; message and remedy say it."""

    broken: Callable[[FloatArray], BoolArray]
    message: str
    remedy: str


def size(corners: FloatArray) -> FloatArray:
    """``(n,)`` diagonal of the box around ``(n, k, 3)`` corners."""
    return np.asarray(np.linalg.norm(np.ptp(corners, axis=1), axis=1))


def area_normals(corners: FloatArray) -> FloatArray:
    """``(n, 3)`` unit normals towards whoever sees the corners ``(n, k, 3)`` clockwise; zero without area."""
    area = -np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(area, axis=1, keepdims=True)
    return np.asarray(np.divide(area, length, out=np.zeros_like(area), where=length > 0))


def sizes_and_normals(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """`size` ``(n,)`` and `area_normals` ``(n, 3)`` of n polygons of any numbers of corners, ``(k, 3)`` each."""
    counts = np.array([len(corners) for corners in polygons])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    points = np.concatenate(polygons)
    following = np.arange(1, len(points) + 1)
    following[starts + counts - 1] = starts
    extent = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
    area = -np.add.reduceat(np.cross(points, points[following]), starts)
    length = np.linalg.norm(area, axis=1, keepdims=True)
    normals = np.divide(area, length, out=np.zeros_like(area), where=length > 0)
    return np.linalg.norm(extent, axis=1), normals


def repeats_a_corner(corners: FloatArray) -> BoolArray:
    """Two corners, neighbours or not, are in the same place."""
    first, second = np.triu_indices(corners.shape[1], 1)
    gaps = np.linalg.norm(corners[:, first] - corners[:, second], axis=2)
    return np.asarray(gaps.min(axis=1) <= REPEATED * size(corners))


def is_a_line(corners: FloatArray) -> BoolArray:
    """All corners lie on one line, or so near that their plane is not known."""
    spread = np.linalg.svd(corners - corners.mean(axis=1, keepdims=True), compute_uv=False)
    return np.asarray(spread[:, 1] <= NARROW * spread[:, 0])


def has_a_straight_corner(corners: FloatArray) -> BoolArray:
    """Three corners in a row lie on one line, so that the middle one cannot be seen."""
    before = corners - np.roll(corners, 1, axis=1)
    after = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(before, axis=2) * np.linalg.norm(after, axis=2)
    return np.asarray((np.linalg.norm(np.cross(before, after), axis=2) <= STRAIGHT_SINE * lengths).any(axis=1))


def leaves_its_plane(corners: FloatArray) -> BoolArray:
    """Some corner is off the plane through the others."""
    centred = corners - corners.mean(axis=1, keepdims=True)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    return np.asarray(np.abs(np.einsum("nki,ni->nk", centred, axes[:, 2])).max(axis=1) > OUT_OF_PLANE * size(corners))


def crosses_itself(corners: FloatArray) -> BoolArray:
    """Two sides that do not share a corner meet."""
    centred = corners - corners.mean(axis=1, keepdims=True)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    start = np.einsum("nki,nji->nkj", centred, axes[:, :2])
    end = np.roll(start, -1, axis=1)
    k = corners.shape[1]
    crossing = np.zeros(len(corners), dtype=np.bool_)
    for i in range(k - 2):
        for j in range(i + 2, k if i > 0 else k - 1):
            sides = (start[:, i], end[:, i], start[:, j], end[:, j])
            crossing |= _apart(*sides) & _apart(sides[2], sides[3], sides[0], sides[1]) & _boxes_meet(*sides)
    return crossing


def _apart(a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray) -> BoolArray:
    """True where p and q are not strictly on the same side of the line through a and b."""
    side = b - a
    left = side[:, 0] * (p - a)[:, 1] - side[:, 1] * (p - a)[:, 0]
    right = side[:, 0] * (q - a)[:, 1] - side[:, 1] * (q - a)[:, 0]
    return np.asarray(left * right <= 0)


def _boxes_meet(a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray) -> BoolArray:
    """True where the boxes around two sides meet; sides on one line (as in a cross) may still be apart."""
    below = np.maximum(a, b) < np.minimum(p, q)
    above = np.minimum(a, b) > np.maximum(p, q)
    return np.asarray(~(below | above).any(axis=1))


def misses_its_outline(corners: FloatArray, outline: FloatArray) -> BoolArray:
    """The corners ``(n, k, 3)`` are not an affine image of the class' outline ``(k, 2)``, in its order."""
    sides, residual = _fit(corners, outline)
    shortest = np.linalg.norm(sides, axis=2).min(axis=1)
    return np.asarray(np.abs(residual).max(axis=(1, 2)) > OUTLINE_ERROR * shortest)


def starts_at_the_wrong_corner(corners: FloatArray, outline: FloatArray) -> BoolArray:
    """On an upright wall, the outline's downward side does not go down: wrong first corner, or anticlockwise."""
    down = _fit(corners, outline)[0][:, 1]
    upright_wall = np.abs(area_normals(corners)[:, 1]) < 0.7
    return np.asarray(upright_wall & (down[:, 1] < UPRIGHT * np.linalg.norm(down, axis=1)))


def _fit(corners: FloatArray, outline: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least-squares sides ``(n, 2, 3)`` of the unit square's image, and residuals ``(n, k, 3)``."""
    centred = corners - corners.mean(axis=1, keepdims=True)
    flat = outline - outline.mean(axis=0)
    sides = np.einsum("jk,nki->nji", np.linalg.pinv(flat), centred)
    return sides, centred - np.einsum("kj,nji->nki", flat, sides)


UNIT_SQUARE: FloatArray = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])

POLYGON_RULES: tuple[Rule, ...] = (
    Rule(repeats_a_corner, "two corners are in the same place", "Give each corner once."),
    Rule(is_a_line, "all corners lie on one line", "Corners must span an area."),
    Rule(
        has_a_straight_corner,
        "three neighbouring corners lie on one line",
        "Leave the middle one out: it cannot be seen.",
    ),
    Rule(
        leaves_its_plane,
        f"the corners leave their plane by more than {OUT_OF_PLANE:.0%} of the part's size",
        "Split the part, or check the coordinates.",
    ),
    Rule(
        crosses_itself, "two sides cross each other", "List the corners in the order in which they follow each other."
    ),
)
"""Rules on the corners alone, in the order in which they are to be tried (each takes the ones before for granted)."""


def broken_rotation(rotation: FloatArray) -> str | None:
    """Why a ``(3, 3)`` matrix is no rotation, or None if it is one."""
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if off > 1e-6:
        return f"the rows are not at right angles and of length 1 (|R'R - I| = {off:.2g}, at most 1e-6)"
    if np.linalg.det(rotation) < 0:
        return "this is a reflection (its determinant is -1)"
    return None
