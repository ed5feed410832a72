"""Which parts each configuration expects at given camera poses, and their poses there: what the paper compares.

Shape legend: K camera poses, H hypotheses, n expected parts (of all camera poses and hypotheses together).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from recognition.geometry import Mount, camera_in_rig, rotation_y
from recognition.hypotheses import Hypotheses
from recognition.layout import Layout
from recognition.seen import Seen
from recognition.tracking import World, guess_internals
from recognition.visibility import Pairs, bounding_box, parts_in_view
from rig.hal import RigPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

GATE_DEG, GATE_MM = 5.0, 20.0
"""Gates of the paper's 0/1 likelihood (eq. 6): rotation, and each coordinate of the translation."""


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected parts, those of one hypothesis at one camera pose together, nearest to the image centre first.

    Attributes:
        camera: ``(n,)`` index of the camera pose; hypothesis: ``(n,)``; part: ``(n,)`` index into the layout.
        pose: ``(n, 4)`` the part in the camera, theta (degrees), x, y, z (mm): the paper's <theta, tx, ty, tz>.
        corners_px: ``(n, C, 2)``.
        away_px: ``(n,)`` from the image centre.
        first: ``(K, H)`` row of the most central part, -1 for none.
    """

    camera: IntArray
    hypothesis: IntArray
    part: IntArray
    pose: FloatArray
    corners_px: FloatArray = field(repr=False)
    away_px: FloatArray = field(repr=False)
    first: IntArray


def cameras_at(
    world: World,
    hypotheses: Hypotheses,
    views: list[Seen],
    poses: Sequence[RigPose],
    groups: Sequence[int | None],
    mount: Mount,
) -> tuple[FloatArray, FloatArray]:
    """Cameras ``(K, 4)`` at rig poses, and the internals ``(K, H, 4)`` that each hypothesis reckons with there.

    ``groups``: the internals group of each pose, ``None`` for one that has not been seen.
    """
    in_rig = [camera_in_rig(pose, mount) for pose in poses]
    cameras = np.array([[np.radians(camera.theta_deg), *camera.centre_mm] for camera in in_rig])
    internals = [guess_internals(world, hypotheses, views, g, p.zoom) for g, p in zip(groups, poses, strict=True)]
    return cameras, np.array(internals)


def in_view_of_all(
    world: World,
    hypotheses: Hypotheses,
    cameras: FloatArray,
    internals: FloatArray,
    image_size: tuple[int, int],
    *,
    least_px: float = 14.0,
) -> Pairs:
    """Parts that each hypothesis expects wholly in view of each camera; ``hypothesis`` counts H to each camera.

    ``least_px``: parts smaller than this are left out.
    """
    k, h = len(cameras), len(hypotheses)
    return parts_in_view(
        world.layout,
        world.walls,
        np.tile(hypotheses.object_of, k),
        np.tile(hypotheses.placement, (k, 1)),
        np.repeat(cameras, h, axis=0),
        internals.reshape(k * h, 4),
        image_size,
        margin_px=4.0,
        least_px=least_px,
    )


def expect(
    world: World, hypotheses: Hypotheses, cameras: FloatArray, internals: FloatArray, image_size: tuple[int, int]
) -> Expected:
    """Parts wholly in view of cameras ``(K, 4)`` (theta in radians, centre in the rig frame), internals ``(K, H, 4)``.

    They follow from the model base's links: the part taken in the last view fixes where all others of its object stand.
    """
    k, h = len(cameras), len(hypotheses)
    pairs = in_view_of_all(world, hypotheses, cameras, internals, image_size)
    low, high = bounding_box(pairs.corners_px)
    away = np.linalg.norm((low + high - np.array(image_size) + 1) / 2, axis=1)
    order = np.lexsort((away, pairs.hypothesis))
    owner = pairs.hypothesis[order]
    first = np.full(k * h, -1)
    rows, index = np.unique(owner, return_index=True)
    first[rows] = index
    camera, hypothesis = np.divmod(owner, max(h, 1))
    part = pairs.part[order]
    pose = part_in_camera(world.layout, part, hypotheses.placement[hypothesis], cameras[camera])
    return Expected(camera, hypothesis, part, pose, pairs.corners_px[order], away[order], first.reshape(k, h))


def part_in_camera(layout: Layout, part: IntArray, placement: FloatArray, camera: FloatArray) -> FloatArray:
    """``(n, 4)`` theta (degrees), x, y, z (mm) of parts ``(n,)`` in cameras ``(n, 4)``, of placements ``(n, 4)``."""
    in_rig = np.einsum("nij,nj->ni", rotation_y(placement[:, 0]), layout.centre_mm[part]) + placement[:, 1:]
    in_camera = np.einsum("nij,nj->ni", rotation_y(camera[:, 0]), in_rig - camera[:, 1:])
    theta = np.degrees(camera[:, 0] + placement[:, 0] + wall_angle(layout, part))
    return np.concatenate([((theta + 180.0) % 360.0 - 180.0)[:, None], in_camera], axis=1)


def wall_angle(layout: Layout, part: IntArray) -> FloatArray:
    """``(n,)`` radians: p_object = Ry(angle) p_part + centre; a part has X along its wall, Y down, Z into it."""
    along = layout.along[part]
    return np.asarray(np.arctan2(-along[:, 2], along[:, 0]))


def within_gates(a: FloatArray, b: FloatArray) -> BoolArray:
    """Whether two part poses ``(..., 4)`` (degrees, mm) agree within the paper's gates (eq. 6)."""
    turn = np.abs((a[..., 0] - b[..., 0] + 180.0) % 360.0 - 180.0)
    shift = np.abs(a[..., 1:] - b[..., 1:])
    return np.asarray((turn <= GATE_DEG) & (shift <= GATE_MM).all(axis=-1))
