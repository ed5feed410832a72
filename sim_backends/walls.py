"""The walls of an object as facets to be painted: given faces, or walls fitted to the parts where there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.modelbase import Face, ObjectModel, Part

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Wall:
    """A flat wall and the parts on it.

    Attributes:
        id: the face's name.
        corners_mm: ``(4, 3)`` object frame, clockwise as seen from outside, top-left first.
        parts: indices into the object's parts.
    """

    id: str
    corners_mm: FloatArray = field(repr=False)
    parts: tuple[int, ...] = ()

    @property
    def normal(self) -> FloatArray:
        """``(3,)`` unit normal pointing outwards."""
        a, b, c, d = self.corners_mm
        outward = np.cross(d - b, c - a)
        return np.asarray(outward / np.linalg.norm(outward))

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width along the top edge and height along the left edge."""
        a, b, _, d = self.corners_mm
        return float(np.linalg.norm(b - a)), float(np.linalg.norm(d - a))


def walls_of(model: ObjectModel) -> tuple[Wall, ...]:
    """The object's walls with their parts; parts on no given face get a wall fitted to them."""
    given = {face.id: face for face in model.faces}
    on_face: dict[str, list[int]] = {name: [] for name in given}
    loose: list[int] = []
    for index, part in enumerate(model.parts):
        home = part.face if part.face in given else _face_under(part, model.faces)
        if home is None:
            loose.append(index)
        else:
            on_face[home].append(index)
    walls = [Wall(name, face.corners_mm, tuple(on_face[name])) for name, face in given.items()]
    return (*walls, *_fitted_walls(model, loose))


def _face_under(part: Part, faces: Sequence[Face]) -> str | None:
    """The given face in whose plane the part lies, if any."""
    for face in faces:
        wall = Wall(face.id, face.corners_mm)
        offset = np.abs((part.corners_mm - face.corners_mm[0]) @ wall.normal).max()
        width, height = wall.size_mm
        top_left, across, down = face.corners_mm[0], face.corners_mm[1], face.corners_mm[3]
        x = (part.centre_mm - top_left) @ (across - top_left) / width**2
        y = (part.centre_mm - top_left) @ (down - top_left) / height**2
        if offset < 0.01 * max(width, height) and part.normal @ wall.normal > 0.9 and 0 <= x <= 1 and 0 <= y <= 1:
            return face.id
    return None


def _fitted_walls(model: ObjectModel, indices: Sequence[int]) -> list[Wall]:
    groups: list[tuple[str | None, list[int]]] = []
    for index in indices:
        part = model.parts[index]
        for name, members in groups:
            first = model.parts[members[0]]
            extent = float(np.ptp(first.corners_mm, axis=0).max())
            coplanar = (
                part.normal @ first.normal > 0.97
                and abs((part.centre_mm - first.centre_mm) @ first.normal) < 0.15 * extent
            )
            if part.face == name and (name is not None or coplanar):
                members.append(index)
                break
        else:
            groups.append((part.face, [index]))
    return _stood_on_the_ground([_fit(name or f"wall {n + 1}", model, m) for n, (name, m) in enumerate(groups)])


def _stood_on_the_ground(walls: list[Wall]) -> list[Wall]:
    """The walls reaching down as far as the lowest of them: fitted to upper windows, they would hang in the air."""
    ground = max((float(wall.corners_mm[:, 1].max()) for wall in walls), default=0.0)
    standing = []
    for wall in walls:
        corners = wall.corners_mm.copy()
        corners[2:, 1] = ground
        standing.append(Wall(wall.id, corners, wall.parts))
    return standing


def _fit(name: str, model: ObjectModel, members: list[int]) -> Wall:
    """A vertical rectangle around the parts, half a part's width wider on each side."""
    parts = [model.parts[i] for i in members]
    outward = np.sum([p.normal for p in parts], axis=0) * (1.0, 0.0, 1.0)
    outward /= np.linalg.norm(outward)
    right = np.cross(outward, [0.0, 1.0, 0.0])  # X right as seen from outside, with Y down
    points = np.concatenate([p.corners_mm for p in parts])
    margin = 0.5 * float(np.median([np.ptp(p.corners_mm @ right) for p in parts]))
    depth = float(np.mean(points @ outward))
    x0, x1 = (points @ right).min() - margin, (points @ right).max() + margin
    y0, y1 = points[:, 1].min() - margin, points[:, 1].max() + margin
    corners = [
        x * right + y * np.array([0.0, 1.0, 0.0]) + depth * outward for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    ]
    return Wall(name, np.array(corners), tuple(members))
