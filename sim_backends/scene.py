"""An object standing in the rig frame with all that is around it, and everything about it that no view changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from recognition.geometry import Pose4
from recognition.modelbase import ObjectModel
from sim_backends.appearance import Appearance
from sim_backends.clutter import Body, ClutterItem, JuttingWall
from sim_backends.openings import Opening
from sim_backends.ordering import hiding_matrix
from sim_backends.textures import WallTexture, wall_texture
from sim_backends.walls import Wall, walls_of

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """An object standing in the rig frame, with what stands in front of it.

    Attributes:
        object_model: the object; walls are fitted to its parts where it has no faces.
        object_in_rig: object -> rig.
        appearance: light, colours and materials.
        clutter: bodies in the object frame.
    """

    object_model: ObjectModel = field(repr=False)
    object_in_rig: Pose4 = field(default_factory=lambda: Pose4(0.0, 0.0, 0.0, 0.0))
    appearance: Appearance = field(default_factory=Appearance)
    clutter: tuple[ClutterItem, ...] = field(default=(), repr=False)

    @cached_property
    def walls(self) -> tuple[Wall, ...]:
        """The object's walls, then those of jutting blocks."""
        blocks = [wall for item in self.clutter if isinstance(item, JuttingWall) for wall in item.walls]
        return (*walls_of(self.object_model), *blocks)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """Clutter that is not made of walls."""
        return tuple(item for item in self.clutter if not isinstance(item, JuttingWall))

    @cached_property
    def ground_mm(self) -> float:
        """The ground's height: the lowest point of any wall (Y down)."""
        return float(max(wall.corners_mm[:, 1].max() for wall in self.walls))

    @cached_property
    def typical_mm(self) -> float:
        """Median height of the parts."""
        return float(np.median([np.ptp(part.corners_mm[:, 1]) for part in self.object_model.parts]))

    @cached_property
    def normals(self) -> FloatArray:
        """``(n, 3)`` outward normals of the walls."""
        return np.array([wall.normal for wall in self.walls])

    @cached_property
    def lights(self) -> tuple[float, ...]:
        """Brightness of each wall, 0..1."""
        return tuple(self.appearance.shade(normal) for normal in self.normals)

    @cached_property
    def hides(self) -> npt.NDArray[np.bool_]:
        """``(n, n)``: [i, j] if facet i can hide facet j; walls first, then bodies."""
        return hiding_matrix(self.walls, np.array([body.centre_mm for body in self.bodies]).reshape(-1, 3))

    @cached_property
    def _textures(self) -> dict[int, WallTexture]:
        return {}

    def texture(self, index: int) -> WallTexture:
        """Of the wall with that index: made when it is first seen (up to 0.2 s and 8 MB a wall), then kept."""
        if index not in self._textures:
            self._textures[index] = wall_texture(
                np.random.default_rng([self.appearance.seed, 11, index]),
                *self.walls[index].size_mm,
                self.typical_mm / 15,
                self.lights[index],
                self.appearance,
            )
        return self._textures[index]

    @cached_property
    def openings(self) -> Mapping[int, Opening]:
        """Part index -> the part, ready for drawing."""
        parts = self.object_model.parts
        chance = np.random.default_rng([self.appearance.seed, 23]).random((len(parts), 8))
        return {
            index: Opening.of(parts[index], light, chance[index])
            for wall, light in zip(self.walls, self.lights, strict=True)
            for index in wall.parts
        }
