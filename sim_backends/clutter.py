"""Things that stand in front of a façade: trees, pipes and jutting walls, as bodies in the object frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from recognition.modelbase import ObjectModel
from sim_backends.appearance import Bgr
from sim_backends.walls import Wall, walls_of

FloatArray = npt.NDArray[np.float64]
ColouredPolygon = tuple[FloatArray, Bgr]
"""Corners ``(n, 3)`` in the object frame, and a colour before exposure."""

_DOWN = np.array([0.0, 1.0, 0.0])


def _circle(n: int) -> FloatArray:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _cylinder(
    foot: FloatArray, top: FloatArray, radii: tuple[float, float], bgr: Bgr, camera: FloatArray
) -> Iterator[ColouredPolygon]:
    """The visible strips of an upright round post, shaded from left to right."""
    ring = _circle(14)
    level = np.stack([ring[:, 0], np.zeros(len(ring)), ring[:, 1]], axis=-1)
    low, high = foot + radii[0] * level, top + radii[1] * level
    towards = camera - foot
    towards = towards / max(float(np.hypot(towards[0], towards[2])), 1e-9)
    for i in range(len(ring)):
        j = (i + 1) % len(ring)
        outward = level[i] + level[j]
        if outward @ (camera - (low[i] + low[j]) / 2) <= 0:
            continue
        light = 0.62 + 0.38 * max(0.0, float(outward @ towards) / 2) + 0.12 * float(outward[0])
        colour = (bgr[0] * light, bgr[1] * light, bgr[2] * light)
        yield np.array([high[i], high[j], low[j], low[i]]), colour


@dataclass(frozen=True)
class Pipe:
    """An upright pipe: its foot (object frame), height and radius, mm."""

    foot_mm: tuple[float, float, float]
    height_mm: float
    radius_mm: float
    bgr: Bgr = (96.0, 100.0, 104.0)

    @property
    def centre_mm(self) -> FloatArray:
        """``(3,)``, for painting near things after far ones."""
        return np.asarray(self.foot_mm) - _DOWN * self.height_mm / 2

    def polygons(self, camera_mm: FloatArray) -> Iterator[ColouredPolygon]:
        """Polygons to be painted in this order as seen from ``camera_mm`` ``(3,)``."""
        foot = np.asarray(self.foot_mm)
        top = foot - _DOWN * self.height_mm
        yield from _cylinder(foot, top, (self.radius_mm, self.radius_mm), self.bgr, camera_mm)
        for at in (0.25, 0.75):  # clamps
            a, b = foot - _DOWN * self.height_mm * at, foot - _DOWN * (self.height_mm * at + self.radius_mm)
            yield from _cylinder(a, b, (1.2 * self.radius_mm, 1.2 * self.radius_mm), (70.0, 74.0, 78.0), camera_mm)


@dataclass(frozen=True)
class Tree:
    """A tree: its foot (object frame), height and the radius of its crown, mm; ``seed`` shapes the leaves."""

    foot_mm: tuple[float, float, float]
    height_mm: float
    radius_mm: float
    seed: int = 0
    bgr: Bgr = (52.0, 104.0, 84.0)

    @property
    def centre_mm(self) -> FloatArray:
        """``(3,)`` centre of the crown."""
        return np.asarray(self.foot_mm) - _DOWN * (self.height_mm - self.radius_mm)

    @cached_property
    def _leaves(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Centres ``(n, 3)``, radii ``(n,)``, outlines ``(n, 9, 2)`` in units of the radius, and tones ``(n,)``."""
        rng = np.random.default_rng([self.seed, 77])
        boughs = rng.normal(size=(9, 3)) * (0.42, 0.36, 0.42)
        count = 170
        spread = boughs[rng.integers(len(boughs), size=count)] + rng.normal(size=(count, 3)) * 0.24
        spread /= np.maximum(1.0, np.linalg.norm(spread, axis=1, keepdims=True))
        centres = self.centre_mm + spread * self.radius_mm
        radii = self.radius_mm * rng.uniform(0.07, 0.19, count)
        outlines = _circle(9)[None] * rng.uniform(0.6, 1.3, (count, 9, 1))
        # Leaves low in the crown and deep inside it get less light.
        outer = np.linalg.norm(spread, axis=1)
        tones = 0.65 - 0.35 * spread[:, 1] + 0.25 * outer + rng.normal(size=count) * 0.16
        return centres, radii, outlines, np.clip(tones, 0.3, 1.5)

    def polygons(self, camera_mm: FloatArray) -> Iterator[ColouredPolygon]:
        """Trunk, then leaves from far to near, as seen from ``camera_mm`` ``(3,)``."""
        foot = np.asarray(self.foot_mm)
        yield from _cylinder(
            foot, self.centre_mm, (0.09 * self.radius_mm, 0.06 * self.radius_mm), (44.0, 58.0, 72.0), camera_mm
        )
        centres, radii, outlines, tones = self._leaves
        towards = camera_mm - centres
        for i in np.argsort(-np.linalg.norm(towards, axis=1)):
            side = np.array([towards[i, 2], 0.0, -towards[i, 0]])
            side /= max(float(np.linalg.norm(side)), 1e-9)
            corners = centres[i] + radii[i] * (outlines[i, :, :1] * side + outlines[i, :, 1:] * _DOWN)
            b, g, r = self.bgr
            tone = float(tones[i])
            yield corners, (b * tone * tone, g * tone, r * tone)


