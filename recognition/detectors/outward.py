"""Looks for the outlines just outside of those that segmentation closes, and tells how deep outlines are nested.

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
_SLACK_PX = 2.0
_INNER, _CONTAINER = 2.5, 40.0  # a container's area is between these times the area of what it contains


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


def nesting_depth(outlines: FloatArray) -> npt.NDArray[np.int64]:
    """``(K,)`` how many considerably larger outlines of ``(K, n, 2)`` surround each: panes lie inside windows."""
    low, high = outlines.min(axis=1), outlines.max(axis=1)
    area = np.prod(high - low, axis=1)
    around = (low[:, None] >= low - _SLACK_PX).all(axis=-1) & (high[:, None] <= high + _SLACK_PX).all(axis=-1)
    larger = (area > _INNER * area[:, None]) & (area < _CONTAINER * area[:, None])
    return np.asarray((around & larger).sum(axis=1))
