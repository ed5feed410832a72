"""The mount from tracks and known moves: the best fit, how sure it is, and what the scan leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.alignment.bundle import (
    ARM_X,
    ARM_Z,
    LOG_ASPECT,
    LOG_F,
    PAN,
    PITCH,
    RADIAL,
    ROLL,
    U0,
    V0,
    C,
    Linear,
    Priors,
    Reduced,
    Unknowns,
    adjust,
    keep,
    linearise,
    pull,
    reduce,
)
from recognition.alignment.moves import Moves
from recognition.alignment.start import FAR_PX, Guess, guesses, triangulate
from recognition.alignment.tracks import Tracks
from recognition.geometry import wrap_deg
from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]

MOTION_SD_MM, MOTION_SD_DEG = 0.02, 0.01
"""How far moves may be trusted where nobody says: no gantry goes closer than its steps. The fit needs some such doubt:
features err alike in all of a view, by a tenth of a pixel or so, and with exact moves the sds would be too small."""

MOUNT = ("x_mm", "z_mm", "pan_zero_deg", "roll_deg", "pitch_deg")
_WHERE = np.array([ARM_X, ARM_Z, PAN, ROLL, PITCH])
_NAMES = {
    LOG_F: "focal length",
    LOG_ASPECT: "fy/fx",
    U0: "principal point u0",
    V0: "principal point v0",
    RADIAL: "radial term",
    **dict(zip(_WHERE.tolist(), MOUNT, strict=True)),
}

_LEAST_VIEWS, _LEAST_POINTS = 3, 20
_START_POINTS, _MOST_POINTS = 200, 1000
_GUESSES = 6
_START_SIGMA_PX, _TAIL_SD, _CUT_SD = 1.0, 3.0, 4.5
_MOTION_ROUNDS, _SETTLED = 12, 1.03
_OPEN = 0.2  # of the prior's sd: what stays less sure than this is as good as not seen
_SEEN_PX = 10.0  # an observation further off than this was never of that point
_LEAST_EXPLAINED = 0.5
_ODD_ASPECT = 0.05
_ASK = (
    "Is an axis or the pan counted with the wrong sign or in other units, did zoom, focus or the target change during "
    "the scan, or were the pictures cropped or registered afterwards?"
)


@dataclass(frozen=True, slots=True)
class MotionSd:
    """How far moves are off what is told: standard deviations per linear axis, and of the pan."""

    mm: float
    deg: float


@dataclass(frozen=True, slots=True)
class MountEstimate:
    """How the camera hangs.

    Attributes:
        values: x_mm and z_mm of the lever arm, pan_zero_deg, roll_deg, pitch_deg; as `recognition.geometry.Mount`.
            Of y_mm nothing can be said: it moves all that is seen up or down alike.
        covariance: ``(5, 5)`` of these, mm and degrees, marginal over internals, target and errors of the moves.
        open: names of the values that the scan does not determine, and what each trades against, if anything.
        residual_px: standard deviation of one pixel coordinate about the fit.
        points, observations: of the target, that the fit rests on; explained: share of all observations that it keeps.
        moves: of the scan.
        told, off: how far the moves were trusted, and how far they were off; no less than what was told.
    """

    values: Mapping[str, float]
    covariance: FloatArray = field(repr=False)
    open: Mapping[str, tuple[str, ...]]
    residual_px: float
    points: int
    observations: int
    explained: float
    moves: Moves = field(repr=False)
    told: MotionSd
    off: MotionSd

    @property
    def sd(self) -> Mapping[str, float]:
        """Standard deviations, by the names of the values."""
        return dict(zip(MOUNT, (float(v) for v in np.sqrt(np.diag(self.covariance))), strict=True))


def estimate_mount(
    tracks: Tracks,
    moves: Moves,
    image_size: tuple[int, int],
    *,
    motion_sd_mm: float = MOTION_SD_MM,
    motion_sd_deg: float = MOTION_SD_DEG,
) -> MountEstimate:
    """Estimate how a camera of unknown, unchanging internals hangs on the rig.

    Args:
        tracks: where points of a fixed target were seen.
        moves: where the rig stood, one row a view.
        image_size: width and height, px.
        motion_sd_mm, motion_sd_deg: how far the moves may be trusted, per axis; both 0: exactly. Where the pictures
            show that they are off by more, that is reckoned with instead.

    Raises:
        DegenerateGeometryError: nothing can be estimated at all: no translation, too few views or matches, or moves
            that do not explain the pictures.
    """
    _refuse_hopeless(tracks, moves)
    tracks = _longest(tracks, _MOST_POINTS)
    start = _start(tracks, moves, image_size)
    near = _near(start, tracks)
    total, explained = len(tracks.pixels), float(near.mean())
    if explained < _LEAST_EXPLAINED:
        raise _unexplained(explained)
    tracks, left = tracks.take(near)
    unknowns = Unknowns(start.common, np.zeros_like(moves.table), start.points[left])
    depth = float(np.median(linearise(unknowns, tracks, moves).depth))
    priors = _priors(start.common, image_size, unknowns.points, depth, (motion_sd_mm, motion_sd_deg))
    tracks, unknowns, priors, linear, sigma = _refined(tracks, unknowns, moves, priors)
    # Derivatives at the moves as told: what the rig did by chance does not count as a move.
    told = linearise(replace(unknowns, motion=np.zeros_like(unknowns.motion)), tracks, moves)
    whitened = _whitened(reduce(told, pull(linear, sigma, _TAIL_SD), unknowns, tracks, priors))[:C, :C]
    _refuse_strange(unknowns.common, whitened, priors)
    unit = np.array([1.0, 1.0, *np.degrees(np.ones(3))])
    scale = priors.sd[_WHERE] * unit
    values = unknowns.common[_WHERE] * unit
    values[2] = wrap_deg(values[2])
    return MountEstimate(
        values=dict(zip(MOUNT, (float(v) for v in values), strict=True)),
        covariance=whitened[np.ix_(_WHERE, _WHERE)] * np.outer(scale, scale),
        open=_left_open(whitened),
        residual_px=sigma,
        points=tracks.count,
        observations=len(tracks.pixels),
        explained=len(tracks.pixels) / total,
        moves=moves,
        told=MotionSd(motion_sd_mm, motion_sd_deg),
        off=MotionSd(float(priors.motion_sd[1]), float(np.degrees(priors.motion_sd[0]))),
    )


def _whitened(reduced: Reduced) -> FloatArray:
    """``(S, S)`` covariance of the shared unknowns in units of their priors' sd."""
    return np.asarray(np.linalg.inv(reduced.information), dtype=np.float64)


