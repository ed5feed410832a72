"""The paper's belief: interpretations that are possible or not, with area priors, and the pose of one part at a time.

An interpretation is an object and the part of it that the first view shows nearest to its centre. Its likelihood is 1
or 0 (eq. 6 of the paper), so the belief is the prior restricted to those that are left (eq. 5), and an object's
probability is the sum over its configurations (eq. 7). What is eliminated once is gone for good.

The paper takes a part's pose from its invariants J and K. Those are rank-deficient on a planar part (design §3), and
every part of a model base is planar: the paper's own solve (``jk_solve``) would return wherever it started. So the pose
of a part is the estimator's with its soft priors; in a new view it is started at what the interpretation expects.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief
from recognition.expected import GATE_MM, expect, part_in_camera, wall_angle, within_gates
from recognition.geometry import Pose4
from recognition.hypotheses import Hypotheses, ViewMatches, no_matches
from recognition.layout import Layout
from recognition.pose import estimate_pose
from recognition.seen import Seen
from recognition.settings import BenchBounds
from recognition.tracking import World, add_view, guess_internals
from recognition.varpro import refine_batch
from rig.errors import DegenerateGeometryError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_TOLERATED = 9.0
"""-2 log likelihood above the best up to which another pose of the first part is carried along."""
_TRIED = 3


@dataclass(frozen=True, slots=True)
class Interpretations:
    """Interpretations that are left, one or more rows for each.

    One view of a planar part leaves its distance open, and may fit a mirrored pose, too. Rows of one interpretation are
    such poses, two gates apart; it is eliminated when all its rows are.

    Attributes:
        hypotheses: H rows: object, placement from the latest part, internals of each view.
        part: ``(H,)`` the part in the middle of the first view: with its object it names the interpretation.
        area: ``(H,)`` of that part, which the prior is proportional to.
        cost: ``(H,)`` -2 log likelihood of the parts taken so far; it says which row stands for its interpretation.
    """

    hypotheses: Hypotheses = field(repr=False)
    part: IntArray
    area: FloatArray
    cost: FloatArray

    @property
    def count(self) -> int:
        """Distinct interpretations."""
        return len(np.unique(self.part))

    @property
    def most_probable(self) -> float:
        """Probability of the leading interpretation."""
        area = self.area[self._standing()]
        return float(area.max() / area.sum())

    def take(self, rows: IntArray) -> Interpretations:
        """Those rows."""
        return Interpretations(self.hypotheses.take(rows), self.part[rows], self.area[rows], self.cost[rows])

    def belief(self) -> Belief:
        """What the other parts of recognition know as the belief: one row for each interpretation, weighed by area.

        There is no "none of these" in the paper.
        """
        if len(self.part) == 0:
            return Belief.empty()
        rows = self._standing()
        rows = rows[np.argsort(-self.area[rows], kind="stable")]
        return Belief(self.hypotheses.take(rows), self.area[rows] / self.area[rows].sum(), 0.0)

    def _standing(self) -> IntArray:
        """The row of least cost of each interpretation."""
        order = np.lexsort((self.cost, self.part))
        return np.asarray(order[np.unique(self.part[order], return_index=True)[1]])


def part_area(layout: Layout) -> FloatArray:
    """``(P,)`` area of each part, mm2."""
    x, y = np.moveaxis(layout.local_mm, -1, 0)
    return np.asarray(0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)))


def interpret(world: World, views: list[Seen], detection: int) -> Interpretations:
    """All interpretations of the last view: every part of the class of one detection, the one in its middle."""
    seen = views[-1]
    part = np.flatnonzero(world.layout.part_class == seen.class_score[detection].argmax())
    part = part[world.layout.corner_count[part] == seen.corner_count[detection]]
    nothing = np.empty(0, dtype=np.int64)
    which, starts = [nothing], [np.empty((0, 4))]
    for shape in np.unique(world.layout.shape[part]):
        mine = part[world.layout.shape[part] == shape]
        for pose in _poses_of(world, seen, detection, int(mine[0])):
            which.append(mine)
            starts.append(_placements(world.layout, seen, mine, pose))
    row = np.concatenate(which)
    hypotheses = _blank(world, row, np.concatenate(starts), views)
    hypotheses, valid, cost = _fit(world, hypotheses, row, np.full(len(row), detection), views, iterations=0)
    keep = np.flatnonzero(valid)
    return Interpretations(hypotheses.take(keep), row[keep], part_area(world.layout)[row[keep]], cost[keep])


def eliminate(world: World, before: Interpretations, views: list[Seen]) -> Interpretations:
    """Those whose expected part is found in the last view: right class, and a pose within the gates (eq. 6).

    The expected part is the one that stands nearest to the image centre, known through the move and the model base's
    links; other parts, found or missed, are not asked for.
    """
    seen = views[-1]
    hypotheses = add_view(before.hypotheses, views, room=1)
    internals = guess_internals(world, hypotheses, views, seen.group, seen.zoom)
    expected = expect(world, hypotheses, seen.camera_row[None], internals[None], seen.image_size)
    middle = expected.first[0]
    rows = np.flatnonzero(middle >= 0)
    part = expected.part[middle[rows]]
    tried, detection = _nearest(world.layout, seen, part, expected.corners_px[middle[rows]])
    rows, part = rows[tried], part[tried]
    camera = np.repeat(seen.camera_row[None], len(rows), axis=0)
    predicted = part_in_camera(world.layout, part, hypotheses.placement[rows], camera)
    fitted, fits, cost = _fit(world, hypotheses.take(rows), part, detection, views, iterations=20)
    measured = part_in_camera(world.layout, part, fitted.placement, camera)
    found = np.flatnonzero(fits & within_gates(predicted, measured))
    # Of several detections that pass for the expected part, the one that fits best.
    found = found[np.lexsort((cost[found], rows[found]))]
    kept = found[np.unique(rows[found], return_index=True)[1]]
    after = replace(before.take(rows[kept]), hypotheses=fitted.take(kept))
    return replace(after, cost=after.cost + cost[kept])


def carry(_: World, before: Interpretations, views: list[Seen]) -> Interpretations:
    """The same interpretations after an empty view, which eliminates nothing."""
    return replace(before, hypotheses=add_view(before.hypotheses, views, room=1))


def central(seen: Seen, among: IntArray) -> int:
    """The detection nearest to the image centre, among some."""
    away = seen.centre_px[among] - (np.array(seen.image_size) - 1) / 2
    return int(among[np.linalg.norm(away, axis=1).argmin()])


def _poses_of(world: World, seen: Seen, detection: int, part: int) -> list[Pose4]:
    """The part's pose in the camera from one detection: the best, and mirrored ones that fit nearly as well."""
    count = int(world.layout.corner_count[part])
    points = np.column_stack([world.layout.local_mm[part, :count], np.zeros(count)])
    sigma = float(np.hypot(seen.sigma_px[detection], world.rates.corner_sd_px))
    pixels = seen.corners_px[detection, :count]
    priors = world.priors(seen.image_size)
    try:
        found = estimate_pose(points, pixels, priors=priors, sigma_px=sigma)
    except DegenerateGeometryError:
        return []
    minima = [found.pose, *(a.pose for a in found.alternatives if a.cost_above < _TOLERATED)]
    family = [p for pose in minima if isinstance(pose, Pose4) for p in _at_other_distances(pose, world.bounds)]
    start = np.array([[np.radians(p.theta_deg), *p.translation_mm] for p in family])
    n = len(family)
    fit = refine_batch(
        start,
        np.repeat(points[None], n, axis=0),
        np.repeat(pixels[None], n, axis=0),
        np.full((n, count), 1.0 / sigma),
        np.zeros((n, count), dtype=np.int64),
        np.zeros((1, 4)),
        np.zeros(1, dtype=np.int64),
        priors,
        iterations=0,
    )
    good = fit.valid & (fit.cost < found.cost + _TOLERATED)
    return [pose for pose, keep in zip(family, good, strict=True) if keep]


