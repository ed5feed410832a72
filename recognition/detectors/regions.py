"""Segments a picture by thresholds at several levels and turns the boundaries of its regions into polygons."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from rig.hal import Image

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

_SLACK = (0.01, 0.02, 0.035, 0.05, 0.07)  # of a quadrilateral, as shares of the outline's length
_FINE_SLACK = (0.008, 0.012, 0.018, 0.027, 0.04)  # of polygons with more corners
_FILLED = 0.85  # share of its hull that a quadrilateral's area must have,
_ROUND_PX, _ROUND_AREA = 0.3, 100.0  # less this width all around, if it is not more than that: blur rounds corners
_SOLID = (0.4, 0.97)  # share of its hull that the area of a polygon with notches has
_RAGGED = 1.6  # a longer outline than this many times its hull's is texture
_LARGE_PX = 500_000  # pictures with more pixels are halved where detail does not matter
_REDNESS_LEVELS = 6
_RARE_STEP = 20.0  # grey levels between the rare extremes of a picture and all the rest that get a threshold
_BLOCKS = (31, 101)  # neighbourhoods that a pixel is compared with, full size
_OFFSETS = (-5.0, 5.0)  # grey levels by which it must differ from them


def find_polygons(image: Image, counts: Sequence[int], least_px: float, levels: int) -> dict[int, list[FloatArray]]:
    """Polygons by number of corners (as in `polygons`) of the regions of a picture.

    Grey is segmented at ``levels`` thresholds in full size; colour, and everything against its neighbourhood, at half
    the size if the picture is large: corners are refined in the full picture anyway.
    """
    import cv2

    found: dict[int, list[FloatArray]] = {n: [] for n in counts}
    planes = level_planes(image)
    factor = 2 if image.shape[0] * image.shape[1] > _LARGE_PX else 1
    for mask in masks(planes[0], levels):
        _add(found, polygons(outlines(mask, least_px), counts, least_px), 1)
    small = planes
    if factor > 1:
        small = [_bytes(cv2.resize(plane, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)) for plane in planes]
    binary = [
        mask for plane in small for block in _BLOCKS for mask in local_masks(plane, block // factor | 1, _OFFSETS)
    ]
    binary += [mask for plane in small[2:] for mask in masks(plane, _REDNESS_LEVELS)]
    for mask in binary:
        _add(found, polygons(outlines(mask, least_px / factor), counts, least_px / factor), factor)
    return found


def _add(found: dict[int, list[FloatArray]], more: dict[int, list[FloatArray]], factor: int) -> None:
    """Add polygons of a picture that is ``factor`` times smaller; a pixel's coordinates are those of its centre."""
    for n, some in more.items():
        found[n].extend(some if factor == 1 else [factor * polygon + 0.5 * (factor - 1) for polygon in some])


def level_planes(image: Image) -> list[Image]:
    """The 8-bit planes to be segmented, each ``(h, w)``: grey, and of colour pictures blue and red against blue."""
    import cv2

    if image.ndim == 2 or image.shape[2] == 1:
        return [_bytes(cv2.GaussianBlur(np.ascontiguousarray(image.reshape(image.shape[:2])), (5, 5), 1.0))]
    smooth = _bytes(cv2.GaussianBlur(np.ascontiguousarray(image[..., :3]), (5, 5), 1.0))
    grey = _bytes(cv2.cvtColor(smooth, cv2.COLOR_BGR2GRAY))
    blue, red = smooth[..., 0], smooth[..., 2]
    redness = _bytes(cv2.addWeighted(red, 0.5, blue, -0.5, 128.0))
    return [grey, np.ascontiguousarray(blue), redness]


def masks(plane: Image, levels: int, least_step: float = 4.0) -> Iterator[Image]:
    """Binary pictures of a plane at up to ``levels`` thresholds, evenly between its dark and its bright end.

    Levels lie at least ``least_step`` grey levels apart: a plane without contrast gives few masks, or none.
    """
    import cv2

    darkest, low, high, brightest = (float(v) for v in np.percentile(plane[::4, ::4], [0.05, 1, 99, 99.95]))
    count = min(levels, int((high - low) / least_step))
    thresholds = list(np.linspace(low, high, count + 2)[1:-1])
    # A part or two may fill less than a hundredth of the picture.
    if low - darkest > _RARE_STEP:
        thresholds.append((darkest + low) / 2)
    if brightest - high > _RARE_STEP:
        thresholds.append((brightest + high) / 2)
    for level in thresholds:
        yield _bytes(cv2.threshold(plane, float(level), 255, cv2.THRESH_BINARY)[1])


