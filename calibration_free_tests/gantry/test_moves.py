"""The lines of g-code themselves: nothing that is outside the limits, or no number, can be written."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration_free_tests.gantry.simulated_bench import settings
from drivers.grbl_moves import jog_line, move_line
from rig.errors import UnreachableError

AXES = settings().axes
ANY = st.floats(allow_nan=True, allow_infinity=True, width=32)
NEAR = st.sampled_from([-398.001, -398.0004, -398.0, -1.0, -0.9996, -0.99, 0.0])
TARGETS = st.tuples(*(st.one_of(ANY, NEAR, st.floats(axis.lower_mm, axis.upper_mm)) for axis in AXES))
FEED = 1200.0


def written(line: str) -> tuple[float, ...]:
    """The place that a line names."""
    return tuple(float(number) for number in re.findall(r"[XYZ](-?\d+\.\d{3})", line))


@given(TARGETS)
def test_a_line_names_a_place_within_the_limits_or_is_not_written(target: tuple[float, float, float]) -> None:
    inside = all(axis.lower_mm <= value <= axis.upper_mm for axis, value in zip(AXES, target, strict=True))
    for line_of in (move_line, jog_line):
        if not inside:
            with pytest.raises(UnreachableError):
                line_of(target, FEED, AXES)
            continue
        place = written(line_of(target, FEED, AXES))
        assert len(place) == 3
        assert all(axis.lower_mm <= value <= axis.upper_mm for axis, value in zip(AXES, place, strict=True))


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("index", range(3))
def test_what_is_no_number_is_not_written_even_where_limits_mean_nothing_yet(wrong: float, index: int) -> None:
    target = [-10.0, -10.0, -10.0]
    target[index] = wrong
    with pytest.raises(UnreachableError, match="not finite"):
        jog_line((target[0], target[1], target[2]), FEED, None)
