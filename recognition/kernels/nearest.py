"""For each expected part the detection taken for it; each detection serves one part of a hypothesis.

Shape legend: n expected parts (of rising hypothesis), D detections, C corners, K classes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel
def nearest(
    hypothesis: IntArray,
    corners_px: FloatArray,
    corner_count: IntArray,
    part_class: IntArray,
    seen_px: FloatArray,
    allowed: npt.NDArray[np.bool_],
    foremost: IntArray,
    gate_px: FloatArray,
    prefer: bool,
) -> tuple[IntArray, FloatArray]:
    """Detection ``(n,)``, -1 for none, and rms corner distance ``(n,)`` px, infinite for none.

    ``allowed`` ``(D, K)``; ``gate_px`` ``(n,)`` largest distance; ``prefer``: of outlines alike take ``foremost``
    ``(D,)``, not the nearest, where it is within the gate too. A part that loses so falls back to its nearest.
    """
    n = len(hypothesis)
    detection, distance = np.full(n, -1), np.full(n, np.inf)
    owner = np.full(len(seen_px), -1)
    begin = 0
    while begin < n:
        end = begin
        while end < n and hypothesis[end] == hypothesis[begin]:
            end += 1
        owner[:] = -1
        for p in range(begin, end):
            best, least = _nearest_one(corners_px[p], corner_count[p], part_class[p], seen_px, allowed, gate_px[p])
            if prefer and best >= 0 and foremost[best] != best and allowed[foremost[best], part_class[p]]:
                away = _distance(corners_px[p], corner_count[p], seen_px[foremost[best]], gate_px[p])
                if away <= gate_px[p]:
                    best, least = foremost[best], away
            _claim(p, best, least, owner, detection, distance)
        if prefer:
            for p in range(begin, end):
                if detection[p] < 0:
                    best, least = _nearest_one(
                        corners_px[p], corner_count[p], part_class[p], seen_px, allowed, gate_px[p]
                    )
                    if best >= 0 and owner[best] < 0:
                        _claim(p, best, least, owner, detection, distance)
        begin = end
    return detection, distance


@kernel
def _claim(p: int, best: int, least: float, owner: IntArray, detection: IntArray, distance: FloatArray) -> None:
    """Take a detection for a part, unless another part is nearer to it; that one else loses it."""
    if best < 0:
        return
    other = owner[best]
    if other >= 0:
        if distance[other] <= least:
            return
        detection[other], distance[other] = -1, np.inf
    owner[best], detection[p], distance[p] = p, best, least


@kernel
def _nearest_one(
    corners: FloatArray,
    count: int,
    part_class: int,
    seen_px: FloatArray,
    allowed: npt.NDArray[np.bool_],
    gate_px: float,
) -> tuple[int, float]:
    best, least = -1, gate_px
    for d in range(len(seen_px)):
        if allowed[d, part_class]:
            away = _distance(corners, count, seen_px[d], least)
            if away < least or (best < 0 and away <= least):
                best, least = d, away
    return best, least


@kernel
def _distance(corners: FloatArray, count: int, seen: FloatArray, limit: float) -> float:
    """Rms distance of corners; infinite as soon as it must exceed a limit."""
    most = limit * limit * count
    total = 0.0
    for k in range(count):
        du, dv = corners[k, 0] - seen[k, 0], corners[k, 1] - seen[k, 1]
        total += du * du + dv * dv
        if total > most:
            return np.inf
    return float(np.sqrt(total / count))