def _refuse_hopeless(tracks: Tracks, moves: Moves) -> None:
    if len(moves.table) < _LEAST_VIEWS:
        raise DegenerateGeometryError(
            f"{len(moves.table)} views are too few to align from. Scan at least three places and pans, better thirty"
        )
    if not any(moves.moved):
        raise DegenerateGeometryError(
            "the scan never moves in x, y or z, so nothing tells millimetres: lever arm and pan zero cannot be seen. "
            "Scan a lattice of several x, y and z at several pans"
        )
    if tracks.count < _LEAST_POINTS:
        raise DegenerateGeometryError(
            f"only {tracks.count} points of the target were found in three views or more, {_LEAST_POINTS} are needed. "
            "Use a target with more texture (a newspaper page, a brick wall), sharper pictures, or smaller steps"
        )


def _unexplained(share: float) -> DegenerateGeometryError:
    return DegenerateGeometryError(
        f"the moves do not explain the pictures: at best {share:.0%} of what was matched lies in front of a camera "
        f"that moves as told and keeps its internals. {_ASK} Or are the moves very small beside the distance?"
    )


def _refuse_strange(common: FloatArray, whitened: FloatArray, priors: Priors) -> None:
    aspect, sd = float(common[LOG_ASPECT]), float(np.sqrt(whitened[LOG_ASPECT, LOG_ASPECT])) * priors.sd[LOG_ASPECT]
    if abs(aspect) > max(_ODD_ASPECT, 3.0 * sd):
        raise DegenerateGeometryError(
            f"the moves explain the pictures only if pixels are {np.exp(-aspect):.2f} times as high as wide, which "
            f"those of no camera are. {_ASK}"
        )


def _longest(tracks: Tracks, most: int) -> Tracks:
    """The tracks of the points that were seen most often."""
    times = np.bincount(tracks.point)
    chosen = np.zeros(len(times), dtype=bool)
    chosen[np.argsort(-times, kind="stable")[:most]] = True
    return tracks.take(chosen[tracks.point])[0]


def _start(tracks: Tracks, moves: Moves, size: tuple[int, int]) -> Guess:
    """The best of several guesses after a rough fit to some of the points, with all points triangulated."""
    few = _longest(tracks, _START_POINTS)
    polished = []
    for guess in guesses(few, moves, size, _GUESSES):
        part, left = few.take(_near(guess, few, FAR_PX - 1.0))
        if part.count < _LEAST_POINTS // 2:
            polished.append(guess)
            continue
        unknowns = Unknowns(guess.common, np.zeros_like(moves.table), guess.points[left])
        depth = float(np.median(linearise(unknowns, part, moves).depth))
        priors = _priors(guess.common, size, unknowns.points, depth, (0.0, 0.0))
        fitted, _, _ = adjust(unknowns, part, moves, priors, sigma_px=_START_SIGMA_PX, tail_sd=_TAIL_SD, iterations=20)
        polished.append(min(guess, triangulate(fitted.common, few, moves), key=lambda g: g.score_px))
    best = min(polished, key=lambda g: g.score_px)
    return triangulate(best.common, tracks, moves)


