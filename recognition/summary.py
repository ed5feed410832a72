"""What a belief says to a person: when to stop, what is left, where the camera is, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.geometry import CameraPose, Pose4, camera_in_object, rotation_y, wrap_deg
from recognition.hypotheses import Hypotheses
from recognition.seen import Seen
from recognition.settings import BenchBounds, RecogniserSettings
from recognition.steps import Answer, BeliefSummary, HypothesisSummary, Outcome, PartMatch
from recognition.tracking import World, expected_internals, expected_parts
from recognition.visibility import camera_in_objects, parts_in_view
from rig.hal import Frame, RigPose

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEADERS = 5
MOST_CANDIDATES = 20
"""Named in an answer; how many are left it tells by number."""
LEAST_PARTS = 5
"""Fewer parts, over all views, are no recognition: their placement and the lens alone could explain them."""
_UNSURE_SHARE = 0.05
"""A direction whose sd exceeds this share of the distance to the parts is called unobservable."""
_ROUNDING = 1e-12
"""Probabilities that sum to 1 but for rounding reach a threshold of 1."""
_SEEN_VIEWS = 6
"""So many views must have shown something before a run may say that it is none of the objects: in two or three, windows
cut by the frame may be all that is in sight."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a run may end and why; ``wanted``: of a place that is settled, in what its pose is less sure than asked."""

    outcome: Outcome
    why: str
    wanted: str = ""

    def without(self, reason: str) -> Verdict:
        """The verdict of a run that ends without what is wanted; ``reason`` says why it goes on no longer."""
        return replace(self, why=f"{self.why}, but {self.wanted}, and {reason}")


def places(world: World, belief: Belief, views: list[Seen]) -> IntArray:
    """``(H,)`` the part nearest to the image centre of the last view under each hypothesis, -1 for none: its place."""
    hypotheses = belief.hypotheses
    place = np.full(len(hypotheses), -1)
    if len(hypotheses) == 0:
        return place
    seen = views[-1]
    internals = expected_internals(world, hypotheses, views, len(views) - 1)
    pairs = parts_in_view(
        world.layout,
        world.walls,
        hypotheses.object_of,
        hypotheses.placement,
        seen.camera_row,
        internals,
        seen.image_size,
        margin_px=-0.5 * seen.image_size[0],
        least_px=2.0,
    )
    away = np.linalg.norm(pairs.corners_px.mean(axis=1) - np.array(seen.image_size) / 2, axis=1)
    order = np.lexsort((away, pairs.hypothesis))
    first = np.unique(pairs.hypothesis[order], return_index=True)[1]
    place[pairs.hypothesis[order][first]] = pairs.part[order][first]
    return place


def leading_group(world: World, belief: Belief, views: list[Seen]) -> npt.NDArray[np.bool_]:
    """``(H,)`` hypotheses that say what the leading one says: same object, and the camera at nearly the same pose.

    One that takes most detections for other parts is another place, be it ever so near: the next storey, the next
    column. Where depth is open, hypotheses that match the same parts in every view may still stand apart along it: they
    are one place, and how far they stand apart is an unsure pose, not another place.
    """
    hypotheses = belief.hypotheses
    pan, centre = camera_in_objects(hypotheses.placement, views[-1].camera_row)
    distance = _distance_to_parts(world, belief, views)
    turn = np.abs(np.remainder(pan - pan[0] + np.pi, 2 * np.pi) - np.pi)
    near = np.linalg.norm(centre - centre[0], axis=1) < 0.12 * distance
    parts = [np.sort(found.part, axis=1) for found in hypotheses.matches]
    alike = np.all([(part == part[0]).all(axis=1) for part in parts], axis=0)
    group = (hypotheses.object_of == hypotheses.object_of[0]) & (near | alike) & (turn < np.radians(4.0))
    rows = np.flatnonzero(group)
    group[rows] = _agrees(hypotheses.take(rows))
    return np.asarray(group)


