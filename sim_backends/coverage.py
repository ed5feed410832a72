"""The exact fraction of each pixel that a polygon covers, and a canvas that paints with it.

OpenCV's anti-aliased fill widens a polygon by up to half a pixel; here each pixel gets the area of the polygon inside
it, so that edges and corners in the picture lie exactly where the projection puts them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.hal import Image

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Coverage:
    """Fractions ``(h, w)`` in [0, 1] of the pixels of a window of the picture whose top-left pixel is (x, y)."""

    x: int
    y: int
    fraction: npt.NDArray[np.float32]

    @property
    def window(self) -> tuple[slice, slice]:
        """The window as an index into the picture."""
        h, w = self.fraction.shape
        return slice(self.y, self.y + h), slice(self.x, self.x + w)


def coverage(outline: FloatArray, size: tuple[int, int]) -> Coverage | None:
    """Area of a polygon inside each pixel, or ``None`` if it lies outside the picture.

    Args:
        outline: ``(n, 2)`` pixels, pixel (0, 0) being the centre of the top-left one; simple, either orientation.
        size: width and height of the picture.

    Each edge is cut at every pixel border; a piece inside one pixel adds its height times the width right of it to that
    pixel and its whole height to all pixels further right, which a running sum along the row carries there.
    """
    corners = outline + 0.5  # from pixel centres to pixel borders
    low = np.clip(np.floor(corners.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)), 0, size).astype(int)
    w, h = (int(n) for n in high - low)
    if w <= 0 or h <= 0:
        return None
    ends = _cut_at_pixel_borders(corners - low, w, h)
    middle = (ends[:, 0] + ends[:, 1]) / 2
    rise = ends[:, 1, 1] - ends[:, 0, 1]
    inside = (middle[:, 1] > 0) & (middle[:, 1] < h) & (rise != 0)
    middle, rise = middle[inside], rise[inside]
    x = np.clip(middle[:, 0], 0, w)
    column = np.minimum(x.astype(int), w)
    right = x - column
    cell = middle[:, 1].astype(int) * (w + 2) + column
    both = np.bincount(
        np.concatenate([cell, cell + 1]),
        weights=np.concatenate([rise * (1 - right), rise * right]),
        minlength=h * (w + 2),
    )
    area = np.cumsum(both.astype(np.float32).reshape(h, w + 2)[:, :w], axis=1)
    fraction = np.minimum(np.abs(area), np.float32(1.0))
    return Coverage(int(low[0]), int(low[1]), fraction)


def _cut_at_pixel_borders(corners: FloatArray, w: int, h: int) -> FloatArray:
    """Edges of the closed polygon ``(n, 2)`` cut at all integer x in 0..w and y in 0..h: pieces ``(m, 2, 2)``."""
    start, stop = corners, np.roll(corners, -1, axis=0)
    step = stop - start
    n = len(corners)
    edge, t = [np.arange(n), np.arange(n)], [np.zeros(n), np.ones(n)]
    for axis, extent in ((0, w), (1, h)):
        lower = np.clip(np.ceil(np.minimum(start, stop)[:, axis]), 0, extent + 1).astype(int)
        upper = np.clip(np.floor(np.maximum(start, stop)[:, axis]), -1, extent).astype(int)
        counts = np.where(step[:, axis] == 0, 0, np.maximum(0, upper - lower + 1))
        which = np.repeat(np.arange(n), counts)
        line = lower[which] + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        edge.append(which)
        t.append((line - start[which, axis]) / step[which, axis])
    edges, ts = np.concatenate(edge), np.clip(np.concatenate(t), 0.0, 1.0)
    order = np.lexsort((ts, edges))
    edges, ts = edges[order], ts[order]
    points = start[edges] + ts[:, None] * step[edges]
    same = edges[1:] == edges[:-1]
    return np.stack([points[:-1][same], points[1:][same]], axis=1)


class Canvas:
    """A picture that polygons are painted on, far ones first, with a buffer that tells what each pixel shows.

    Two walls that meet at an edge share its pixels; painting one over the other would let the background shine through
    between them. The canvas remembers how much of each pixel the object covers and takes partial covers of one pixel to
    lie side by side.

    Attributes:
        image: ``(h, w, 3)`` BGR, or ``None`` if only ``ids`` are wanted.
        ids: ``(h, w)`` what the pixel shows: -1 background, else the number given to ``paint``.
    """

    def __init__(self, size: tuple[int, int], background: Image | None) -> None:
        self.size = size
        self.ids = np.full((size[1], size[0]), -1, dtype=np.int32)
        self.image = None if background is None else background.copy()
        self._background = background
        self._covered = np.zeros((size[1], size[0]), dtype=np.float32)

    def paint(self, cover: Coverage, colours: Image | None, number: int) -> int:
        """Paint a window's colours ``(h, w, 3)`` where covered, and return how many pixels now show ``number``."""
        import cv2

        window, fraction = cover.window, cover.fraction
        mostly = fraction >= 0.5
        self.ids[window][mostly] = number
        if self.image is not None and colours is not None:
            full = (fraction > 0.998).view(np.uint8)
            self._blend_rims(window, fraction, (fraction > 0.002) & (full == 0), colours)
            cv2.copyTo(colours, full, self.image[window])
            cv2.copyTo(np.ones_like(fraction), full, self._covered[window])
        return int(np.count_nonzero(mostly))

    def _blend_rims(
        self, window: tuple[slice, slice], fraction: npt.NDArray[np.float32], rim: npt.NDArray[np.bool_], colours: Image
    ) -> None:
        assert self.image is not None
        assert self._background is not None
        ys, xs = np.nonzero(rim)
        new = fraction[ys, xs].astype(np.float64)[:, None]
        before = self._covered[window][ys, xs].astype(np.float64)[:, None]
        behind = self._background[window][ys, xs].astype(np.float64)
        # What the object alone contributed so far, per unit of its own cover.
        own = self.image[window][ys, xs] - (1 - before) * behind
        kept = np.minimum(before, 1 - new)
        free = np.maximum(0.0, 1 - before - new)
        mixed = free * behind + own * (kept / np.maximum(before, 1e-6)) + new * colours[ys, xs]
        self.image[window][ys, xs] = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
        self._covered[window][ys, xs] = np.minimum(1.0, before + new)[:, 0]

    def fill(self, outline: FloatArray, bgr: tuple[float, float, float], number: int) -> None:
        """Fill a polygon quickly, to about half a pixel: for foliage and the like, where exactness does not matter."""
        import cv2

        points = fixed_point(outline)
        cv2.fillPoly(self.ids, [np.rint(outline).astype(np.int32)], number)
        if self.image is not None:
            cv2.fillPoly(self.image, [points], bgr, cv2.LINE_AA, SHIFT)


SHIFT = 4
"""Fractional bits of the coordinates made by ``fixed_point``."""


def fixed_point(outline: FloatArray) -> npt.NDArray[np.int32]:
    """Pixels ``(n, 2)`` as OpenCV's fixed-point coordinates, cut to a range that cannot overflow."""
    return np.rint(np.clip(outline, -20000, 20000) * (1 << SHIFT)).astype(np.int32)
