"""A map of SIFT points from photographs whose poses are known, from which any of them can be left out afterwards.

Photographs are matched in pairs that show the same from different places; a match that lies on its epipolar line gives
both features the same point. A feature's point is triangulated from all its matches in the photographs that may be
used, by linear least squares, and kept where its views are far enough apart and agree. Lengths are metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose, rotation_y

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MOST_FEATURES = 2000
RATIO = 0.8
"""Lowe's: the best match must be so much nearer than the second."""
EPIPOLAR_PX, AGREE_PX = 2.0, 2.0
LEAST_ANGLE_DEG = 1.5
PARTNERS = 12
SAME_PLACE_M = 0.5
_DEPTHS_M = (8.0, 15.0, 25.0, 40.0)


@dataclass(frozen=True)
class Reference:
    """A photograph with known pose and internals: the file, the camera in the object frame, fx, fy, u0, v0."""

    file: str
    camera: CameraPose
    internals: FloatArray
    zoom: float
    size: tuple[int, int]

    @property
    def rotation(self) -> FloatArray:
        """``(3, 3)`` object -> camera."""
        return rotation_y(np.radians(self.camera.theta_deg))

    @property
    def centre_m(self) -> FloatArray:
        """``(3,)``."""
        return self.camera.centre_mm / 1000.0


@dataclass(frozen=True)
class Features:
    """Of one photograph: pixels ``(n, 2)`` and unit descriptors ``(n, 128)`` (RootSIFT), largest first."""

    pixels: FloatArray
    descriptors: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Observations:
    """Which feature was seen where else, a row each, both ways round: photograph and feature, and the other's."""

    image: IntArray
    feature: IntArray
    other_image: IntArray
    other_feature: IntArray


@dataclass(frozen=True)
class SiftMap:
    """All photographs, their features, and what was matched among them."""

    references: Sequence[Reference]
    features: Sequence[Features]
    seen: Observations


def detect(path: Path) -> Features:
    """SIFT as OpenCV has it; square roots of descriptors (Arandjelovic and Zisserman, CVPR 2012) match better."""
    import cv2

    keypoints, found = cv2.SIFT_create(MOST_FEATURES).detectAndCompute(
        cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), None
    )
    if found is None:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32))
    order = np.argsort([-k.size for k in keypoints], kind="stable")
    root = np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-9))
    pixels = np.array([k.pt for k in keypoints], dtype=np.float64)
    return Features(pixels[order], np.ascontiguousarray(root[order], dtype=np.float32))


def match(one: npt.NDArray[np.float32], other: npt.NDArray[np.float32]) -> IntArray:
    """Pairs ``(m, 2)`` of descriptors that are each other's nearest and pass the ratio test."""
    if len(one) < 2 or len(other) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    likeness = one @ other.T
    rows = np.arange(len(one))
    best = likeness.argmax(axis=1)
    back = likeness.argmax(axis=0)
    top = likeness[rows, best]
    likeness[rows, best] = -1.0
    # Of unit vectors: squared distance 2 - 2 cos.
    near, next_near = (np.sqrt(np.maximum(2.0 - 2.0 * c, 0.0)) for c in (top, likeness.max(axis=1)))
    good = (back[best] == rows) & (near < RATIO * next_near)
    return np.column_stack([rows[good], best[good]])


def build(references: Sequence[Reference], features: Sequence[Features]) -> SiftMap:
    """Match each photograph with those that show most of the same from elsewhere."""
    rows: list[IntArray] = []
    for i, j in sorted(partners(references)):
        pairs = match(features[i].descriptors, features[j].descriptors)
        pairs = pairs[on_line(references[i], references[j], features[i].pixels, features[j].pixels, pairs)]
        a, b = pairs.T
        rows.append(np.column_stack([np.full_like(a, i), a, np.full_like(b, j), b]))
        rows.append(np.column_stack([np.full_like(b, j), b, np.full_like(a, i), a]))
    table = np.concatenate(rows) if rows else np.zeros((0, 4), dtype=np.int64)
    return SiftMap(references, features, Observations(*table.T))


def partners(references: Sequence[Reference]) -> set[tuple[int, int]]:
    """Pairs worth matching: for each photograph those that see most of a few points before it, from other places."""
    chosen = set()
    for i, one in enumerate(references):
        before = _points_before(one)
        shared = []
        for other in references:
            apart = float(np.linalg.norm(one.centre_m - other.centre_m))
            alike = np.cos(np.radians(one.camera.theta_deg - other.camera.theta_deg))
            shared.append(_share_in_view(other, before) if apart > SAME_PLACE_M and alike > 0.6 else 0.0)
        for j in np.argsort(shared)[::-1][:PARTNERS]:
            if shared[j] > 0.2:
                chosen.add((min(i, int(j)), max(i, int(j))))
    return chosen


