"""How few views any policy needs on average: exactly, on small tables, and a Huffman bound on tables of any size.

A table tells what each of M hypotheses shows from each of K candidates. Views are counted until all hypotheses left are
such as no view separates.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from recognition.policies.strategy import Planner

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def exact_views(table: IntArray, weight: FloatArray) -> float:
    """The fewest expected views on a table ``(K, M)``; time may grow as the number of sets of hypotheses."""
    return Planner(table, weight).best(tuple(range(table.shape[1]))).views


def expected_views(table: IntArray, weight: FloatArray, decide: Callable[[tuple[int, ...]], int]) -> float:
    """Expected views of a policy that decides by the hypotheses left which candidate's view to take next.

    Raises:
        ValueError: it takes a view that separates none of those that others separate, so it might never end.
    """
    _, same = np.unique(table.T, axis=0, return_inverse=True)
    same = same.reshape(-1)

    def views(members: tuple[int, ...]) -> float:
        if len({int(same[m]) for m in members}) < 2:
            return 0.0
        taken = decide(members)
        shown = table[taken, list(members)]
        groups = [tuple(m for m, s in zip(members, shown, strict=True) if s == one) for one in np.unique(shown)]
        if len(groups) < 2:
            raise ValueError(f"view {taken} separates none of {members}")
        left = sum(weight[list(group)].sum() * views(group) for group in groups)
        return 1.0 + float(left) / float(weight[list(members)].sum())

    return views(tuple(range(table.shape[1])))


def least_views(table: IntArray, weight: FloatArray) -> float:
    """No policy has fewer expected views: the length of a Huffman code over hypotheses that some view separates.

    A strategy is a code with as many letters as one view can show different things.
    """
    _, same = np.unique(table.T, axis=0, return_inverse=True)
    letters = max((len(np.unique(row)) for row in table), default=1)
    return code_length(np.bincount(same.reshape(-1), weight).tolist(), letters)


def code_length(weights: Sequence[float], letters: int) -> float:
    """Mean length of the best code with so many letters (2 or more) for words of these weights (Huffman).

    0 for one word; the weights need not sum to 1.
    """
    heap = [float(weight) for weight in weights]
    total = sum(heap)
    if len(heap) < 2:
        return 0.0
    letters = max(2, letters)
    # All but the first merging must be of as many as there are letters.
    take = (len(heap) - 2) % (letters - 1) + 2
    heapq.heapify(heap)
    length = 0.0
    while len(heap) > 1:
        merged = sum(heapq.heappop(heap) for _ in range(take))
        length += merged
        heapq.heappush(heap, merged)
        take = letters
    return length / total
