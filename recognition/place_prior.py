"""The prior over places: how likely a first view has each part nearest to its middle, before anything is seen.

By default it goes by area: an object with twice the wall is twice as likely to fill a close-up. Sampled off-line over
views and internals (``rig model prior``) it also knows which places cannot be stood before, or hide behind each other.

Shape legend: P parts, O objects, N sampled views.
"""

from __future__ import annotations

import hashlib
import json
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import numpy.typing as npt

from recognition.layout import Layout, compile_layout
from recognition.modelbase import ModelBase
from recognition.settings import BenchBounds
from recognition.visibility import Walls, parts_in_view, walls_of
from rig.errors import InputError

FloatArray = npt.NDArray[np.float64]

FORMAT, VERSION = "rig-place-prior", 1
_WIDTH_PX, _HEIGHT_PX = 1280, 960
_ASIDE = math.radians(50.0)
_LEAST = 0.5
"""Views that every part is given beside those that were drawn, so that none is impossible."""
_BATCH, _SHARE = 2000, 5000


@dataclass(frozen=True)
class PlacePrior:
    """Log prior ``(P,)`` of the places, which sum to 1."""

    log_weight: FloatArray = field(repr=False)

    @staticmethod
    def of(weight: FloatArray) -> PlacePrior:
        """From weights of any sum."""
        return PlacePrior(np.log(weight / weight.sum()))


def by_area(layout: Layout, walls: Walls) -> PlacePrior:
    """Each object by the area of its walls, its parts alike; by the number of parts where a base has no walls."""
    wall = np.linalg.norm(np.cross(walls.right, walls.down), axis=1)
    objects = len(layout.first) - 1
    area = np.array([wall[walls.first[o] : walls.first[o + 1]].sum() for o in range(objects)])
    parts = np.diff(layout.first)
    if not (area > 0).all():
        area = parts.astype(np.float64)
    return PlacePrior.of((area / np.maximum(parts, 1))[layout.object_of])