def local_masks(plane: Image, block: int, offsets: Sequence[float]) -> Iterator[Image]:
    """Binary pictures of a plane against its own mean over a ``block``, shifted by ``offsets``."""
    import cv2

    mean = cv2.blur(plane, (block, block))
    for offset in offsets:
        # The mean shifted in one saturating pass: scale 1, plus an offset.
        yield _bytes(cv2.compare(plane, cv2.convertScaleAbs(mean, alpha=1.0, beta=offset), cv2.CMP_GT))


def outlines(mask: Image, least_px: float, border_px: int = 1) -> Iterator[IntArray]:
    """Boundaries ``(m, 1, 2)`` of all bright and dark regions that are large enough and do not touch the border."""
    import cv2

    height, width = mask.shape
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    for contour in contours:
        if len(contour) < 4:
            continue
        x, y, w, h = cv2.boundingRect(contour)
        if min(w, h) < least_px or x < border_px or y < border_px:
            continue
        if x + w > width - border_px or y + h > height - border_px:
            continue
        yield np.asarray(contour, dtype=np.int32)


def polygons(contours: Iterable[IntArray], counts: Sequence[int], least_px: float) -> dict[int, list[FloatArray]]:
    """Polygons by number of corners, each ``(n, 2)`` clockwise as seen; quadrilaterals are taken of the hulls.

    Args:
        contours: boundaries of regions.
        counts: numbers of corners that part-classes have.
        least_px: smallest side of a quadrilateral, and of a bounding box.
    """
    import cv2

    found: dict[int, list[FloatArray]] = {n: [] for n in counts}
    many = [n for n in counts if n > 4]
    for contour in contours:
        hull = cv2.convexHull(contour)
        hull_area = cv2.contourArea(hull)
        if hull_area < least_px**2:
            continue
        if 4 in found:
            quad = _quadrilateral(np.asarray(hull, dtype=np.int32), hull_area)
            if quad is not None:
                found[4].append(quad)
        if many and _may_be_notched(contour, np.asarray(hull, dtype=np.int32), hull_area):
            for polygon in _polygons_of(contour, many):
                found[len(polygon)].append(polygon)
    return found


def _may_be_notched(contour: IntArray, hull: IntArray, hull_area: float) -> bool:
    """The region falls short of its hull, as a polygon with notches does, without the long outline of a texture."""
    import cv2

    if not _SOLID[0] * hull_area < cv2.contourArea(contour) < _SOLID[1] * hull_area:
        return False
    return cv2.arcLength(contour, True) < _RAGGED * cv2.arcLength(hull, True)


def _quadrilateral(hull: IntArray, hull_area: float) -> FloatArray | None:
    import cv2

    length = cv2.arcLength(hull, True)
    for slack in _SLACK:
        polygon = cv2.approxPolyDP(hull, slack * length, True)
        if len(polygon) <= 4:
            break
    if len(polygon) != 4 or cv2.contourArea(polygon) < _FILLED * hull_area - min(_ROUND_PX * length, _ROUND_AREA):
        return None
    return _clockwise(np.asarray(polygon, dtype=np.int32))


def _polygons_of(contour: IntArray, counts: Sequence[int]) -> Iterator[FloatArray]:
    """The polygons with a wanted number of corners that a boundary is at some slack."""
    import cv2

    length = cv2.arcLength(contour, True)
    seen = 0
    for slack in _FINE_SLACK:
        polygon = cv2.approxPolyDP(contour, slack * length, True)
        if len(polygon) < min(counts):
            return
        if len(polygon) in counts and len(polygon) != seen:
            seen = len(polygon)
            yield _clockwise(np.asarray(polygon, dtype=np.int32))


def _bytes(picture: npt.NDArray[Any]) -> Image:
    """What OpenCV returned, as the 8-bit picture that it is."""
    return cast("Image", picture)


def _clockwise(polygon: IntArray) -> FloatArray:
    """The polygon ``(n, 2)`` of a contour ``(n, 1, 2)``, with its corners clockwise as seen (y down)."""
    import cv2

    corners = polygon[:, 0].astype(np.float64)
    return corners if cv2.contourArea(polygon, oriented=True) > 0 else corners[::-1]
