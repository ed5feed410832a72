"""How well the neighbours of a part on its wall are found where the wall's image predicts them.

Shape legend: B pairs (detection, part), P parts, N neighbours of each, D detections.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel
def support(
    numbers: FloatArray,
    part: IntArray,
    neighbour: IntArray,
    middle_mm: FloatArray,
    size_mm: FloatArray,
    seen_middle: FloatArray,
    seen_size: FloatArray,
    width: float,
    height: float,
    same_place: float,
    hit: float,
    miss: float,
) -> FloatArray:
    """Score ``(B,)``: ``hit`` for each neighbour found, ``miss`` for each expected whole in the frame and not found.

    ``numbers`` ``(B, 6)`` is the wall's image (``wallfit``); ``neighbour`` ``(P, N)``, -1 padded, with ``middle_mm``
    and ``size_mm`` ``(P, N, 2)`` in the part's wall frame. A neighbour is found where a detection of about its size
    lies within ``same_place`` of its size.
    """
    by_u = np.argsort(seen_middle[:, 0])
    sorted_u = seen_middle[by_u, 0]
    score = np.zeros(len(part))
    for b in range(len(part)):
        a, shift, c, d, e, g = numbers[b]
        p = part[b]
        for k in range(neighbour.shape[1]):
            if neighbour[p, k] < 0:
                break
            near, far = middle_mm[p, k, 0] - size_mm[p, k, 0] / 2, middle_mm[p, k, 0] + size_mm[p, k, 0] / 2
            over, under = middle_mm[p, k, 1] - size_mm[p, k, 1] / 2, middle_mm[p, k, 1] + size_mm[p, k, 1] / 2
            depth_near, depth_far = c * near + 1.0, c * far + 1.0
            if min(depth_near, depth_far) <= 0.05:
                continue
            left, right = (a * near + shift) / depth_near, (a * far + shift) / depth_far
            if left > right:
                left, right = right, left
            top = min((d * near + e * over + g) / depth_near, (d * far + e * over + g) / depth_far)
            bottom = max((d * near + e * under + g) / depth_near, (d * far + e * under + g) / depth_far)
            inside = left > 4.0 and top > 4.0 and right < width - 5.0 and bottom < height - 5.0
            if not inside or right - left <= 8.0 or bottom - top <= 8.0:
                continue
            found = _found(left, top, right, bottom, by_u, sorted_u, seen_middle, seen_size, same_place)
            score[b] += hit if found else miss
    return score


@kernel
def _found(
    left: float,
    top: float,
    right: float,
    bottom: float,
    by_u: IntArray,
    sorted_u: FloatArray,
    seen_middle: FloatArray,
    seen_size: FloatArray,
    same_place: float,
) -> bool:
    wide, tall = right - left, bottom - top
    u, v = (left + right) / 2, (top + bottom) / 2
    gap = same_place * wide + 2.0
    at = np.searchsorted(sorted_u, u - gap)
    while at < len(by_u) and sorted_u[at] < u + gap:
        d = by_u[at]
        at += 1
        if abs(seen_middle[d, 1] - v) >= same_place * tall + 2.0:
            continue
        wider, taller = abs(np.log(seen_size[d, 0] / wide)), abs(np.log(seen_size[d, 1] / tall))
        if wider < same_place + 3.0 / wide and taller < same_place + 3.0 / tall:
            return True
    return False
