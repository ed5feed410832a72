"""Small made-up instances: what each hypothesis shows from each candidate, drawn by hypothesis."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from recognition.policies.outlook import Outlook

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@st.composite
def tables(draw: st.DrawFn, most: int = 7, views: int = 6) -> tuple[IntArray, FloatArray]:
    """Observations ``(K, M)`` without error and weights ``(M,)``."""
    shape = (draw(st.integers(1, views)), draw(st.integers(1, most)))
    table = draw(hnp.arrays(np.int64, shape, elements=st.integers(0, 2)))
    weight = draw(hnp.arrays(np.float64, shape[1], elements=st.floats(0.01, 1.0)))
    return table, weight


@st.composite
def graded(draw: st.DrawFn, most: int = 6, views: int = 5) -> Outlook:
    """Hypotheses that views tell apart by any degree, of some objects, at any cost."""
    k, m = draw(st.integers(1, views)), draw(st.integers(1, most))
    some = draw(hnp.arrays(np.float64, (k, m, m), elements=st.floats(0.0, 8.0)))
    apart = some + some.transpose(0, 2, 1)
    apart[:, np.arange(m), np.arange(m)] = 0.0
    weight = draw(hnp.arrays(np.float64, m, elements=st.floats(0.01, 1.0)))
    cost_s = draw(hnp.arrays(np.float64, k, elements=st.floats(0.1, 10.0)))
    object_of = draw(hnp.arrays(np.int64, m, elements=st.integers(0, 2)))
    return Outlook(weight, apart, cost_s, np.arange(m), object_of)


def told(rows: list[list[int]], weight: list[float] | None = None) -> Outlook:
    """A table written out, a row a view."""
    table = np.array(rows)
    return Outlook.of_table(table, np.ones(table.shape[1]) if weight is None else np.array(weight))