def _points_before(one: Reference) -> FloatArray:
    width, height = one.size
    u, v, z = np.meshgrid(np.linspace(0, width, 5), np.linspace(0, height, 4), _DEPTHS_M)
    rays = np.column_stack([((u - one.internals[2]) / one.internals[0]).ravel(), np.zeros(u.size), np.ones(u.size)])
    rays[:, 1] = ((v - one.internals[3]) / one.internals[1]).ravel()
    return np.asarray((rays * z.ravel()[:, None]) @ one.rotation + one.centre_m)


def _share_in_view(one: Reference, points: FloatArray) -> float:
    seen = (points - one.centre_m) @ one.rotation.T
    pixels = one.internals[:2] * seen[:, :2] / np.maximum(seen[:, 2:], 1e-6) + one.internals[2:]
    inside = (seen[:, 2] > 1.0) & (pixels > 0).all(axis=1) & (pixels < one.size).all(axis=1)
    return float(inside.mean())


def on_line(one: Reference, other: Reference, first: FloatArray, second: FloatArray, pairs: IntArray) -> BoolArray:
    """Which pairs lie within ``EPIPOLAR_PX`` of their epipolar lines (Sampson's distance)."""
    turn = other.rotation @ one.rotation.T
    move = other.rotation @ (one.centre_m - other.centre_m)
    cross = np.array([[0, -move[2], move[1]], [move[2], 0, -move[0]], [-move[1], move[0], 0]])
    fundamental = np.linalg.inv(_matrix(other)).T @ cross @ turn @ np.linalg.inv(_matrix(one))
    x, y = (np.column_stack([p[pairs[:, k]], np.ones(len(pairs))]) for k, p in enumerate((first, second)))
    along, back = x @ fundamental.T, y @ fundamental
    off = np.einsum("ni,ni->n", y, along) ** 2
    return np.asarray(off < EPIPOLAR_PX**2 * ((along[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)))


def _matrix(one: Reference) -> FloatArray:
    fx, fy, u0, v0 = one.internals
    return np.array([[fx, 0, u0], [0, fy, v0], [0, 0, 1.0]])


@dataclass(frozen=True)
class Known:
    """Features with points: photograph ``(k,)``, feature ``(k,)``, place ``(k, 3)`` in metres, sorted by photograph."""

    image: IntArray
    feature: IntArray
    points_m: FloatArray


def triangulated(sift: SiftMap, left_out: Sequence[int]) -> Known:
    """Points of all features, from the photographs that are not left out."""
    out = np.zeros(len(sift.references), dtype=bool)
    out[list(left_out)] = True
    seen = sift.seen
    use = ~out[seen.image] & ~out[seen.other_image]
    first = np.cumsum([0, *(len(f.pixels) for f in sift.features)])
    keys, group = np.unique(first[seen.image[use]] + seen.feature[use], return_inverse=True)
    image = np.searchsorted(first, keys, side="right") - 1
    feature = keys - first[image]
    # Every feature is an observation of its own point, beside those in the others.
    images = np.concatenate([image, seen.other_image[use]])
    features = np.concatenate([feature, seen.other_feature[use]])
    owner = np.concatenate([np.arange(len(keys)), group])
    pixels = np.concatenate([f.pixels for f in sift.features])[first[images] + features]
    points, good = intersect([sift.references[k] for k in range(len(out))], images, pixels, owner, len(keys))
    return Known(image[good], feature[good], points[good])


def intersect(
    references: Sequence[Reference], images: IntArray, pixels: FloatArray, owner: IntArray, count: int
) -> tuple[FloatArray, BoolArray]:
    """Points ``(count, 3)`` nearest to the rays of their observations, and which of them are to be trusted."""
    rotations = np.array([r.rotation for r in references])[images]
    centres = np.array([r.centre_m for r in references])[images]
    internals = np.array([r.internals for r in references])[images]
    rays = np.column_stack([(pixels - internals[:, 2:]) / internals[:, :2], np.ones(len(pixels))])
    rays = np.einsum("nji,nj->ni", rotations, rays)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    normal, right, direction = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    np.add.at(normal, owner, across)
    np.add.at(right, owner, np.einsum("nij,nj->ni", across, centres))
    np.add.at(direction, owner, rays)
    points = np.linalg.solve(normal + 1e-9 * np.eye(3), right[..., None])[..., 0]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    narrowest, worst = np.ones(count), np.zeros(count)
    np.minimum.at(narrowest, owner, np.einsum("ni,ni->n", rays, direction[owner]))
    place = np.einsum("nij,nj->ni", rotations, points[owner] - centres)
    off = internals[:, :2] * place[:, :2] / np.maximum(place[:, 2:], 1e-6) + internals[:, 2:] - pixels
    np.maximum.at(worst, owner, np.where(place[:, 2] > 0.5, np.linalg.norm(off, axis=1), np.inf))
    return points, (worst < AGREE_PX) & (narrowest < np.cos(np.radians(LEAST_ANGLE_DEG / 2)))