def _near(guess: Guess, tracks: Tracks, limit_px: float = _SEEN_PX) -> npt.NDArray[np.bool_]:
    """``(M,)`` observations that are not far off (or behind the camera), of points most of which are not."""
    near = guess.error_px < limit_px
    share = np.bincount(tracks.point, near, minlength=tracks.count) / np.bincount(tracks.point, minlength=tracks.count)
    return np.asarray(near & (share[tracks.point] > 0.5))


def _priors(
    common: FloatArray, size: tuple[int, int], points: FloatArray, depth: float, motion: tuple[float, float]
) -> Priors:
    """What holds of any camera and any mount. It keeps the fit in bounds, and is no match for a scan that sees."""
    width, height = size
    mean, sd = np.zeros(C), np.zeros(C)
    mean[[LOG_F, U0, V0, PAN]] = common[LOG_F], (width - 1) / 2, (height - 1) / 2, common[PAN]
    sd[LOG_F], sd[LOG_ASPECT], sd[RADIAL] = 1.0, 0.1, 0.3
    sd[[U0, V0]] = 0.25 * width
    sd[[ARM_X, ARM_Z]] = 0.5 * depth
    sd[[PAN, ROLL, PITCH]] = np.radians([15.0, 5.0, 5.0])
    mm, deg = motion
    # An axis that is exact beside one that is not is nearly so: its deviations are counted in its sd.
    motion_sd = np.maximum([np.radians(deg), mm, mm, mm], 1e-9) if mm or deg else np.zeros(4)
    return Priors(mean, sd, motion_sd, points, 10.0 * depth)


def _refined(
    tracks: Tracks, unknowns: Unknowns, moves: Moves, priors: Priors
) -> tuple[Tracks, Unknowns, Priors, Linear, float]:
    """The fit to all points: noise of pixels and moves re-estimated, and without what is far off from then on."""
    sigma = _START_SIGMA_PX
    for last in (False, True):
        unknowns, linear, _ = adjust(unknowns, tracks, moves, priors, sigma_px=sigma, tail_sd=_TAIL_SD, iterations=60)
        away = np.linalg.norm(linear.residuals, axis=1)
        sigma = _noise(away, tracks)
        if not last:
            tracks, left = tracks.take(away < _CUT_SD * sigma)
            unknowns, priors = keep(unknowns, priors, left)
    told = priors.motion_sd
    for _ in range(0 if priors.exact_moves else _MOTION_ROUNDS):
        reduced = reduce(linear, pull(linear, sigma, _TAIL_SD), unknowns, tracks, priors)
        before = priors.motion_sd
        priors = replace(priors, motion_sd=np.maximum(told, _spread(unknowns.motion, _whitened(reduced), priors)))
        unknowns, linear, _ = adjust(unknowns, tracks, moves, priors, sigma_px=sigma, tail_sd=_TAIL_SD, iterations=20)
        sigma = _noise(np.linalg.norm(linear.residuals, axis=1), tracks)
        if np.all(priors.motion_sd < _SETTLED * before):
            break
    return tracks, unknowns, priors, linear, sigma


def _spread(motion: FloatArray, whitened: FloatArray, priors: Priors) -> FloatArray:
    """``(4,)`` sd of the moves' errors, one for the pan and one for the three axes (a step of EM)."""
    square = (motion**2).mean(axis=0) + np.diag(whitened)[C:].reshape(-1, 4).mean(axis=0) * priors.motion_sd**2
    return np.sqrt([square[0], *[square[1:].mean()] * 3])


def _noise(away: FloatArray, tracks: Tracks) -> float:
    """Standard deviation of one coordinate, from the median distance: sigma sqrt(2 ln 2) where nothing was fitted."""
    freedom = 1.0 - (3 * tracks.count + C) / (2.0 * len(away))
    return float(max(np.median(away) / np.sqrt(2.0 * np.log(2.0)) / np.sqrt(max(freedom, 0.1)), 1e-3))


def _left_open(whitened: FloatArray) -> dict[str, tuple[str, ...]]:
    """Mount values whose sd is no small part of the prior's, and the unknowns that each trades against."""
    sd = np.sqrt(np.diag(whitened))
    correlation = whitened / np.outer(sd, sd)
    found = {}
    for row, name in zip(_WHERE, MOUNT, strict=True):
        if sd[row] > _OPEN:
            partners = [k for k in np.argsort(-np.abs(correlation[row])) if k != row and abs(correlation[row, k]) > 0.5]
            found[name] = tuple(_NAMES[int(k)] for k in partners[:2])
    return found
