"""Predicted pictures as amounts of parts in cells, and how much every two of them have in common.

Shape legend: M pictures, n parts in them, F features (a part class in a cell) that occur in any.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel
def middles(which: IntArray, middle_px: FloatArray, chance: FloatArray, pictures: int) -> FloatArray:
    """``(M, 2)`` px: the mean place of the parts ``(n,)`` of each picture, 0 of none."""
    total, amount = np.zeros((pictures, 2)), np.zeros(pictures)
    for i in range(len(which)):
        total[which[i]] += chance[i] * middle_px[i]
        amount[which[i]] += chance[i]
    for m in range(pictures):
        total[m] /= max(amount[m], 1e-9)
    return total


@kernel
def in_cells(
    which: IntArray,
    middle_px: FloatArray,
    shift_px: FloatArray,
    look: IntArray,
    chance: FloatArray,
    pictures: int,
    cell_px: float,
    across: int,
    down: int,
) -> FloatArray:
    """Amounts ``(M, F)``: parts ``(n,)`` of a class spread bilinearly over cells, parts a cell apart do not overlap.

    ``shift_px`` ``(M, 2)`` is added to the parts' places; what then lies off the ``across`` x ``down`` cells is lost.
    """
    classes = 0
    for i in range(len(look)):
        classes = max(classes, look[i] + 1)
    column = np.full((classes, down, across), -1)
    place, part = np.full((len(which), 4), -1), np.zeros((len(which), 4))
    used = 0
    for i in range(len(which)):
        u = (middle_px[i, 0] + shift_px[which[i], 0]) / cell_px
        v = (middle_px[i, 1] + shift_px[which[i], 1]) / cell_px
        left, top = int(np.floor(u)), int(np.floor(v))
        for corner in range(4):
            a, b = left + corner % 2, top + corner // 2
            if not (0 <= a < across and 0 <= b < down):
                continue
            if column[look[i], b, a] < 0:
                column[look[i], b, a] = used
                used += 1
            place[i, corner] = column[look[i], b, a]
            part[i, corner] = chance[i] * (1.0 - abs(u - a)) * (1.0 - abs(v - b))
    features = np.zeros((pictures, used))
    for i in range(len(which)):
        for corner in range(4):
            if place[i, corner] >= 0:
                features[which[i], place[i, corner]] += part[i, corner]
    return features


@kernel
def in_common(features: FloatArray) -> FloatArray:
    """``(M, M)`` sums over the features ``(M, F)`` of the lesser of two pictures' amounts."""
    pictures, many = features.shape
    common = np.empty((pictures, pictures))
    for i in range(pictures):
        for j in range(i + 1):
            total = 0.0
            for f in range(many):
                total += min(features[i, f], features[j, f])
            common[i, j] = total
            common[j, i] = total
    return common
