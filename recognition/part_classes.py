"""The part-classes that every model base may use without defining them."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from recognition.modelbase import PartClass

_OUTLINES: dict[str, list[tuple[float, float]]] = {
    # An L whose upright stands left (DW6L) or right (DW6R). Upright and foot differ in width, so that neither is a
    # turned copy of the other.
    "DW6L": [(0, 0), (0.35, 0), (0.35, 0.55), (1, 0.55), (1, 1), (0, 1)],
    "DW6R": [(0.65, 0), (1, 0), (1, 1), (0, 1), (0, 0.55), (0.65, 0.55)],
    # A door with a notch for its handle in the right-hand side.
    "DW8HANDLE": [(0, 0), (1, 0), (1, 0.42), (0.76, 0.42), (0.76, 0.60), (1, 0.60), (1, 1), (0, 1)],
    "DW8T": [(0, 0), (1, 0), (1, 0.40), (0.68, 0.40), (0.68, 1), (0.32, 1), (0.32, 0.40), (0, 0.40)],
    # A cross whose bar sits above the middle, so that it has one upright position only.
    "DW12": [
        *[(0.32, 0), (0.68, 0), (0.68, 0.30), (1, 0.30), (1, 0.62), (0.68, 0.62)],
        *[(0.68, 1), (0.32, 1), (0.32, 0.62), (0, 0.62), (0, 0.30), (0.32, 0.30)],
    ],
}


def _outlined(name: str) -> PartClass:
    outline = np.array(_OUTLINES[name], dtype=np.float64)
    outline.setflags(write=False)
    return PartClass(name, len(outline), outline, bright=False)


BUILT_IN_CLASSES = MappingProxyType(
    {
        # A closed window may be darker or brighter than its wall; see `recognition.modelbase_io` for when it may not.
        "DW4": PartClass("DW4", 4, None, bright=None),
        "DW6L": _outlined("DW6L"),
        "DW6R": _outlined("DW6R"),
        "OPEN": PartClass("OPEN", 4, None, bright=True),
        "DW8HANDLE": _outlined("DW8HANDLE"),
        "DW8T": _outlined("DW8T"),
        "DW12": _outlined("DW12"),
    }
)
"""Class name to class. Corners run clockwise from the top-left, seen from outside, in the unit square (y down)."""