def _at_other_distances(pose: Pose4, bounds: BenchBounds) -> list[Pose4]:
    """The pose of a planar part and those that look the same, two gates apart: tz / sin(theta), tx and ty stay."""
    step = 2.0 * GATE_MM
    nearer = int((pose.z_mm - bounds.distance_min_mm) // step)
    farther = int(min(2.0 * pose.z_mm, bounds.distance_max_mm - pose.z_mm) // step)
    family = []
    for k in sorted(range(-max(nearer, 0), max(farther, 0) + 1), key=abs):
        z = pose.z_mm + k * step
        sine = np.sin(np.radians(pose.theta_deg)) * z / pose.z_mm
        if abs(sine) < 1.0:
            family.append(Pose4(float(np.degrees(np.arcsin(sine))), pose.x_mm, pose.y_mm, z))
    return family


def _placements(layout: Layout, seen: Seen, part: IntArray, pose: Pose4) -> FloatArray:
    """``(n, 4)`` object -> rig if each of the parts stood in the camera as the pose says."""
    to_rig = seen.camera.to_camera().inverse() @ pose
    result = np.empty((len(part), 4))
    for row, (p, angle) in enumerate(zip(part, wall_angle(layout, part), strict=True)):
        to_part = Pose4.of(float(np.degrees(angle)), layout.centre_mm[p]).inverse()
        object_in_rig = to_rig @ to_part
        result[row] = [np.radians(object_in_rig.theta_deg), *object_in_rig.translation_mm]
    return result


def _blank(world: World, part: IntArray, placement: FloatArray, views: list[Seen]) -> Hypotheses:
    n, groups = len(part), max(v.group for v in views) + 1
    return Hypotheses(
        world.layout.object_of[part],
        placement,
        np.zeros((n, 4, 4)),
        np.zeros((n, groups, 4)),
        np.zeros(n),
        np.zeros((n, len(views))),
        tuple(no_matches(n, v, room=1) for v in views),
    )


def _nearest(layout: Layout, seen: Seen, part: IntArray, expected_px: FloatArray) -> tuple[IntArray, IntArray]:
    """(row, detection) pairs: for each expected part the few detections of its class nearest to where it should be."""
    look = seen.class_score.argmax(axis=1)
    right = (look[None] == layout.part_class[part][:, None]) & (
        seen.corner_count[None] == layout.corner_count[part][:, None]
    )
    gap = np.linalg.norm(seen.corners_px[None] - expected_px[:, None], axis=(2, 3))
    order = np.argsort(np.where(right, gap, np.inf), axis=1)[:, :_TRIED]
    row, column = np.nonzero(np.take_along_axis(right, order, axis=1))
    return row, order[row, column]


def _fit(
    world: World, hypotheses: Hypotheses, part: IntArray, detection: IntArray, views: list[Seen], *, iterations: int
) -> tuple[Hypotheses, npt.NDArray[np.bool_], FloatArray]:
    """Pose of one part of each hypothesis from one detection of the last view, from where the hypothesis has it.

    Where the pose is free to move, the bench's focal range is left out: it would pull every depth to its own middle,
    where the paper's solve leaves what the part does not tell as it was expected.

    Returns:
        the hypotheses fitted, whether each fit is sound ``(H,)``, and its cost ``(H,)``.
    """
    layout, seen = world.layout, views[-1]
    n, corners = len(part), layout.corners_mm.shape[1]
    if n == 0:
        return hypotheses, np.zeros(0, dtype=bool), np.zeros(0)
    real = np.arange(corners)[None] < layout.corner_count[part][:, None]
    weight = 1.0 / np.hypot(seen.sigma_px[detection], world.rates.corner_sd_px)
    priors = world.priors(seen.image_size)
    fit = refine_batch(
        hypotheses.placement,
        layout.corners_mm[part],
        seen.corners_px[detection],
        weight[:, None] * real,
        np.zeros((n, corners), dtype=np.int64),
        seen.camera_row[None],
        np.zeros(1, dtype=np.int64),
        replace(priors, focal_range_px=None) if iterations else priors,
        iterations=iterations,
    )
    internals = hypotheses.internals.copy()
    internals[:, seen.group] = fit.internals[:, 0]
    fitted = replace(
        hypotheses,
        placement=fit.placement,
        covariance=fit.covariance,
        internals=internals,
        # Of each view one part is matched, so there is no room kept for more: interpretations are many.
        matches=(
            *hypotheses.matches[:-1],
            ViewMatches(part[:, None], seen.corners_px[detection][:, None], weight[:, None]),
        ),
    )
    return fitted, fit.valid & np.isfinite(fit.placement).all(axis=1), fit.cost