def _agrees(hypotheses: Hypotheses) -> npt.NDArray[np.bool_]:
    """``(H,)`` whether of the detections that both match each takes most for the same part as the first one does."""
    same, other = np.zeros(len(hypotheses)), np.zeros(len(hypotheses))
    for found in hypotheses.matches:
        mine = np.flatnonzero(found.part[0] >= 0)
        # Corners are copied from the detection, so those of one detection are equal to the last bit.
        at = found.corners_px[:, :, 0, :]
        both = (at[:, :, None] == at[:1, mine][:, None]).all(axis=3) & (found.part >= 0)[:, :, None]
        agrees = found.part[:, :, None] == found.part[0, mine]
        same += (both & agrees).sum(axis=(1, 2))
        other += (both & ~agrees).sum(axis=(1, 2))
    return np.asarray(same >= other)


def _distance_to_parts(world: World, belief: Belief, views: list[Seen]) -> float:
    """Median distance, mm, from the camera to the parts that the leading hypothesis matched last."""
    hypotheses = belief.hypotheses
    for k in range(len(views) - 1, -1, -1):
        part = hypotheses.matches[k].part[0]
        if (part >= 0).any():
            _, centre = camera_in_objects(hypotheses.placement[:1], views[k].camera_row)
            gap = world.layout.centre_mm[part[part >= 0]] - centre
            return float(np.median(np.linalg.norm(gap, axis=1)))
    return float(world.layout.extent_mm[hypotheses.object_of[0]])


def pose_of(placement: FloatArray, seen: Seen) -> CameraPose:
    """The camera in the object frame."""
    return camera_in_object(seen.camera, Pose4.of(np.degrees(placement[0]), placement[1:]))


_NO_BOUNDS = BenchBounds()


def pose_sd(
    belief: Belief, views: list[Seen], group: npt.NDArray[np.bool_], bounds: BenchBounds = _NO_BOUNDS
) -> dict[str, float]:
    """Sd of the camera's pose in the object frame at the last view.

    That of the leading fit's covariance, the spread of its companions, and how far the rig's poses may be trusted: the
    object is placed by all views, so the last one's own motion error, less its share in that placement, is an error of
    the camera. With a single view there is none, as its motion error moves camera and object alike.
    """
    hypotheses = belief.hypotheses
    phi, shift = hypotheses.placement[0, 0], hypotheses.placement[0, 1:]
    away = views[-1].camera.centre_mm - shift
    # centre = Ry(-phi) (c - d)
    back = rotation_y(-phi)
    slope = (rotation_y(-phi + 1e-6) - rotation_y(-phi - 1e-6)) / -2e-6
    jacobian = np.zeros((4, 4))
    jacobian[0, 0] = np.degrees(1.0)
    jacobian[1:, 0] = slope @ away
    jacobian[1:, 1:] = -back
    covariance = jacobian @ hypotheses.covariance[0] @ jacobian.T
    rows = np.flatnonzero(group)
    weight = belief.probability[rows] / max(belief.probability[rows].sum(), 1e-300)
    pan, centre = camera_in_objects(hypotheses.placement[rows], views[-1].camera_row)
    turn = np.degrees(np.remainder(pan - pan[0] + np.pi, 2 * np.pi) - np.pi)
    spread = np.concatenate([turn[:, None], centre - centre[0]], axis=1)
    motion = np.array([bounds.motion_sd_deg, *[bounds.motion_sd_mm] * 3])
    variance = np.diag(covariance) + weight @ spread**2 + (1.0 - 1.0 / len(views)) * motion**2
    sd = np.sqrt(np.maximum(variance, 0.0))
    return dict(zip(("theta_deg", "x_mm", "y_mm", "z_mm"), (float(v) for v in sd), strict=True))


