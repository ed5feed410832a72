"""Renders an object through any camera: walls with recessed parts, clutter in front, sky behind, sensor on top.

Everything is made of flat polygons painted from far to near. Outlines of walls and parts are exact: each pixel gets the
area that the projected polygon covers of it (``sim_backends.coverage``).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.geometry import CameraPose
from rig.hal import Image
from sim_backends import backdrop
from sim_backends.appearance import Sensor
from sim_backends.clutter import Body
from sim_backends.coverage import Canvas, coverage
from sim_backends.ordering import paint_order
from sim_backends.projection import Internals, View
from sim_backends.scene import Scene
from sim_backends.sensor import expose
from sim_backends.textures import wall_seen

__all__ = ["DEFAULT_SIZE", "Internals", "PartTruth", "Scene", "render", "visible_parts"]

FloatArray = npt.NDArray[np.float64]

DEFAULT_SIZE = (1280, 960)
_WALL_ID = -2  # what the canvas' ids say of walls and clutter; parts have their index


@dataclass(frozen=True, slots=True)
class PartTruth:
    """Where a part is in a picture and how much of it can be seen.

    Attributes:
        id: the part's; part_class: its class.
        corners_px: ``(n, 2)``.
        fully_in_frame: all corners lie inside the picture.
        visible_fraction: of the part's area, not hidden by walls or clutter nor outside the picture.
        cos_incidence: cosine between the part's normal and the direction to the camera.
        size_px: square root of the part's area in the picture (parts of it outside included).
    """

    id: str
    part_class: str
    corners_px: FloatArray = field(repr=False)
    fully_in_frame: bool
    visible_fraction: float
    cos_incidence: float
    size_px: float


def render(
    scene: Scene,
    camera: CameraPose,
    internals: Internals,
    size: tuple[int, int] = DEFAULT_SIZE,
    *,
    rng: np.random.Generator,
    sensor: Sensor | None = None,
    tilt: FloatArray | None = None,
) -> Image:
    """A picture of the scene, ``(h, w, 3)`` BGR or ``(h, w)`` grey.

    Args:
        scene: what is there.
        camera: the camera's pose in the rig frame.
        internals: the camera's inside.
        size: width and height, pixels.
        rng: draws sensor noise and exposure; nothing else in the picture depends on it.
        sensor: blur, noise, exposure; ``None`` for the default ones.
        tilt: ``(3, 3)`` the mount's (`recognition.geometry.Mount.tilt`); ``None``: the camera hangs upright.

    Raises:
        InputError: the radial term folds back inside the picture.
    """
    view = View.of(camera, scene.object_in_rig, internals, size, tilt)
    look = scene.appearance
    behind = (
        backdrop.sky_and_ground(view, scene.ground_mm, scene.typical_mm, look.seed)
        if look.background
        else backdrop.plain(size)
    )
    canvas = Canvas(size, behind)
    _paint(scene, view, canvas)
    assert canvas.image is not None
    return expose(canvas.image, sensor or Sensor(), rng)


def visible_parts(
    scene: Scene,
    camera: CameraPose,
    internals: Internals,
    size: tuple[int, int] = DEFAULT_SIZE,
    *,
    tilt: FloatArray | None = None,
) -> list[PartTruth]:
    """The parts of which at least one pixel shows, from the same painter as the picture (arguments as of ``render``).

    Parts that reach behind the camera are left out: they have no outline in the picture.
    """
    view = View.of(camera, scene.object_in_rig, internals, size, tilt)
    canvas = Canvas(size, None)
    painted = _paint(scene, view, canvas)
    shown = np.bincount(canvas.ids[canvas.ids >= 0], minlength=len(scene.object_model.parts))
    truths = (_truth(scene, view, index, painted[index], int(shown[index])) for index in sorted(painted))
    return [truth for truth in truths if truth is not None]


def _truth(scene: Scene, view: View, index: int, painted: int, shown: int) -> PartTruth | None:
    part = scene.object_model.parts[index]
    corners = view.pixels(part.corners_mm)
    if shown == 0 or not np.all(np.isfinite(corners)):
        return None
    x, y = corners.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    inside = bool(np.all((corners >= 0) & (corners <= np.array(view.size) - 1)))
    towards = view.centre_mm - part.centre_mm
    return PartTruth(
        id=part.id,
        part_class=part.part_class,
        corners_px=corners,
        fully_in_frame=inside,
        visible_fraction=shown / painted * (1.0 if inside else min(1.0, painted / max(area, 1e-9))),
        cos_incidence=float(part.normal @ towards / np.linalg.norm(towards)),
        size_px=float(np.sqrt(area)),
    )


def _paint(scene: Scene, view: View, canvas: Canvas) -> dict[int, int]:
    """Paint all facets from far to near; returns the pixels first painted of each part."""
    painted: dict[int, int] = {}
    facing = np.einsum("ij,ij->i", scene.normals, view.centre_mm - np.array([w.corners_mm[0] for w in scene.walls])) > 0
    outlines = {
        index: outline
        for index, wall in enumerate(scene.walls)
        if facing[index] and (outline := view.polygon(wall.corners_mm)) is not None
    }
    n = len(scene.walls)
    centres = np.array([w.corners_mm.mean(axis=0) for w in scene.walls] + [b.centre_mm for b in scene.bodies])
    distances = np.linalg.norm(centres - view.centre_mm, axis=1)
    for index in paint_order([*outlines, *range(n, len(centres))], scene.hides, distances):
        if index >= n:
            _paint_body(scene.bodies[index - n], view, canvas)
        else:
            _paint_wall(scene, index, outlines[index], view, canvas, painted)
    return painted


def _paint_wall(
    scene: Scene, index: int, outline: FloatArray, view: View, canvas: Canvas, painted: dict[int, int]
) -> None:
    cover = coverage(outline, view.size)
    if cover is None:
        return
    drawing = canvas.image is not None
    wall = scene.walls[index]
    canvas.paint(cover, wall_seen(wall, scene.texture(index), outline, cover, view) if drawing else None, _WALL_ID)
    for part_index in wall.parts:
        part_outline = view.polygon(scene.object_model.parts[part_index].corners_mm)
        cover = None if part_outline is None else coverage(part_outline, view.size)
        if cover is None:
            continue
        colours = scene.openings[part_index].paint(view, cover, scene.appearance) if drawing else None
        pixels = canvas.paint(cover, colours, part_index)
        if pixels:
            painted[part_index] = pixels


def _paint_body(body: Body, view: View, canvas: Canvas) -> None:
    for corners, colour in body.polygons(view.centre_mm):
        outline = view.polygon(corners)
        if outline is not None:
            canvas.fill(outline, colour, _WALL_ID)
