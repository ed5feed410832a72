"""Renders an object from all around into an image grid, with the truth beside it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from recognition.geometry import Mount
from recognition.modelbase import ModelBase, ObjectModel
from rig.errors import InputError
from rig.hal import RigPose
from rig.imagegrid import GridInfo, GridWriter
from sim_backends.appearance import Appearance, Sensor, draw_appearance
from sim_backends.clutter import ClutterItem, draw_clutter
from sim_backends.internals_policy import InternalsPolicy
from sim_backends.rendered_rig import Lattice, RenderedRig
from sim_backends.renderer import DEFAULT_SIZE, PartTruth
from sim_backends.scene import Scene
from sim_backends.viewpoints import draw_placement, limits_around, viewing_poses

FRACTION_SHOWN = 0.99
"""A part counts as visible if this much of it shows."""


def draw_scene(
    model_base: ModelBase,
    object_id: str,
    seed: int,
    *,
    cluttered: bool = False,
    appearance: Appearance | None = None,
    clutter: Sequence[ClutterItem] | None = None,
) -> Scene:
    """An object of the model base standing somewhere in the rig frame, everything drawn from the seed.

    Args:
        model_base: holds the object; its classes say which parts are brighter than the wall.
        object_id: which object.
        seed: of the placement, the looks and the clutter.
        cluttered: with trees, pipes and jutting walls in front, and reflections on panes.
        appearance: looks to be used instead of drawn ones.
        clutter: clutter to be used instead of drawn clutter.

    Raises:
        InputError: there is no such object.
    """
    model = _object(model_base, object_id)
    rng = np.random.default_rng([seed, 1])
    place = draw_placement(rng)
    drawn = draw_appearance(rng, reflections=0.4 if cluttered else 0.0)
    bright = frozenset(c.name for c in model_base.classes if c.bright)
    look = replace(appearance or drawn, bright_classes=bright)
    if clutter is None:
        clutter = draw_clutter(model, rng) if cluttered else ()
    return Scene(model, place, look, tuple(clutter))


def rendered_rig(
    scene: Scene,
    *,
    distances_mm: Sequence[float] | None = None,
    zooms: Sequence[float] = (0.0, 1.0),
    offers: Lattice | Sequence[RigPose] | None = None,
    internals: InternalsPolicy | None = None,
    seed: int = 0,
    size: tuple[int, int] = DEFAULT_SIZE,
    sensor: Sensor | None = None,
    mount: Mount | None = None,
) -> RenderedRig:
    """A rig around a scene. Without ``offers`` it has the stations of ``viewing_poses`` at the stand-offs given.

    The stand-off is eight times the typical height of a part if none is given.
    """
    distances = distances_mm or (8.0 * scene.typical_mm,)
    poses = viewing_poses(scene.object_model, scene.object_in_rig, distances, zooms=zooms, mount=mount)
    if offers is None:
        offers = poses
    around = poses if isinstance(offers, Lattice) else [*poses, *offers]
    return RenderedRig(
        scene,
        limits_around(around),
        offers,
        start=poses[0] if isinstance(offers, Lattice) else None,
        internals=internals,
        seed=seed,
        size=size,
        sensor=sensor,
        mount=mount,
    )


def simulate(rig: RenderedRig, poses: Iterable[RigPose], dst: Path, *, quality: int | None = None) -> Path:
    """Take a picture at each pose and write an image grid, with ``truth.jsonl`` beside it.

    Args:
        rig: renders the pictures; knows the truth.
        poses: which the rig offers.
        dst: a folder that does not hold a grid yet; made if need be.
        quality: of JPEG pictures, 1..100; ``None``: PNG.

    Returns:
        ``dst``.

    Raises:
        InputError: there is a grid in ``dst`` already.
        RigError: a picture could not be written.
    """
    info = GridInfo(
        provenance="rendered by rig simulate; truth.jsonl tells of what and from where",
        image_size=rig.size,
        internals="fixed_by_zoom" if rig.internals_fixed_by_zoom else "change_every_view",
    )
    suffix = "png" if quality is None else "jpg"
    with GridWriter(dst, info) as writer:
        for number, pose in enumerate(poses, start=1):
            rig.move_to(pose)
            file = f"images/{number:05d}.{suffix}"
            writer.add(rig.capture(), file, quality=quality, truth=truth_record(rig, file, pose))
    return dst


def truth_record(rig: RenderedRig, file: str, pose: RigPose) -> dict[str, Any]:
    """One line of ``truth.jsonl``: the camera in the object frame, its internals, and where the parts are.

    The keys are those of the surveyed grids, so one scorer reads both.
    """
    truth = rig.truth(pose)
    return {
        "file": file,
        "object": rig.scene.object_model.id,
        "camera_in_object": {axis: round(value, 6) for axis, value in asdict(truth.camera_in_object).items()},
        **{name: round(value, 6) for name, value in asdict(truth.internals).items()},
        "zoom": pose.zoom,
        "parts": [_part_record(part) for part in rig.parts(pose)],
    }


def _part_record(part: PartTruth) -> dict[str, Any]:
    return {
        "id": part.id,
        "cls": part.part_class,
        "state": "visible" if part.visible_fraction >= FRACTION_SHOWN else "partly_visible",
        "fully_in_frame": part.fully_in_frame,
        "visible_fraction": round(part.visible_fraction, 4),
        "cos_incidence": round(part.cos_incidence, 4),
        "size_px": round(part.size_px, 2),
        "corners_px": [[round(float(u), 3), round(float(v), 3)] for u, v in part.corners_px],
    }


def _object(model_base: ModelBase, object_id: str) -> ObjectModel:
    try:
        return model_base.object(object_id)
    except KeyError:
        names = ", ".join(candidate.id for candidate in model_base.objects)
        raise InputError(f"no object {object_id!r} in {model_base.name}", remedy=f"Choose one of: {names}") from None
