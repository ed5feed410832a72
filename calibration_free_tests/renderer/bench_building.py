"""A small building with parts of every class, built by hand: what the tests and benchmarks of the renderer look at."""

from __future__ import annotations

import numpy as np

from recognition.geometry import CameraPose, Pose4
from recognition.modelbase import Face, ModelBase, ObjectModel, Part, PartClass

Outline = tuple[tuple[float, float], ...]

RECTANGLE: Outline = ((0, 0), (1, 0), (1, 1), (0, 1))
OUTLINES: dict[str, Outline] = {
    "DW4": RECTANGLE,
    "OPEN": RECTANGLE,
    "DW6L": ((0, 0), (0.55, 0), (0.55, 0.5), (1, 0.5), (1, 1), (0, 1)),
    "DW6R": ((0.45, 0), (1, 0), (1, 1), (0, 1), (0, 0.5), (0.45, 0.5)),
    "DW8T": ((0, 0), (1, 0), (1, 0.4), (0.7, 0.4), (0.7, 1), (0.3, 1), (0.3, 0.4), (0, 0.4)),
    "DW8HANDLE": ((0, 0), (1, 0), (1, 0.45), (0.85, 0.45), (0.85, 0.6), (1, 0.6), (1, 1), (0, 1)),
    "DW12": (
        *((0.33, 0), (0.67, 0), (0.67, 0.33), (1, 0.33), (1, 0.67), (0.67, 0.67)),
        *((0.67, 1), (0.33, 1), (0.33, 0.67), (0, 0.67), (0, 0.33), (0.33, 0.33)),
    ),
}
CLASSES = tuple(
    PartClass(name, len(outline), np.array(outline) if len(outline) > 4 else None, name == "OPEN")
    for name, outline in OUTLINES.items()
)
DOWN = np.array([0.0, 1.0, 0.0])


def wall_face(name: str, foot_left: np.ndarray, foot_right: np.ndarray, height_mm: float) -> Face:
    """A vertical wall on a foot line, left to right as seen from outside."""
    up = -DOWN * height_mm
    return Face(name, np.array([foot_left + up, foot_right + up, foot_right, foot_left]))


def part_on(face: Face, part_id: str, part_class: str, x: float, y: float, w: float, h: float, recess: float) -> Part:
    """A part with its bounding box at (x, y), mm from the face's top-left corner."""
    top_left, top_right = face.corners_mm[:2]
    along = (top_right - top_left) / np.linalg.norm(top_right - top_left)
    corners = [top_left + along * (x + u * w) + DOWN * (y + v * h) for u, v in OUTLINES[part_class]]
    return Part(part_id, part_class, np.array(corners), face.id, None, recess)


def building(
    footprint: tuple[tuple[float, float], ...] = ((-240, 0), (240, 0), (240, 320), (-240, 320)),
) -> ObjectModel:
    """A building on a footprint (x, z), listed so that outside is on the right: four rows of parts, every class."""
    corners = [np.array([x, 0.0, z]) for x, z in footprint]
    special = list(OUTLINES)
    faces, parts, count = [], [], 0
    for f, (left, right) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        face = wall_face(f"F{f}", left, right, 300.0)
        faces.append(face)
        for row in range(4):
            for column in range(int(np.linalg.norm(right - left) // 70)):
                name = special[(count // 5) % 7] if (count * 7) % 5 == 0 else "DW4"
                w, h = (30.0, 40.0) if len(OUTLINES[name]) == 4 else (44.0, 46.0)
                at = (20.0 + 70 * column, 18.0 + 70 * row)
                parts.append(part_on(face, f"{face.id}_{row}_{column}", name, *at, w, h, 6.0))
                count += 1
    return ObjectModel("bench building", tuple(parts), tuple(faces))


def model_base() -> ModelBase:
    """A model base with the building as its only object."""
    return ModelBase((building(),), CLASSES, "bench")


def camera_at(theta_deg: float, x_mm: float, y_mm: float, z_mm: float, object_in_rig: Pose4) -> CameraPose:
    """The rig-frame pose of a camera given in the object frame."""
    in_object = CameraPose(theta_deg, x_mm, y_mm, z_mm)
    return CameraPose.from_to_camera(in_object.to_camera() @ object_in_rig.inverse())
