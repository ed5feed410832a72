"""Twenty classes of degenerate parts: each random member is refused, and the sound part it was made from is not."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recognition.geometry import rotation_y
from recognition.modelbase_io import parse_model_base
from recognition.part_classes import BUILT_IN_CLASSES
from rig.errors import ModelBaseError

FloatArray = npt.NDArray[np.float64]
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def placed(outline: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The outline as a part of 30-50 mm on an upright wall that faces anywhere."""
    flat = np.column_stack([outline * rng.uniform(30, 50, 2), np.zeros(len(outline))])
    return flat @ rotation_y(rng.uniform(-np.pi, np.pi)) + rng.uniform(-500, 500, 3)


def sound(name: str, rng: np.random.Generator) -> FloatArray:
    outline = BUILT_IN_CLASSES[name].canonical
    return placed(SQUARE if outline is None else outline, rng)


def normal(c: FloatArray) -> FloatArray:
    area = np.cross(c, np.roll(c, -1, axis=0)).sum(axis=0)
    return np.asarray(area / np.linalg.norm(area))


def swapped(c: FloatArray, i: int, j: int) -> FloatArray:
    order = list(range(len(c)))
    order[i], order[j] = order[j], order[i]
    return c[order]


def replaced(c: FloatArray, i: int, point: FloatArray) -> FloatArray:
    out = c.copy()
    out[i] = point
    return out


Maker = Callable[[FloatArray, int, np.random.Generator], FloatArray]
DEGENERATE: dict[str, tuple[str, Maker]] = {
    "three corners": ("DW4", lambda c, i, r: np.delete(c, i, axis=0)),
    "two corners": ("DW4", lambda c, i, r: c[:2]),
    "a corner too many": ("DW4", lambda c, i, r: np.insert(c, 1, (c[0] + c[1]) / 2 - 3 * (c[3] - c[0]) / 9, axis=0)),
    "a corner too few": ("DW6L", lambda c, i, r: np.delete(c, i, axis=0)),
    "repeated neighbour": ("DW4", lambda c, i, r: replaced(c, i, c[i - 1])),
    "repeated opposite": ("DW4", lambda c, i, r: replaced(c, i, c[i - 2])),
    "nearly repeated": ("DW4", lambda c, i, r: replaced(c, i, c[i - 1] + r.uniform(-0.01, 0.01, 3))),
    "all the same": ("DW4", lambda c, i, r: np.repeat(c[:1], 4, axis=0)),
    "on one line": ("DW4", lambda c, i, r: c[0] + np.outer([0, *r.uniform(0.1, 0.9, 2), 1], c[1] - c[0])),
    "nearly on one line": ("DW4", lambda c, i, r: c[[0, 1, 1, 0]] + np.outer([0, 0, 0.005, 0.005], c[3] - c[0])),
    "three on one line": (
        "DW4",
        lambda c, i, r: replaced(c, i, c[i - 1] + r.uniform(0.2, 0.8) * (c[i - 3] - c[i - 1])),
    ),
    "spike": ("DW4", lambda c, i, r: replaced(c, i, c[i - 2] + r.uniform(0.2, 0.8) * (c[i - 1] - c[i - 2]))),
    "bent": ("DW4", lambda c, i, r: replaced(c, i, c[i] + r.uniform(8, 30) * normal(c))),
    "crossing": ("DW4", lambda c, i, r: swapped(c, i, (i + 1) % 4)),
    "crossing, many corners": ("DW12", lambda c, i, r: swapped(c, i % 12, (i + 5) % 12)),
    "turned start": ("DW4", lambda c, i, r: np.roll(c, 1 + i % 3, axis=0)),
    "turned start, many corners": ("DW8T", lambda c, i, r: np.roll(c, 1 + i % 7, axis=0)),
    "anticlockwise": ("DW4", lambda c, i, r: c[[0, 3, 2, 1]]),
    "anticlockwise, many corners": ("DW6R", lambda c, i, r: c[::-1]),
    "mirror image of its class": ("DW6L", lambda c, i, r: sound("DW6R", r)),
}


def file_with(name: str, corners: FloatArray) -> str:
    return f"objects:\n- id: o\n  parts:\n  - {{id: p, class: {name}, corners_mm: {json.dumps(corners.tolist())}}}\n"


@pytest.mark.parametrize(("name", "make"), DEGENERATE.values(), ids=DEGENERATE.keys())
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), corner=st.integers(0, 3))
def test_degenerate_parts_are_refused_and_sound_ones_are_not(name: str, make: Maker, seed: int, corner: int) -> None:
    rng = np.random.default_rng(seed)
    corners = sound(name, rng)
    parse_model_base(file_with(name, corners), "m.yaml")
    with pytest.raises(ModelBaseError, match=r"m\.yaml:4:"):
        parse_model_base(file_with(name, make(corners, corner, rng)), "m.yaml")
