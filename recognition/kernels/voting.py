"""Votes for the image shift, and the scale, that bring most expected parts onto detections of about their size.

Shape legend: H hypotheses, n expected parts (of rising hypothesis), D detections, S scales, M modes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SIZE_TOLERANCE = 0.3
"""Largest difference of the logs of width, or of height."""
UNLIKE_COST = 0.5
"""How much less a detection votes that is off in size by as much as that."""
FAR_COST, SCALE_COST, CENTRE_BONUS = 0.4, 0.3, 0.5
"""Of equal votes the smaller shift is the likelier, and so is the smaller change of scale; votes in one cell count more
than those spread over neighbours."""
_SILENCED = 3
"""Cells about a peak, each way, in which no further peak is looked for."""
_NONE = -1e9


@kernel
def vote(
    hypothesis: IntArray,
    middle_px: FloatArray,
    size_px: FloatArray,
    centre_px: FloatArray,
    scales: FloatArray,
    scaled: npt.NDArray[np.bool_],
    seen_middle: FloatArray,
    seen_size: FloatArray,
    loudness: FloatArray,
    reach_px: FloatArray,
    frame: FloatArray,
    beyond_px: float,
    least_px: float,
    bin_px: float,
    modes: int,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Shifts ``(H, M, 2)`` px, index of the scale ``(H, M)`` and votes ``(H, M)``, best first.

    Parts are given by the middle and size of their boxes ``(n, 2)``; a scale enlarges them about ``centre_px``
    ``(H, 2)``, and those then outside of ``frame`` (width, height; boxes may reach ``beyond_px`` over), or smaller than
    ``least_px``, do not vote. ``scaled`` ``(H,)`` says whose scale is open; for the others only a scale of 1 is tried.
    ``loudness`` ``(D,)`` weighs each detection's votes.
    """
    count = len(reach_px)
    half = int(np.ceil(reach_px.max() / bin_px)) + 1 if count else 1
    side = 2 * half + 1
    far = np.empty((side, side))
    for r in range(side):
        for k in range(side):
            far[r, k] = FAR_COST * bin_px * np.hypot(float(r - half), float(k - half))
    votes, last, part_vote = np.zeros((side, side)), np.full((side, side), -1), np.zeros((side, side))
    shifts, best_scale = np.zeros((count, modes, 2)), np.zeros((count, modes), np.int64)
    best_votes = np.full((count, modes), _NONE)
    log_seen = np.log(np.maximum(seen_size, 1.0))
    touched = np.empty((side * side, 2), np.int64)
    peak = np.empty((side, side))
    begin = 0
    for h in range(count):
        end = begin
        while end < len(hypothesis) and hypothesis[end] == h:
            end += 1
        for s in range(len(scales)):
            if scales[s] != 1.0 and not scaled[h]:
                continue
            used = 0
            for n in range(begin, end):
                used = _part_votes(
                    n, middle_px[n], size_px[n], centre_px[h], scales[s], seen_middle, log_seen, loudness, reach_px[h],
                    frame, beyond_px, least_px, bin_px, half, votes, last, part_vote, touched, used,
                )  # fmt: skip
            cost = SCALE_COST * abs(np.log(scales[s]))
            _peaks(
                votes, far, 1.0 / max(reach_px[h], 1.0), touched, used, half, bin_px, cost, s, peak, shifts[h],
                best_scale[h], best_votes[h],
            )  # fmt: skip
            for t in range(used):
                votes[touched[t, 0], touched[t, 1]] = 0.0
                last[touched[t, 0], touched[t, 1]] = -1
        begin = end
    return shifts, best_scale, best_votes


