"""A small world at the level of corners: buildings, a camera that nobody calibrated, and a rig whose detector is exact.

No picture is rendered: a frame's image only carries its number, and the detector looks up what that frame shows. Faults
(noise, misses, false quadrilaterals) are asked for. Projection and visibility are computed here anew, not by the code
under test; the buildings are convex, so that a part is seen if it faces the camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from recognition.belief import Belief, update, weigh
from recognition.geometry import CameraPose, Pose4, camera_in_object, camera_in_rig, project
from recognition.hypotheses import Hypotheses
from recognition.modelbase import Face, ModelBase, ObjectModel, Part, PartClass
from recognition.parts import DetectedPart
from recognition.rates import DetectionRates
from recognition.recogniser import recognise
from recognition.seen import Seen, see
from recognition.settings import BenchBounds, Effort, RecogniserSettings
from recognition.steps import Answer, Step
from recognition.tracking import World, make_world
from rig.hal import AxisLimits, Frame, Image, RigLimits, RigPose, travel_seconds

FloatArray = npt.NDArray[np.float64]

WIDTH, HEIGHT = 640, 480
SIZE = (WIDTH, HEIGHT)
INTERNALS = np.array([700.0, 702.0, 322.0, 236.0])
BOUNDS = BenchBounds(distance_min_mm=60, distance_max_mm=2500, view_angle_min_deg=20, view_angle_max_deg=80)
RATES = DetectionRates(found=0.95, clutter=1.0, corner_sd_px=0.5)
CLASSES = (PartClass("DW4", 4), PartClass("OPEN", 4, bright=True))
OBJECT_IN_RIG = Pose4(25.0, 900.0, -40.0, 700.0)


def building(name: str, kind: int, columns: int = 9, rows: int = 4, side_columns: int = 5) -> ObjectModel:
    """A convex building with windows on its front (z = 0) and its right-hand side; ``kind`` decides which."""
    rng = np.random.default_rng(kind)
    long, deep, high = 80.0 * columns + 40, 80.0 * side_columns + 40, 90.0 * rows + 40
    front = np.array([[0, 0, 0], [long, 0, 0], [long, high, 0], [0, high, 0]], dtype=float)
    side = np.array([[long, 0, 0], [long, 0, deep], [long, high, deep], [long, high, 0]], dtype=float)
    parts = []
    for face, corners, across, count in (
        ("front", front, np.array([1.0, 0, 0]), columns),
        ("side", side, np.array([0, 0, 1.0]), side_columns),
    ):
        for row in range(rows):
            for column in range(count):
                there, bright = rng.random(2)
                if there < 0.3:
                    continue
                at = corners[0] + across * (30 + 80 * column) + np.array([0, 30 + 90 * row, 0])
                parts.append(_window(f"{face} {row}.{column}", "OPEN" if bright < 0.2 else "DW4", at, across, face))
    return ObjectModel(name, tuple(parts), (Face("front", front), Face("side", side)))


def _window(name: str, part_class: str, at: FloatArray, across: FloatArray, face: str) -> Part:
    wide, down = 40.0 * across, np.array([0.0, 55.0, 0.0])
    return Part(name, part_class, np.array([at, at + wide, at + wide + down, at + down]), face)


def regular(name: str, columns: int = 12, rows: int = 5) -> ObjectModel:
    """One endless-looking wall of equal windows: no place in its middle can be told from the next."""
    parts = [
        _window(f"front {r}.{c}", "DW4", np.array([30.0 + 80 * c, 30.0 + 90 * r, 0]), np.array([1.0, 0, 0]), "front")
        for r in range(rows)
        for c in range(columns)
    ]
    return ObjectModel(name, tuple(parts))


def three_buildings() -> ModelBase:
    """Three buildings of one style that differ in which windows they have."""
    return base_of(*(building(name, kind) for kind, name in enumerate(("tower", "mill", "barn"))))


def base_of(*objects: ObjectModel) -> ModelBase:
    """A model base of the two classes."""
    return ModelBase(objects, CLASSES, "synthetic")


def world_of(base: ModelBase, rates: DetectionRates = RATES, bounds: BenchBounds = BOUNDS) -> World:
    """The base compiled for the synthetic bench."""
    return make_world(base, bounds, rates)


def before_front(x_mm: float, y_mm: float = 200.0, distance_mm: float = 330.0, turn_deg: float = 0.0) -> CameraPose:
    """A camera before the front, at a place along it, turned from facing it squarely; in the object frame."""
    return CameraPose(turn_deg, x_mm, y_mm, -distance_mm)


def in_rig(camera: CameraPose, object_in_rig: Pose4 = OBJECT_IN_RIG) -> CameraPose:
    """A camera given in the object frame, in the rig frame."""
    return CameraPose.from_to_camera(camera.to_camera() @ object_in_rig.inverse())


def rig_pose(camera: CameraPose, zoom: float = 0.0) -> RigPose:
    """Where a rig without a lever arm stands when its camera is there (rig frame)."""
    return RigPose(camera.x_mm, camera.y_mm, camera.z_mm, camera.theta_deg, zoom)


def pixels_of(points_mm: FloatArray, camera: CameraPose, internals: FloatArray = INTERNALS) -> FloatArray:
    """Pixels ``(n, 2)`` of points ``(n, 3)``; camera and points in one frame."""
    to_camera = camera.to_camera()
    return project(points_mm @ to_camera.rotation.T + to_camera.translation_mm, internals)


def visible(thing: ObjectModel, camera: CameraPose, internals: FloatArray = INTERNALS) -> list[tuple[Part, FloatArray]]:
    """Parts of a convex object that lie wholly in the picture, with their corners; the camera in the object frame."""
    found = []
    for part in thing.parts:
        ray = part.centre_mm - camera.centre_mm
        if -float(part.normal @ ray) < 0.25 * float(np.linalg.norm(ray)):
            continue
        if ((part.corners_mm - camera.centre_mm) @ camera.to_camera().rotation[2]).min() < 1.0:
            continue
        px = pixels_of(part.corners_mm, camera, internals)
        if (px > 4).all() and (px < [WIDTH - 5, HEIGHT - 5]).all() and np.ptp(px, axis=0).min() > 12:
            found.append((part, px))
    return found


@dataclass(frozen=True)
class Faults:
    """What a detector does wrong: noise of a corner (px), share of parts missed, false quadrilaterals a view."""

    noise_px: float = 0.0
    missed: float = 0.0
    false: int = 0


def detections(seen: Sequence[tuple[Part, FloatArray]], faults: Faults, rng: np.random.Generator) -> list[DetectedPart]:
    """What a detector with such faults finds."""
    parts = []
    for part, px in seen:
        if rng.random() < faults.missed:
            continue
        noisy = px + rng.normal(0, faults.noise_px, px.shape) if faults.noise_px else px
        parts.append(DetectedPart(noisy, {part.part_class: 0.95}, max(faults.noise_px, 0.1)))
    for _ in range(faults.false):
        box = rng.uniform(25, 90, 2)
        low = rng.uniform([5, 5], np.array(SIZE) - box - 6)
        corners = low + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * box
        parts.append(DetectedPart(corners, {"DW4": 0.6}, 0.3, 0.5))
    return parts


def seen_from(
    base: ModelBase,
    thing: ObjectModel | None,
    camera: CameraPose,
    *,
    group: int = 0,
    zoom: float = 0.0,
    internals: FloatArray = INTERNALS,
    faults: Faults | None = None,
    seed: int = 0,
) -> Seen:
    """One view as matching takes it: the camera in the object frame, detections as arrays. ``None``: an empty view."""
    faults = faults or Faults()
    shown = visible(thing, camera, internals) if thing is not None else []
    parts = detections(shown, faults, np.random.default_rng(seed))
    return see(parts, in_rig(camera), SIZE, group, zoom, [c.name for c in base.classes], 4)


def fixed(internals: FloatArray = INTERNALS) -> Callable[[int, RigPose], FloatArray]:
    """Internals that never change."""
    return lambda _number, _pose: internals


def changing(seed: int) -> Callable[[int, RigPose], FloatArray]:
    """Internals that are others in every view: zoom within 15 %, aspect, and a wandering principal point."""

    def draw(number: int, _pose: RigPose) -> FloatArray:
        rng = np.random.default_rng([seed, number])
        f = 700.0 * rng.uniform(0.87, 1.15)
        shift = rng.normal(0, 12, 2)
        return np.array([f, f * rng.normal(1.0, 0.003), 319.5 + shift[0], 239.5 + shift[1]])

    return draw


@dataclass
class SyntheticRig:
    """A rig before an object (``None``: before nothing), and the detector of its pictures.

    ``cameras`` are the reachable places in the object frame; ``internals`` gives those of a picture by its number and
    rig pose; ``altered`` may change what a view shows, by its number.
    """

    thing: ObjectModel | None
    cameras: Sequence[CameraPose]
    internals: Callable[[int, RigPose], FloatArray] = field(default_factory=fixed)
    faults: Faults = field(default_factory=Faults)
    internals_fixed_by_zoom: bool = False
    seed: int = 0
    altered: Callable[[int, list[DetectedPart]], list[DetectedPart]] | None = None
    zooms: Sequence[float] = (0.0,)
    taken: list[RigPose] = field(default_factory=list)
    shown: list[list[DetectedPart]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.offers = [rig_pose(in_rig(c), zoom) for c in self.cameras for zoom in self.zooms]
        self.pose = self.offers[0]

    @property
    def limits(self) -> RigLimits:
        mm, turn = AxisLimits(-5000, 5000, 500), AxisLimits(-180, 180, 60)
        return RigLimits(mm, mm, mm, turn, AxisLimits(0, 1, 1), settle_s=0.2, exposure_s=0.05)

    def reachable(self, near: RigPose | None = None) -> Sequence[RigPose]:
        return self.offers

    def nearest(self, wish: RigPose) -> RigPose:
        return min(self.offers, key=lambda pose: self.travel_s(wish, pose))

    def move_to(self, pose: RigPose) -> RigPose:
        assert pose in self.offers, "the loop asked for a pose that the rig does not offer"
        self.pose = pose
        return pose

    def capture(self) -> Frame:
        number = len(self.taken)
        self.taken.append(self.pose)
        internals = self.internals(number, self.pose)
        shown = visible(self.thing, self.camera, internals) if self.thing is not None else []
        parts = detections(shown, self.faults, np.random.default_rng([self.seed, number]))
        self.shown.append(self.altered(number, parts) if self.altered else parts)
        image = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
        image[0, 0] = number
        return Frame(image, self.pose, self.pose, f"view {number}", number)

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        return self.shown[int(image[0, 0])]

    @property
    def camera(self) -> CameraPose:
        """The truth: the camera in the object frame, now."""
        return CameraPose.from_to_camera(camera_in_rig(self.pose).to_camera() @ OBJECT_IN_RIG)

    def travel_s(self, start: RigPose, end: RigPose) -> float:
        return travel_seconds(self.limits, start, end)

    def close(self) -> None:
        return None

    def __enter__(self) -> SyntheticRig:
        return self

    def __exit__(self, *exc: Any) -> None:
        return None


def around_the_corner(step_mm: float = 80.0) -> list[CameraPose]:
    """Places before the front and the side of ``building``, at two heights, square on and aslant."""
    front = [
        before_front(x, y, turn_deg=turn)
        for x in np.arange(120.0, 700.0, step_mm)
        for y in (140.0, 260.0)
        for turn in (0.0, 20.0)
    ]
    side = [
        CameraPose(90.0 + turn, 760.0 + 330.0, y, z)
        for z in np.arange(100.0, 400.0, step_mm)
        for y in (140.0, 260.0)
        for turn in (0.0, -20.0)
    ]
    return front + side


SETTINGS = RecogniserSettings(bounds=BOUNDS, rates=RATES)


def run(rig: SyntheticRig, base: ModelBase, settings: RecogniserSettings = SETTINGS) -> tuple[list[Step], Answer]:
    """A whole recognition: its steps and its answer."""
    steps = []
    loop = recognise(rig, base, settings, detector=rig)
    while True:
        try:
            steps.append(next(loop))
        except StopIteration as end:
            return steps, end.value


def off(answer: Answer, rig: SyntheticRig) -> tuple[float, float]:
    """How far the answer's pose is from the truth at the last view: mm and degrees."""
    assert answer.pose is not None
    turn = (answer.pose.theta_deg - rig.camera.theta_deg + 180.0) % 360.0 - 180.0
    return float(np.linalg.norm(answer.pose.centre_mm - rig.camera.centre_mm)), abs(turn)


