"""Looks for outlines just outside of those that segmentation closes, and tells parts from panes by what lies in what.

A frame, the paint around it and its sill give several parallel edges a few pixels apart, and a region's boundary
follows any of them. Each closed outline is therefore measured once more, somewhat enlarged, for the edges around it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.detectors.edges import EdgeField, measure_outlines
from recognition.detectors.profiles import EdgeFit

FloatArray = npt.NDArray[np.float64]

_GROW_PX = 3.0
_RADIUS_PX = 6.0
_LEAST_PX = 25.0  # below this width or height the radius spans the part itself
_LEAST_SCORE = 0.4  # random places on photographs stay below it in 99 of 100 cases
_SLACK_PX = 3.0
_SAME, _INNER, _CONTAINER = 1.02, 1.6, 60.0  # areas relative to what lies inside: a frame, then a window, then a wall
_PANE, _FRAME, _EMPTY = 0.3, 0.9, 0.3  # what lying in a window, lying in each frame, and holding nothing leave
_LARGE_PX = 60.0  # from this size, the root of the area, an outline is no texture
_HOLDS = 6  # outlines held that make a part likely


def outward_outlines(edge_field: EdgeField, quads: FloatArray) -> EdgeFit:
    """Outlines found around quadrilaterals ``(K, 4, 2)``; those without evidence on their sides are left out."""
    quads = quads[np.ptp(quads, axis=1).min(axis=1) >= _LEAST_PX]
    if len(quads) == 0:
        none = np.zeros((0, 4))
        return EdgeFit(np.zeros((0, 4, 2)), none, none, none)
    enlarged = quads + _GROW_PX * np.sign(quads - quads.mean(axis=1, keepdims=True))
    seen = measure_outlines(edge_field, enlarged, _RADIUS_PX)
    found = seen.score >= _LEAST_SCORE
    return EdgeFit(seen.corners_px[found], seen.offset_px[found], seen.support[found], seen.strength[found])


def likely_part(outlines: FloatArray) -> FloatArray:
    """``(K,)`` 0..1: how much the company of outlines ``(K, n, 2)`` in a picture speaks for each being a part's own.

    A part's outline is the outer one of its frame: it holds panes and inner frames, and no other outline of about a
    part's size holds it. What is held by a much larger one is a pane, or texture within a part; what holds nothing is
    less likely a part, but may be one (a plain opening). Most of what is small is texture.
    """
    pane_of, frame_of = holders(outlines, _INNER, _CONTAINER), holders(outlines, _SAME, _INNER)
    holds = pane_of.sum(axis=0) + frame_of.sum(axis=0)
    outermost = np.where(pane_of.any(axis=1), _PANE, 1.0) * _FRAME ** frame_of.sum(axis=1)
    size = np.sqrt(np.prod(np.ptp(outlines, axis=1), axis=1))
    large = np.sqrt(np.minimum(1.0, size / _LARGE_PX))
    return np.asarray(large * outermost * (_EMPTY + (1 - _EMPTY) * np.minimum(1.0, holds / _HOLDS)))


def holders(outlines: FloatArray, least: float, most: float) -> npt.NDArray[np.bool_]:
    """``(K, K)``: outline i lies within the box around outline j, of ``least`` to ``most`` times its own area."""
    low, high = outlines.min(axis=1), outlines.max(axis=1)
    area = np.prod(high - low, axis=1)
    inside = (low[:, None] >= low - _SLACK_PX).all(axis=-1) & (high[:, None] <= high + _SLACK_PX).all(axis=-1)
    return np.asarray(inside & (area > least * area[:, None]) & (area <= most * area[:, None]))