def judge(world: World, belief: Belief, views: list[Seen], settings: RecogniserSettings) -> Verdict | None:
    """Whether the run may end; where its ``wanted`` says something, only if no view can bring that."""
    # A view without any detection shows a bare wall or nothing at all; it says little of which object stands there.
    if belief.none >= settings.threshold and sum(seen.count > 0 for seen in views) >= _SEEN_VIEWS:
        return Verdict(Outcome.UNKNOWN, f"none of the objects explains the views (probability {belief.none:.3f})")
    if len(belief.hypotheses):
        group = leading_group(world, belief, views)
        mass = float(belief.probability[group].sum())
        if mass >= settings.threshold - _ROUNDING and _parts_matched(belief) >= LEAST_PARTS:
            why = f"one configuration holds {mass:.4f} of the probability"
            return Verdict(Outcome.RECOGNISED, why, wanted_of_pose(world, belief, views, settings))
    if len(views) >= settings.max_views:
        many = belief.probability.sum() > 0.5
        return Verdict(
            Outcome.AMBIGUOUS if many else Outcome.NOT_FOUND,
            f"{views_taken(len(views))}, and no configuration reached {settings.threshold:g}",
        )
    return None


def _parts_matched(belief: Belief) -> int:
    """Matches of the leading hypothesis in all views together."""
    return sum(int((found.part[0] >= 0).sum()) for found in belief.hypotheses.matches)


def wanted_of_pose(world: World, belief: Belief, views: list[Seen], settings: RecogniserSettings) -> str:
    """In what the leading pose is less sure than asked, for people; empty if in nothing.

    Where nothing is asked, its position is wanted to a share of the distance to the parts, to mean a place at all.
    """
    sd = pose_sd(belief, views, leading_group(world, belief, views), world.bounds)
    place = max(sd[k] for k in ("x_mm", "y_mm", "z_mm"))
    asked = settings.pose_sd_mm
    most = asked if asked is not None else _UNSURE_SHARE * _distance_to_parts(world, belief, views)
    if not place <= most:
        return f"its position is unsure by {place:.3g} mm, {most:.3g} is asked"
    if settings.pose_sd_deg is not None and sd["theta_deg"] > settings.pose_sd_deg:
        return f"its pan is unsure by {sd['theta_deg']:.2f} degrees, {settings.pose_sd_deg:g} is asked"
    return ""


def summarise(world: World, belief: Belief, views: list[Seen], frame: Frame) -> BeliefSummary:
    """The belief as shown to a person."""
    objects = world.layout.base.objects
    posterior = {thing.id: float(p) for thing, p in zip(objects, belief.by_object(len(objects)), strict=True)}
    posterior["unknown"] = belief.none
    place = places(world, belief, views)
    mass = _mass_by_place(belief, place)
    p = np.append(mass, belief.none)
    p = p[p > 1e-300]
    leaders = tuple(
        _leader(world, belief, views, row, int(place[row])) for row in range(min(LEADERS, len(belief.hypotheses)))
    )
    return BeliefSummary(posterior, _left(mass), max(0.0, float(-(p * np.log2(p)).sum())), leaders)


def views_taken(count: int) -> str:
    """How many views were taken, in words."""
    return "1 view was taken" if count == 1 else f"{count} views were taken"


def _mass_by_place(belief: Belief, place: IntArray) -> FloatArray:
    """Probability of each place that some hypothesis names, largest first."""
    _, group = np.unique(belief.hypotheses.object_of * 1_000_000 + place, return_inverse=True)
    mass = np.bincount(group, weights=belief.probability) if len(place) else np.empty(0)
    return np.asarray(np.sort(mass)[::-1])


def _left(mass: FloatArray) -> int:
    """How many places together hold 99.9 % of the probability of all."""
    total = mass.sum()
    return min(int(np.searchsorted(np.cumsum(mass), 0.999 * total) + 1), len(mass)) if total > 0 else 0