def with_views(settings: RecogniserSettings, **changes: Any) -> RecogniserSettings:
    """The settings with some of them changed."""
    return replace(settings, **changes)


def believed(world: World, views: list[Seen], effort: Effort | None = None) -> tuple[Hypotheses, Belief]:
    """Hypotheses and belief after some views, one update each."""
    hypotheses: Hypotheses | None = None
    for k in range(1, len(views) + 1):
        hypotheses = update(world, hypotheses, views[:k], effort or Effort())
    assert hypotheses is not None
    return hypotheses, weigh(world, hypotheses)


def camera_of(hypotheses: Hypotheses, row: int, seen: Seen) -> CameraPose:
    """Where the camera of a view is in the object frame under a hypothesis."""
    placement = hypotheses.placement[row]
    return camera_in_object(seen.camera, Pose4.of(float(np.degrees(placement[0])), placement[1:]))


def true_rows(hypotheses: Hypotheses, seen: Seen, thing: int, camera: CameraPose, within_mm: float) -> list[int]:
    """Hypotheses of the right object that have the camera within a distance of the truth, in their order."""
    return [
        row
        for row in range(len(hypotheses))
        if hypotheses.object_of[row] == thing
        and np.linalg.norm(camera_of(hypotheses, row, seen).centre_mm - camera.centre_mm) < within_mm
    ]
