"""A first guess for the bundle adjustment: focal length and pan zero from a table, the rest linear in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import numpy.typing as npt

from recognition.alignment.bundle import ARM_X, ARM_Z, LOG_F, PAN, PITCH, RADIAL, ROLL, U0, V0, C, focal
from recognition.alignment.moves import Moves
from recognition.alignment.tracks import Tracks
from recognition.geometry import Mount, rotation_y

FloatArray = npt.NDArray[np.float64]

FAR_PX = 50.0
"""What an observation behind the camera, or far off, counts as."""

_FOCAL_WIDTHS = (0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 2.9, 3.8, 5.0)
_PANS_DEG = np.arange(-180.0, 180.0, 10.0)
_FEW = 50  # points are enough to leave the worst guesses out
_ROUNDS, _FAR_OFF_PX = 4, 5.0
_STIFF = 1e-6  # of the information: what nothing determines stays near zero instead of running away


@dataclass(frozen=True, slots=True)
class Guess:
    """Common unknowns, points that go with them, and the error ``(M,)`` of each predicted pixel, at most 50 px."""

    common: FloatArray
    points: FloatArray = field(repr=False)
    error_px: FloatArray = field(repr=False)

    @property
    def score_px(self) -> float:
        """How far off the guess is: the mean error."""
        return float(self.error_px.mean())


def guesses(tracks: Tracks, moves: Moves, size: tuple[int, int], most: int) -> list[Guess]:
    """The most promising guesses, best first: principal point in the middle, square pixels, no roll and no pitch."""
    width, height = size
    few = tracks.take(tracks.point < _FEW)[0]
    found = []
    for widths, pan_deg in product(_FOCAL_WIDTHS, _PANS_DEG):
        common = np.zeros(C)
        common[LOG_F] = np.log(widths * width)
        common[[U0, V0]] = (width - 1) / 2, (height - 1) / 2
        common[PAN] = np.radians(pan_deg)
        found.append(triangulate(common, few, moves, with_arm=True, rounds=2))
    found.sort(key=lambda guess: guess.score_px)
    found = [triangulate(guess.common, tracks, moves, with_arm=True) for guess in found[: 4 * most]]
    found.sort(key=lambda guess: guess.score_px)
    return found[:most]


def triangulate(
    common: FloatArray, tracks: Tracks, moves: Moves, *, with_arm: bool = False, rounds: int = _ROUNDS
) -> Guess:
    """Points, and with them the lever arm where it is asked for, by linear least squares.

    With q = Ry(theta) (P - x) - arm in the turning frame, a pixel says that two rows are across T Ry(pan zero) q, T
    being the tilt: that is linear in P and the arm.
    """
    f = focal(common)
    ray = _straight((tracks.pixels - common[[U0, V0]]) / f, common[RADIAL])
    hung = Mount(roll_deg=np.degrees(common[ROLL]), pitch_deg=np.degrees(common[PITCH])).tilt @ rotation_y(common[PAN])
    one, zero = np.ones(len(ray)), np.zeros(len(ray))
    across = np.stack([np.stack([one, zero, -ray[:, 0]], 1), np.stack([zero, one, -ray[:, 1]], 1)], axis=1) @ hung
    pan, seen_from = rotation_y(moves.table[:, 0])[tracks.view], moves.table[tracks.view, 1:]
    by_point, by_arm = across @ pan, -across[:, :, [0, 2]]
    right = np.einsum("mki,mi->mk", by_point, seen_from)
    first = np.searchsorted(tracks.point, np.arange(tracks.count))
    arm, weight = common[[ARM_X, ARM_Z]], one
    for _ in range(rounds):
        points, arm = _solve(by_point, by_arm, right, weight, first, None if with_arm else arm)
        turned = np.einsum("mij,mj->mi", pan, points[tracks.point] - seen_from) - [arm[0], 0.0, arm[1]]
        cam = turned @ hung.T
        depth = np.maximum(np.abs(cam[:, 2]), 1e-3 * np.median(np.abs(cam[:, 2])) + 1e-9)
        error = np.linalg.norm((cam[:, :2] / depth[:, None] - ray) * f, axis=1)
        # The rows' error is that of the pixel times the depth; and one wrong match must not spoil its whole point.
        weight = 1.0 / (depth * np.hypot(1.0, error / _FAR_OFF_PX))
    common = common.copy()
    common[[ARM_X, ARM_Z]] = arm
    return Guess(common, points, np.where(cam[:, 2] > 0, np.minimum(error, FAR_PX), FAR_PX))


def _straight(bent: FloatArray, k: float) -> FloatArray:
    """Normalised coordinates ``(M, 2)`` without the radial term, near enough to start from."""
    flat = bent
    for _ in range(4):
        flat = bent / np.maximum(1.0 + k * (flat**2).sum(axis=1, keepdims=True), 0.5)
    return flat


def _solve(
    by_point: FloatArray,
    by_arm: FloatArray,
    right: FloatArray,
    weight: FloatArray,
    first: npt.NDArray[np.int64],
    arm: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Points ``(N, 3)`` and arm ``(2,)``, unless given, that least violate ``by_point P + by_arm arm = right``."""
    w = weight[:, None, None] ** 2
    turned = by_point.transpose(0, 2, 1) * w

    def per_point(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, first, axis=0))

    own, mixed, side = (per_point(turned @ by) for by in (by_point, by_arm, right[:, :, None]))
    trace = np.trace(own, axis1=1, axis2=2)[:, None, None]
    solved = np.linalg.solve(own + _STIFF * trace * np.eye(3), np.concatenate([mixed, side], axis=2))
    if arm is None:
        of_arm = np.einsum("mki,mkj->ij", by_arm * w, by_arm)
        information = of_arm - np.einsum("nij,nik->jk", mixed, solved[:, :, :2])
        arm_side = np.einsum("mki,mk->i", by_arm * w, right) - np.einsum("nij,ni->j", mixed, solved[:, :, 2])
        arm = np.linalg.solve(information + _STIFF * np.trace(of_arm) * np.eye(2), arm_side)
    return solved[:, :, 2] - solved[:, :, :2] @ arm, arm
