"""Links between neighbouring parts of an object: how one part stands in the frame of another."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from recognition.modelbase import ObjectModel, Part

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Link:
    """``p_from = rotation p_to + translation_mm``: the part ``to_id`` in the frame of the part ``from_id``."""

    from_id: str
    to_id: str
    rotation: FloatArray = field(repr=False)
    translation_mm: FloatArray = field(repr=False)

    @property
    def turn_deg(self) -> float:
        """By how much the two parts face apart, degrees: 0 on one wall, 90 round a corner."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0))))

    def as_numbers(self) -> dict[str, Any]:
        """The link as plain JSON: ``from``, ``to``, ``rotation`` (rows) and ``translation_mm``."""
        return {
            "from": self.from_id,
            "to": self.to_id,
            "rotation": self.rotation.tolist(),
            "translation_mm": self.translation_mm.tolist(),
        }


def part_frame(part: Part) -> tuple[FloatArray, FloatArray]:
    """A part's own frame in the object: rotation ``(3, 3)`` and centre ``(3,)``, mm.

    The rotation's columns are X along the part's top, Y down, Z into the wall.
    """
    into = -part.normal
    along = part.corners_mm[1] - part.corners_mm[0]
    x = along - (along @ into) * into
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(into, x), into], axis=1), part.centre_mm


def links(thing: ObjectModel, neighbours: int = 6, max_turn_deg: float = 100.0) -> tuple[Link, ...]:
    """Links from each part to its nearest ``neighbours`` that face at most ``max_turn_deg`` away from it (design §4).

    Parts that face further away cannot be in one picture with it, or follow in the next.
    """
    frames = [part_frame(part) for part in thing.parts]
    centres = np.stack([centre for _, centre in frames])
    normals = np.stack([part.normal for part in thing.parts])
    facing = float(np.cos(np.radians(max_turn_deg)))
    found: list[Link] = []
    for i, part in enumerate(thing.parts):
        rotation, centre = frames[i]
        distance = np.linalg.norm(centres - centre, axis=1)
        distance[(normals @ normals[i] < facing) | (np.arange(len(distance)) == i)] = np.inf
        for j in np.argsort(distance, kind="stable")[:neighbours]:
            if np.isfinite(distance[j]):
                turn, shift = rotation.T @ frames[j][0], rotation.T @ (centres[j] - centre)
                found.append(Link(part.id, thing.parts[j].id, turn, shift))
    return tuple(found)