def _leader(world: World, belief: Belief, views: list[Seen], row: int, place: int) -> HypothesisSummary:
    hypotheses = belief.hypotheses.take(np.array([row]))
    seen = views[-1]
    internals = expected_internals(world, hypotheses, views, len(views) - 1)
    pairs = expected_parts(world, hypotheses, views, len(views) - 1, internals)
    taken = {
        int(p): c
        for p, c in zip(hypotheses.matches[-1].part[0], hypotheses.matches[-1].corners_px[0], strict=True)
        if p >= 0
    }
    matches = []
    for part, corners in zip(pairs.part, pairs.corners_px, strict=True):
        count = int(world.layout.corner_count[part])
        detection = _detection_of(taken.get(int(part)), seen)
        if detection is None and not ((corners >= 0.0) & (corners <= np.array(seen.image_size) - 1.0)).all():
            continue  # it may show at the border, but is not expected to
        matches.append(PartMatch(world.layout.part_ids[part], corners[:count], detection))
    return HypothesisSummary(
        world.layout.base.objects[int(hypotheses.object_of[0])].id,
        world.layout.part_ids[place] if place >= 0 else "nowhere in view",
        float(belief.probability[row]),
        pose_of(hypotheses.placement[0], seen),
        tuple(matches),
    )


def _detection_of(corners: FloatArray | None, seen: Seen) -> int | None:
    if corners is None or seen.count == 0:
        return None
    gap = np.abs(seen.corners_px - corners).max(axis=(1, 2))
    best = int(gap.argmin())
    return int(seen.source[best]) if gap[best] < 1e-6 else None


def answer(world: World, belief: Belief, views: list[Seen], verdict: Verdict, path: Sequence[RigPose]) -> Answer:
    """The end of a run as a value."""
    objects = world.layout.base.objects
    posterior = {thing.id: float(p) for thing, p in zip(objects, belief.by_object(len(objects)), strict=True)}
    posterior["unknown"] = belief.none
    travel = sum(float(np.linalg.norm([b.x_mm - a.x_mm, b.y_mm - a.y_mm, b.z_mm - a.z_mm])) for a, b in pairwise(path))
    turned = sum(abs(wrap_deg(b.theta_deg - a.theta_deg)) for a, b in pairwise(path))
    recognised = verdict.outcome is Outcome.RECOGNISED
    open_question = verdict.outcome not in (Outcome.RECOGNISED, Outcome.UNKNOWN)
    left = _left(_mass_by_place(belief, places(world, belief, views)))
    pose: CameraPose | None = None
    sd: dict[str, float] = {}
    unobservable: tuple[str, ...] = ()
    if recognised:
        group = leading_group(world, belief, views)
        pose = pose_of(belief.hypotheses.placement[0], views[-1])
        sd = pose_sd(belief, views, group, world.bounds)
        limit = _UNSURE_SHARE * _distance_to_parts(world, belief, views)
        names = {"theta_deg": np.degrees(_UNSURE_SHARE), "x_mm": limit, "y_mm": limit, "z_mm": limit}
        unobservable = tuple(name for name, most in names.items() if sd[name] > most)
    return Answer(
        outcome=verdict.outcome,
        object_id=objects[int(belief.hypotheses.object_of[0])].id if recognised else None,
        candidates=_candidates(world, belief, views, min(left, MOST_CANDIDATES)) if open_question else (),
        posterior=posterior,
        pose=pose,
        pose_sd=sd,
        unobservable=unobservable,
        why=verdict.why,
        travel_mm=travel,
        rotation_deg=turned,
        pose_sure=not verdict.wanted if recognised else None,
        left=left,
    )


def _candidates(world: World, belief: Belief, views: list[Seen], most: int) -> tuple[str, ...]:
    place = places(world, belief, views)
    seen: dict[str, float] = {}
    for row in range(min(len(place), 400)):
        name = world.layout.part_ids[place[row]] if place[row] >= 0 else "a place out of view"
        key = f"{world.layout.base.objects[int(belief.hypotheses.object_of[row])].id} at {name}"
        seen[key] = seen.get(key, 0.0) + float(belief.probability[row])
    ranked = sorted(seen.items(), key=lambda item: -item[1])
    return tuple(key for key, p in ranked[:most] if p > 0.0)
