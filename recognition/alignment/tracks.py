"""Follows points of a fixed target through pictures: SIFT features, matched between near views, joined to tracks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.alignment.moves import Moves
from rig.hal import Image

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_LONGEST_SIDE = 1600  # larger pictures are halved and so on: features are no better there, only slower
_FEATURES = 1500
_RATIO = 0.75  # of the distances to the best and the second-best match (Lowe's test)
_NEIGHBOURS = 8
_LEAST_MATCHES = 12
_OFF_EPIPOLAR_PX = 2.0


@dataclass(frozen=True, slots=True)
class Tracks:
    """Where points of the target were seen; M observations of N points, sorted by point.

    Attributes:
        pixels: ``(M, 2)``.
        view: ``(M,)`` index of the view; a point is seen at most once in a view.
        point: ``(M,)`` index of the point, 0 .. N-1, rising.
    """

    pixels: FloatArray = field(repr=False)
    view: IntArray = field(repr=False)
    point: IntArray = field(repr=False)

    @property
    def count(self) -> int:
        """N, the number of points."""
        return int(self.point[-1]) + 1 if len(self.point) else 0

    @staticmethod
    def of(pixels: FloatArray, view: IntArray, label: IntArray, least: int = 2) -> Tracks:
        """From observations in any order with any labels; points seen less than ``least`` times are left out."""
        _, point, times = np.unique(label, return_inverse=True, return_counts=True)
        kept = np.flatnonzero(times[point] >= least)
        order = kept[np.lexsort((view[kept], point[kept]))]
        point = np.unique(point[order], return_inverse=True)[1]
        return Tracks(pixels[order], view[order], point.astype(np.int64))

    def take(self, good: npt.NDArray[np.bool_], least: int = 2) -> tuple[Tracks, IntArray]:
        """The tracks with only the good observations ``(M,)``, and the old index of each point that is left."""
        kept = good & (np.bincount(self.point[good], minlength=self.count)[self.point] >= least)
        left = np.unique(self.point[kept])
        return Tracks.of(self.pixels[kept], self.view[kept], self.point[kept], least), left


@dataclass(frozen=True, slots=True)
class Features:
    """Of one picture: ``pixels`` (n, 2) and ``descriptors`` (n, 128)."""

    pixels: FloatArray
    descriptors: npt.NDArray[np.float32]


def find_features(image: Image) -> Features:
    """SIFT features of a picture ``(h, w)`` grey or ``(h, w, 3)`` BGR, the strongest 1,500 at most."""
    import cv2

    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    halvings = max(0, int(np.ceil(np.log2(max(grey.shape) / _LONGEST_SIDE))))
    height, width = grey.shape
    for _ in range(halvings):
        grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    # Without precise upscaling, the positions are a quarter of a pixel off, each by its octave.
    sift = cv2.SIFT.create(_FEATURES, contrastThreshold=0.02, enable_precise_upscale=True)
    found, descriptors = sift.detectAndCompute(grey, None)
    if descriptors is None:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    # Root-SIFT (Arandjelovic and Zisserman 2012) tells matches better than plain distances do.
    rooted = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
    scale = np.array([width / grey.shape[1], height / grey.shape[0]])
    pixels = (np.array([k.pt for k in found], dtype=np.float64) + 0.5) * scale - 0.5
    # A place may have several orientations, and so several features: one is enough.
    _, first = np.unique(np.round(pixels, 3), axis=0, return_index=True)
    return Features(pixels[first], rooted[first].astype(np.float32))


def follow(features: Sequence[Features], moves: Moves) -> Tracks:
    """Match features between views that are near to each other and join them to tracks seen at least three times."""
    starts = np.concatenate([[0], np.cumsum([len(f.pixels) for f in features])])
    ends: list[IntArray] = [np.zeros((0, 2), dtype=np.int64)]
    for a, b in pairs(moves):
        found = match(features[a], features[b])
        if len(found):
            ends.append(found + np.array([starts[a], starts[b]]))
    pixels = np.concatenate([f.pixels for f in features])
    view = np.repeat(np.arange(len(features)), np.diff(starts))
    return _joined(pixels, view, np.concatenate(ends))


def pairs(moves: Moves) -> Iterator[tuple[int, int]]:
    """Views to be matched: each with its nearest ones, and enough others that all hang together."""
    from scipy.sparse.csgraph import minimum_spanning_tree

    table = moves.table
    span = np.maximum(np.ptp(table, axis=0), 1e-9)
    # Axes count by their own span: how far the target is, and so what a millimetre does to a picture, is unknown.
    apart = np.linalg.norm((table[:, None] - table[None]) / span, axis=2)
    near = np.argsort(apart, axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 1]
    chosen = {(min(a, int(b)), max(a, int(b))) for a, row in enumerate(near) for b in row}
    tree = minimum_spanning_tree(apart + 1e-9).nonzero()
    chosen |= {(min(int(a), int(b)), max(int(a), int(b))) for a, b in zip(*tree, strict=True)}
    yield from sorted(pair for pair in chosen if pair[0] != pair[1])


def match(a: Features, b: Features) -> IntArray:
    """Index pairs ``(m, 2)`` of features that are each other's best, clearly so, with one epipolar geometry."""
    import cv2

    none = np.zeros((0, 2), dtype=np.int64)
    if min(len(a.pixels), len(b.pixels)) < _LEAST_MATCHES:
        return none
    # Rooted descriptors have unit length: the largest product is the smallest distance.
    product = a.descriptors @ b.descriptors.T
    best_b, best_a = product.argmax(axis=1), product.argmax(axis=0)
    second = np.partition(product, -2, axis=1)[:, -2]
    here = np.arange(len(a.pixels))
    distance, next_distance = (np.sqrt(np.maximum(2.0 - 2.0 * p, 0.0)) for p in (product[here, best_b], second))
    kept = np.flatnonzero((best_a[best_b] == here) & (distance < _RATIO * next_distance))
    if len(kept) < _LEAST_MATCHES:
        return none
    found = np.stack([kept, best_b[kept]], axis=1)
    _, mask = cv2.findFundamentalMat(
        a.pixels[found[:, 0]], b.pixels[found[:, 1]], cv2.FM_RANSAC, _OFF_EPIPOLAR_PX, 0.999
    )
    if mask is None or np.count_nonzero(mask) < _LEAST_MATCHES:
        return none
    return np.asarray(found[np.asarray(mask).ravel() > 0], dtype=np.int64)


def _joined(pixels: FloatArray, view: IntArray, ends: IntArray) -> Tracks:
    """Tracks are the connected features; one that meets a view twice is a mistake somewhere and is left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(pixels)
    links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
    label = np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)
    cells, times = np.unique(np.stack([label, view], axis=1), axis=0, return_counts=True)
    bad = np.unique(cells[times > 1, 0])
    good = ~np.isin(label, bad)
    return Tracks.of(pixels[good], view[good], label[good], least=3)
