"""Draws what is seen inside a part's outline: reveal sides, frame and bars, glass with reflections, an open window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.modelbase import Part
from rig.hal import Image
from sim_backends.appearance import Appearance, Bgr
from sim_backends.coverage import SHIFT, Coverage, fixed_point
from sim_backends.projection import NEAR_MM, View

FloatArray = npt.NDArray[np.float64]

_DETAIL_PX = 14  # openings smaller than this in the picture are drawn without frame and bars


@dataclass(frozen=True)
class Opening:
    """A part with everything about its looks that does not depend on the view.

    Attributes:
        part: the part; its corners are the outer edge of the reveal.
        axes: ``(3, 3)`` rows: right, down and inwards, unit vectors in the object frame.
        light: brightness of the wall around it.
        chance: ``(8,)`` numbers in [0, 1) that are this part's own.
    """

    part: Part
    axes: FloatArray
    light: float
    chance: FloatArray

    @staticmethod
    def of(part: Part, light: float, chance: FloatArray) -> Opening:
        """Prepare a part for drawing."""
        inwards = -part.normal
        right = np.cross([0.0, 1.0, 0.0], inwards)
        right = right / max(float(np.linalg.norm(right)), 1e-9)
        return Opening(part, np.stack([right, np.cross(inwards, right), inwards]), light, chance)

    def paint(self, view: View, cover: Coverage, look: Appearance) -> Image:
        """The colours ``(h, w, 3)`` of the window of ``cover`` as this opening fills it."""
        h, w = cover.fraction.shape
        patch = np.empty((h, w, 3), dtype=np.uint8)
        if self.part.part_class in look.bright_classes:
            return self._paint_open(patch, look)
        brush = _Brush(patch, view, (cover.x, cover.y))
        door = self.part.part_class in look.door_classes
        vary = 0.85 + 0.3 * float(self.chance[0])
        patch[:] = _scale(look.door_bgr if door else look.frame_bgr if look.bars else look.glass_bgr, self.light * vary)
        if look.bars or look.reflections > 0:
            if min(h, w) >= _DETAIL_PX:
                self._paint_door(brush, look) if door else self._paint_window(brush, look)
            else:
                patch[:] = _scale(look.door_bgr if door else look.glass_bgr, self.light * vary)
        self._paint_reveal(brush, look)
        return patch

    def _paint_open(self, patch: Image, look: Appearance) -> Image:
        """An open window: a lit room, a little darker towards its floor."""
        fall = np.linspace(1.0, 0.93, len(patch), dtype=np.float32)[:, None, None]
        patch[:] = np.clip(fall * np.asarray(look.open_bgr, dtype=np.float32), 0, 255).astype(np.uint8)
        return patch

    def _box(self) -> tuple[FloatArray, float, float, float]:
        """Top-left corner of the bounding box in the pane's plane, its width, height, and the depth of the pane."""
        flat = self.part.corners_mm @ self.axes.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        depth = float(flat[:, 2].mean()) + self.part.recess_mm
        return np.array([low[0], low[1], depth]), float(high[0] - low[0]), float(high[1] - low[1]), depth

    def _rectangles(self, spans: FloatArray, sink: float = 0.0) -> FloatArray:
        """Corners ``(m, 4, 3)`` of rectangles ``(m, 4)`` (left, top, right, bottom; 0..1 of the box) on the pane."""
        origin, width, height, _ = self._box()
        x, y = spans[:, [0, 2, 2, 0]] * width, spans[:, [1, 1, 3, 3]] * height
        flat = origin + np.stack([x, y, np.full_like(x, sink)], axis=-1)
        return np.asarray(flat @ self.axes)

    def _paint_window(self, brush: _Brush, look: Appearance) -> None:
        _, width, height, _ = self._box()
        columns = max(1, min(4, round(width / height * 3.0))) if look.bars else 1
        rows = max(1, min(4, round(height / width * 1.9))) if look.bars else 1
        bar = 0.045 if look.bars else 0.0
        x, y = np.linspace(bar, 1.0, columns + 1), np.linspace(bar, 1.0, rows + 1)
        panes = np.array(
            [[x[i], y[j], x[i + 1] - bar, y[j + 1] - bar] for j in range(rows) for i in range(columns)],
            dtype=np.float64,
        )
        # Each pane hangs a little differently and so mirrors a slightly different piece of sky.
        tones = 0.85 + 0.3 * ((self.chance[1] * 7.3 + np.arange(len(panes)) * 0.37) % 1.0)
        for corners, tone in zip(self._rectangles(panes, 0.01 * width), tones, strict=True):
            brush.fill(corners, _scale(look.glass_bgr, self.light * float(tone)))
        if self.chance[2] < look.reflections:
            self._paint_reflection(brush, panes, look)

    def _paint_reflection(self, brush: _Brush, panes: FloatArray, look: Appearance) -> None:
        """Sky mirrored in the panes: a slanting bright streak and a patch at the top, moving with the camera."""
        origin, width, _, _ = self._box()
        eye = (brush.view.centre_mm @ self.axes.T) - origin
        moved = 0.35 * float(eye[0]) / max(abs(float(eye[2])), width)
        sky = _scale((250.0, 240.0, 228.0), 0.45 + 0.55 * look.reflections * float(0.5 + 0.5 * self.chance[3]))
        left = (float(self.chance[4]) + moved) % 1.3 - 0.2
        wide = 0.1 + 0.22 * float(self.chance[5])
        for x0, y0, x1, y1 in panes:
            slant = 0.35 * (y1 - y0)
            a, b = np.clip([left, left + wide], x0, x1)
            if b - a > 0.01:
                top = np.clip([a + slant, b + slant], x0, x1)
                brush.fill(self._quad([(top[0], y0), (top[1], y0), (b, y1), (a, y1)]), sky)
            if self.chance[6] < 0.6 * look.reflections and y0 < 0.3:
                brush.fill(
                    self._quad([(x0, y0), (x1, y0), (x1, y0 + 0.4 * (y1 - y0)), (x0, y0 + 0.7 * (y1 - y0))]), sky
                )

    def _quad(self, places: list[tuple[float, float]]) -> FloatArray:
        origin, width, height, _ = self._box()
        flat = origin + np.array([(x * width, y * height, 0.0) for x, y in places])
        return np.asarray(flat @ self.axes)

    def _paint_door(self, brush: _Brush, look: Appearance) -> None:
        panels = np.array([[0.14, 0.06, 0.86, 0.3], [0.14, 0.36, 0.46, 0.92], [0.54, 0.36, 0.86, 0.92]])
        for corners in self._rectangles(panels):
            brush.fill(corners, _scale(look.door_bgr, 0.72 * self.light))

    def _paint_reveal(self, brush: _Brush, look: Appearance) -> None:
        """The sides of the recess that face the camera, far ones first; always darker than the wall."""
        part = self.part
        if part.recess_mm <= 0:
            return
        outer, following = part.corners_mm, np.roll(part.corners_mm, -1, axis=0)
        sink = self.axes[2] * part.recess_mm
        # Corners run clockwise, so (inwards x edge) points into the opening.
        facing = np.cross(self.axes[2], following - outer)
        facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
        towards = brush.view.centre_mm - (outer + following) / 2
        for i in np.argsort(-np.linalg.norm(towards, axis=1)):
            if facing[i] @ towards[i] <= 0:
                continue
            down, across = float(facing[i, 1]), float(facing[i] @ self.axes[0])
            tone = look.reveal * (1.0 - 0.23 * down + 0.1 * across)  # sills (facing up) are lit, lintels lie in shade
            quad = np.array([outer[i], following[i], following[i] + sink, outer[i] + sink])
            brush.fill(quad, _scale(look.wall_bgr, self.light * tone))


@dataclass(frozen=True)
class _Brush:
    """Fills polygons given in the object frame on a patch whose top-left pixel is ``corner`` of the picture."""

    patch: Image
    view: View
    corner: tuple[int, int]

    def fill(self, corners_mm: FloatArray, bgr: Bgr) -> None:
        import cv2

        if self.view.in_camera(corners_mm)[:, 2].min() < NEAR_MM:
            outline = self.view.polygon(corners_mm)
            if outline is None:
                return
        else:
            outline = self.view.pixels(corners_mm)
        cv2.fillPoly(self.patch, [fixed_point(outline - self.corner)], bgr, cv2.LINE_AA, SHIFT)


def _scale(bgr: Bgr, factor: float) -> Bgr:
    b, g, r = (min(255.0, c * factor) for c in bgr)
    return b, g, r
