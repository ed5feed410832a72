"""Which parts of one object a camera sees where, by projection alone: no picture is painted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from recognition.geometry import CameraPose
from recognition.layout import Layout, compile_layout
from recognition.modelbase import ModelBase, ObjectModel, PartClass
from recognition.visibility import LEAST_PART_PX, Pairs, parts_in_view, walls_of
from sim_backends.projection import Internals


class Sightlines:
    """An object compiled for looking at it from many places. Its walls hide, clutter does not."""

    def __init__(self, thing: ObjectModel, classes: Sequence[PartClass]) -> None:
        """``classes``: those of the object's parts, and others."""
        self.layout: Layout = compile_layout(ModelBase((thing,), tuple(classes)))
        self._walls = walls_of(self.layout)

    def seen(
        self,
        cameras: Sequence[CameraPose],
        internals: Sequence[Internals],
        size: tuple[int, int],
        *,
        margin_px: float = 0.0,
        least_px: float = LEAST_PART_PX,
    ) -> Pairs:
        """Parts in view; ``hypothesis`` of the pairs counts the cameras.

        Args:
            cameras: in the object frame.
            internals: one for each camera; radial terms are left out.
            size: of the pictures, pixels.
            margin_px: corners must be so far inside the frame; negative: may be so far outside.
            least_px: parts smaller than this are left out.
        """
        count = len(cameras)
        rows = np.array([[np.radians(c.theta_deg), *c.centre_mm] for c in cameras]).reshape(-1, 4)
        inner = np.array([[i.fx, i.fy, i.u0, i.v0] for i in internals]).reshape(-1, 4)
        return parts_in_view(
            self.layout,
            self._walls,
            np.zeros(count, dtype=np.int64),
            np.zeros((count, 4)),
            rows,
            inner,
            size,
            margin_px=margin_px,
            least_px=least_px,
        )