@dataclass(frozen=True)
class JuttingWall:
    """A block that stands out of a façade, as a list of walls of its own (front, left and right side, top)."""

    walls: tuple[Wall, ...] = field(repr=False)

    @staticmethod
    def on(wall: Wall, at_mm: float, width_mm: float, depth_mm: float, height_mm: float) -> JuttingWall:
        """A block at ``at_mm`` along the wall from its left edge, standing on the wall's foot."""
        top_left, top_right, _, foot = wall.corners_mm
        along = (top_right - top_left) / wall.size_mm[0]
        a = foot + along * (at_mm - width_mm / 2)
        b, out, up = a + along * width_mm, wall.normal * depth_mm, -_DOWN * height_mm
        quads = {
            "front": (a + out + up, b + out + up, b + out, a + out),
            "left": (a + up, a + out + up, a + out, a),
            "right": (b + out + up, b + up, b, b + out),
            "top": (a + up, b + up, b + out + up, a + out + up),
        }
        name = f"{wall.id} block at {at_mm:.0f}"
        return JuttingWall(tuple(Wall(f"{name} {side}", np.array(corners)) for side, corners in quads.items()))


Body = Tree | Pipe
"""Clutter that is not made of walls."""

ClutterItem = Body | JuttingWall


def draw_clutter(
    model: ObjectModel, rng: np.random.Generator, *, trees: int = 1, pipes: int = 1, blocks: int = 1
) -> tuple[ClutterItem, ...]:
    """Clutter at random places in front of the object's façades: that many of each kind per wall with parts."""
    items: list[ClutterItem] = []
    typical = float(np.median([np.ptp(part.corners_mm[:, 1]) for part in model.parts]))
    for wall in walls_of(model):
        if not wall.parts:
            continue
        width, height = wall.size_mm
        foot, along = wall.corners_mm[3], (wall.corners_mm[1] - wall.corners_mm[0]) / width
        for _ in range(trees):
            radius = typical * float(rng.uniform(0.5, 0.9))
            place = foot + along * rng.uniform(0.1, 0.9) * width + wall.normal * radius * rng.uniform(1.05, 1.5)
            tall = min(height, typical * float(rng.uniform(1.6, 3.0)))
            items.append(Tree(_triple(place), tall, radius, int(rng.integers(2**31))))
        for _ in range(pipes):
            radius = typical * float(rng.uniform(0.04, 0.08))
            place = foot + along * rng.uniform(0.05, 0.95) * width + wall.normal * 2.0 * radius
            items.append(Pipe(_triple(place), height, radius))
        for _ in range(blocks):
            at = width * float(rng.uniform(0.1, 0.9))
            wide, deep = (typical * float(rng.uniform(low, high)) for low, high in ((0.2, 0.6), (0.2, 0.5)))
            items.append(JuttingWall.on(wall, at, wide, deep, height * float(rng.uniform(0.5, 1.0))))
    return tuple(items)


def _triple(point: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in point)
    return x, y, z
