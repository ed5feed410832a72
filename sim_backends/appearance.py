"""How a rendered scene looks: light, materials and openings of the object, and the sensor that takes the picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Bgr = tuple[float, float, float]

MATERIALS = ("plaster", "brick", "stone")


@dataclass(frozen=True, slots=True)
class Appearance:
    """Colours are BGR, 0..255, before light and shade.

    Attributes:
        seed: of all textures and of everything that differs from part to part.
        material: of the walls, one of ``MATERIALS``.
        wall_bgr: the walls' colour.
        texture: standard deviation of the walls' texture relative to their brightness; 0 for none.
        glass_bgr, frame_bgr, open_bgr, door_bgr: of panes, window frames, open windows, doors.
        reveal: brightness of the sides of a recess relative to the wall; sills are a quarter lighter, lintels darker.
        bars: windows have a frame and glazing bars.
        reflections: 0 (none) to 1 (every pane, bright as the sky): streaks and patches of sky on panes.
        bright_classes: part-classes that are brighter than the wall.
        door_classes: part-classes drawn as doors.
        ambient: light from everywhere as a fraction of full light; the rest depends on the angle to the sun.
        sun: ``(3,)`` direction to the sun in the object frame (Y down).
        background: draw sky and ground; otherwise an even grey.
    """

    seed: int = 0
    material: str = "plaster"
    wall_bgr: Bgr = (150.0, 172.0, 186.0)
    texture: float = 0.035
    glass_bgr: Bgr = (52.0, 42.0, 34.0)
    frame_bgr: Bgr = (52.0, 62.0, 70.0)
    open_bgr: Bgr = (222.0, 242.0, 250.0)
    door_bgr: Bgr = (34.0, 46.0, 66.0)
    reveal: float = 0.52
    bars: bool = True
    reflections: float = 0.0
    bright_classes: frozenset[str] = frozenset({"OPEN"})
    door_classes: frozenset[str] = frozenset({"DW8HANDLE"})
    ambient: float = 0.68
    sun: tuple[float, float, float] = (-0.5, -0.6, -0.62)
    background: bool = True

    def shade(self, normal: FloatArray) -> float:
        """Brightness of a surface with that unit normal, 0..1 (ambient plus Lambert's law)."""
        sun = np.asarray(self.sun) / np.linalg.norm(self.sun)
        return float(self.ambient + (1.0 - self.ambient) * max(0.0, float(normal @ sun)))


@dataclass(frozen=True, slots=True)
class Sensor:
    """What lens and sensor do to a picture.

    Attributes:
        blur_px: standard deviation of the blur; 0 for none.
        noise_sd: of the noise, grey levels; 0 for none.
        exposure: brightness factor.
        exposure_sd: relative spread of the exposure from view to view.
        grey: give a grey picture instead of BGR.
    """

    blur_px: float = 0.6
    noise_sd: float = 2.0
    exposure: float = 1.0
    exposure_sd: float = 0.0
    grey: bool = False


_WALL_COLOURS: dict[str, tuple[Bgr, ...]] = {
    "plaster": ((150, 172, 186), (172, 180, 184), (138, 176, 196), (162, 184, 170)),
    "brick": ((112, 132, 172), (122, 146, 180), (140, 156, 176)),
    "stone": ((150, 160, 166), (138, 158, 172), (160, 164, 162)),
}
_FRAME_COLOURS: tuple[Bgr, ...] = ((52, 62, 70), (40, 56, 44), (38, 46, 66), (70, 62, 56))


def draw_appearance(rng: np.random.Generator, **changes: Any) -> Appearance:
    """An appearance drawn from a generator: material, colours and the sun's direction; ``changes`` set fields."""
    material = str(rng.choice(MATERIALS))
    walls = _WALL_COLOURS[material]
    drawn = Appearance(
        seed=int(rng.integers(2**31)),
        material=material,
        wall_bgr=walls[int(rng.integers(len(walls)))],
        frame_bgr=_FRAME_COLOURS[int(rng.integers(len(_FRAME_COLOURS)))],
        sun=(float(rng.uniform(-1, 1)), -0.7, float(rng.uniform(-1, 1))),
    )
    return replace(drawn, **changes)


HIGH_CONTRAST = Appearance(
    wall_bgr=(220, 220, 220),
    texture=0.0,
    glass_bgr=(0, 0, 0),
    frame_bgr=(0, 0, 0),
    door_bgr=(0, 0, 0),
    reveal=0.0,
    bars=False,
    ambient=1.0,
    background=False,
)
"""Flat light and colours without texture: what measurements of exactness are taken on."""

PERFECT = Sensor(blur_px=0.0, noise_sd=0.0)
"""A lens without blur and a sensor without noise."""