def sample_views(layout: Layout, walls: Walls, bounds: BenchBounds, views: int, seed: int | list[int]) -> FloatArray:
    """In how many ``(P,)`` of ``views`` random views each part is nearest to the middle.

    A view looks at a random point of the walls of all objects, from a distance and with an angle of view drawn evenly
    (the angle by its logarithm) from the bench's bounds, up to 50 degrees aside of the wall's normal; views that show
    no whole part are drawn again.

    Raises:
        InputError: hardly any view shows a whole part.
    """
    rng = np.random.default_rng(seed)
    seen = np.zeros(len(layout.part_ids))
    if len(walls.origin) == 0:
        raise InputError("views can be drawn only of objects with faces", remedy="Give the objects of the base faces")
    for _ in range(max(20, 20 * views // _BATCH)):
        wanted = views - int(seen.sum())
        if wanted == 0:
            return seen
        part = _central_parts(layout, walls, *_draw(layout, walls, bounds, rng))[:wanted]
        seen += np.bincount(part, minlength=len(seen))
    raise InputError(
        f"of {20 * views} random views fewer than {views} show a whole part",
        remedy="Give the distances and angles of view that the bench has",
    )


def sample_in_parallel(base: ModelBase, bounds: BenchBounds, views: int, seed: int, jobs: int) -> FloatArray:
    """As ``sample_views``, in processes that draw ``views`` together; the same result for any number of them."""
    shares = [len(share) for share in np.array_split(np.arange(views), max(1, views // _SHARE))]
    work = [(base, bounds, share, [seed, k]) for k, share in enumerate(shares)]
    if jobs == 1:
        return np.asarray(np.sum([_share(one) for one in work], axis=0))
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        return np.asarray(np.sum(list(pool.map(_share, work)), axis=0))


def _share(work: tuple[ModelBase, BenchBounds, int, list[int]]) -> FloatArray:
    base, bounds, views, seed = work
    layout = compile_layout(base)
    return sample_views(layout, walls_of(layout), bounds, views, seed)


def _draw(
    layout: Layout, walls: Walls, bounds: BenchBounds, rng: np.random.Generator
) -> tuple[npt.NDArray[np.int64], FloatArray, FloatArray]:
    """Object ``(N,)``, camera in the object's frame ``(N, 4)`` and internals ``(N, 4)`` of some random views."""
    area = np.linalg.norm(np.cross(walls.right, walls.down), axis=1)
    wall = rng.choice(len(area), size=_BATCH, p=area / area.sum())
    share = rng.uniform(size=(2, _BATCH, 1))
    target = walls.origin[wall] + share[0] * walls.right[wall] + share[1] * walls.down[wall]
    distance = rng.uniform(bounds.distance_min_mm, bounds.distance_max_mm, _BATCH)
    # Looking straight into a wall of normal n, the camera's z axis is -n; it looks along (-sin, 0, cos) of its pan.
    normal = walls.normal[wall]
    pan = np.arctan2(normal[:, 0], -normal[:, 2]) + rng.uniform(-_ASIDE, _ASIDE, _BATCH)
    ahead = np.stack([-np.sin(pan), np.zeros(_BATCH), np.cos(pan)], axis=1)
    eye = target - distance[:, None] * ahead
    angle = np.exp(rng.uniform(math.log(bounds.view_angle_min_deg), math.log(bounds.view_angle_max_deg), _BATCH))
    focal = 0.5 * _WIDTH_PX / np.tan(np.radians(angle) / 2)
    middle = np.full(_BATCH, (_WIDTH_PX - 1) / 2), np.full(_BATCH, (_HEIGHT_PX - 1) / 2)
    thing = np.searchsorted(walls.first, wall, side="right") - 1
    return thing, np.column_stack([pan, eye]), np.column_stack([focal, focal, *middle])


def _central_parts(
    layout: Layout, walls: Walls, thing: npt.NDArray[np.int64], camera: FloatArray, internals: FloatArray
) -> npt.NDArray[np.int64]:
    """The part nearest to the middle of each view that shows any, as ``parts_in_view`` finds them."""
    size = (_WIDTH_PX, _HEIGHT_PX)
    pairs = parts_in_view(layout, walls, thing, np.zeros((len(thing), 4)), camera, internals, size, margin_px=2.0)
    away = np.linalg.norm(pairs.corners_px.mean(axis=1) - internals[pairs.hypothesis, 2:], axis=1)
    order = np.lexsort((away, pairs.hypothesis))
    first = np.unique(pairs.hypothesis[order], return_index=True)[1]
    return np.asarray(pairs.part[order][first])


def write_prior(path: Path, layout: Layout, seen: FloatArray) -> None:
    """Write what was sampled: views by object and part, under the model base's fingerprint."""
    views: dict[str, dict[str, int]] = {}
    for name, thing, count in zip(layout.part_ids, layout.object_of, seen, strict=True):
        views.setdefault(layout.base.objects[int(thing)].id, {})[name] = int(count)
    told = {"format": FORMAT, "version": VERSION, "parts_sha256": fingerprint(layout), "views": views}
    path.write_text(json.dumps(told, indent=1), encoding="utf-8")


def read_prior(path: Path, layout: Layout) -> PlacePrior:
    """Read a prior that was sampled for this model base.

    Raises:
        InputError: it cannot be read, or was sampled for other parts.
    """
    again = "Sample it anew: rig model prior"
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if (told["format"], told["version"]) != (FORMAT, VERSION):
            raise ValueError(f"it is not {FORMAT} {VERSION}")
        mine = told["parts_sha256"] == fingerprint(layout)
        things = [layout.base.objects[int(thing)].id for thing in layout.object_of]
        places = zip(things, layout.part_ids, strict=True) if mine else ()
        seen = [float(told["views"][thing][name]) for thing, name in places]
    except OSError as failure:
        raise InputError(f"cannot be read ({failure.strerror})", where=str(path)) from failure
    except (ValueError, KeyError, TypeError) as failure:
        raise InputError(f"this is no prior over places ({failure!r})", where=str(path), remedy=again) from failure
    if not mine:
        raise InputError("this prior was sampled for another model base", where=str(path), remedy=again)
    weight = np.array(seen)
    if not (np.isfinite(weight).all() and (weight >= 0).all()):
        raise InputError("views cannot be fewer than none", where=str(path), remedy=again)
    return PlacePrior.of(weight + _LEAST)


def fingerprint(layout: Layout) -> str:
    """Of the parts: their objects, names and corners to a thousandth of a millimetre."""
    told = hashlib.sha256("\n".join(layout.part_ids).encode())
    told.update(layout.object_of.astype("<i8").tobytes())
    told.update(np.round(layout.corners_mm * 1000.0).astype("<i8").tobytes())
    return told.hexdigest()