@kernel
def _part_votes(
    n: int,
    middle: FloatArray,
    size: FloatArray,
    centre: FloatArray,
    scale: float,
    seen_middle: FloatArray,
    log_seen: FloatArray,
    loudness: FloatArray,
    reach: float,
    frame: FloatArray,
    beyond_px: float,
    least_px: float,
    bin_px: float,
    half: int,
    votes: FloatArray,
    last: IntArray,
    part_vote: FloatArray,
    touched: IntArray,
    used: int,
) -> int:
    """Add the votes of part ``n``: for each cell only its loudest. Returns how many cells have any."""
    x, y = centre[0] + scale * (middle[0] - centre[0]), centre[1] + scale * (middle[1] - centre[1])
    if not (0.0 < x < frame[0] and 0.0 < y < frame[1]):
        return used
    wide, tall = scale * size[0], scale * size[1]
    if wide < least_px or tall < least_px:
        return used
    if x - wide / 2 < -beyond_px or x + wide / 2 > frame[0] - 1 + beyond_px:
        return used
    if y - tall / 2 < -beyond_px or y + tall / 2 > frame[1] - 1 + beyond_px:
        return used
    log_wide, log_tall = np.log(wide), np.log(tall)
    for d in range(len(seen_middle)):
        dx, dy = seen_middle[d, 0] - x, seen_middle[d, 1] - y
        if abs(dx) > reach or abs(dy) > reach:
            continue
        unlike = max(abs(log_seen[d, 0] - log_wide), abs(log_seen[d, 1] - log_tall)) / SIZE_TOLERANCE
        if unlike >= 1.0:
            continue
        loud = loudness[d] * (1.0 - UNLIKE_COST * unlike)
        r, c = int(np.rint(dy / bin_px)) + half, int(np.rint(dx / bin_px)) + half
        if last[r, c] < 0:
            touched[used, 0], touched[used, 1] = r, c
            used += 1
        if last[r, c] != n:
            last[r, c], part_vote[r, c] = n, 0.0
        if loud > part_vote[r, c]:
            votes[r, c] += loud - part_vote[r, c]
            part_vote[r, c] = loud
    return used


@kernel
def _peaks(
    votes: FloatArray,
    far: FloatArray,
    nearness: float,
    touched: IntArray,
    used: int,
    half: int,
    bin_px: float,
    cost: float,
    scale: int,
    peak: FloatArray,
    shifts: FloatArray,
    best_scale: IntArray,
    best_votes: FloatArray,
) -> None:
    """Put the highest peaks of one scale among the best so far; a peak is a cell with votes, or beside one."""
    side = len(votes)
    # Without any vote the picture is taken to be where it is expected.
    peak[half, half] = _smooth(votes, half, half)
    for t in range(used):
        for r in range(max(touched[t, 0] - 1, 0), min(touched[t, 0] + 2, side)):
            for c in range(max(touched[t, 1] - 1, 0), min(touched[t, 1] + 2, side)):
                peak[r, c] = _smooth(votes, r, c) - nearness * far[r, c]
    for _ in range(len(best_votes)):
        top, at_r, at_c = peak[half, half], half, half
        for t in range(used):
            for r in range(max(touched[t, 0] - 1, 0), min(touched[t, 0] + 2, side)):
                for c in range(max(touched[t, 1] - 1, 0), min(touched[t, 1] + 2, side)):
                    if peak[r, c] > top:
                        top, at_r, at_c = peak[r, c], r, c
        if top <= _NONE:
            return
        _insert(top - cost, scale, (at_c - half) * bin_px, (at_r - half) * bin_px, shifts, best_scale, best_votes)
        for r in range(max(at_r - _SILENCED, 0), min(at_r + _SILENCED + 1, side)):
            for c in range(max(at_c - _SILENCED, 0), min(at_c + _SILENCED + 1, side)):
                peak[r, c] = _NONE


@kernel
def _smooth(votes: FloatArray, r: int, c: int) -> float:
    total: float = CENTRE_BONUS * votes[r, c]
    for i in range(max(r - 1, 0), min(r + 2, len(votes))):
        for j in range(max(c - 1, 0), min(c + 2, len(votes))):
            total += votes[i, j]
    return total


@kernel
def _insert(
    value: float, scale: int, dx: float, dy: float, shifts: FloatArray, best_scale: IntArray, best_votes: FloatArray
) -> None:
    """Keep the list sorted, best first; of equals the earlier stays ahead."""
    at = len(best_votes)
    while at > 0 and value > best_votes[at - 1]:
        at -= 1
    if at == len(best_votes):
        return
    for k in range(len(best_votes) - 1, at, -1):
        best_votes[k], best_scale[k] = best_votes[k - 1], best_scale[k - 1]
        shifts[k, 0], shifts[k, 1] = shifts[k - 1, 0], shifts[k - 1, 1]
    best_votes[at], best_scale[at] = value, scale
    shifts[at, 0], shifts[at, 1] = dx, dy
