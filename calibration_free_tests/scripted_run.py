"""A recognition loop that plays a fixed script: for tests of all that watches a loop, without the loop."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from recognition.geometry import CameraPose, FloatArray, project
from recognition.modelbase import Face, ModelBase, ObjectModel, Part, PartClass
from recognition.parts import DetectedPart
from recognition.steps import (
    Answer,
    BeliefSummary,
    HypothesisSummary,
    Move,
    Outcome,
    PartMatch,
    Step,
    StepSeconds,
)
from rig.hal import Frame, Image, RigPose

WIDTH, HEIGHT = 640, 480
INTERNALS = np.array([560.0, 562.0, 330.0, 228.0])
CAMERAS = (
    CameraPose(0.0, 200.0, 140.0, -380.0),
    CameraPose(0.0, 390.0, 140.0, -380.0),
    CameraPose(38.0, 830.0, 150.0, -330.0),
    CameraPose(84.0, 1010.0, 150.0, 170.0),
)
OBJECT_IN_RIG = np.array([1000.0, -50.0, 700.0])
WHYS = (
    "Half a metre to the right only the tower has its door: the move is expected to take 2.1 bits for 1.4 s.",
    "Panning to the corner tells the lean-to from the tower by the windows on its right-hand face.",
    "The right-hand face is seen square on; this makes the pose sure, not the object.",
)
END = "One configuration holds 99.6 % of the probability, and the pose is as sure as asked."


def scripted_models() -> ModelBase:
    """Three buildings on two walls at right angles that differ in a few windows."""
    classes = (PartClass("DW4", 4), PartClass("OPEN", 4, bright=True))
    return ModelBase(tuple(_building(k, name) for k, name in enumerate(("tower", "lean-to", "barn"))), classes, "three")


def scripted_steps(
    views: int = len(CAMERAS), failure: BaseException | None = None, labels: str = ""
) -> Generator[Step, None, Answer]:
    """Yield ``views`` scripted views of the tower, then raise ``failure`` or return the answer.

    ``labels`` is appended to every name that a user can choose, to see what hostile names do.
    """
    models = scripted_models()
    for k in range(views):
        yield _step(models.objects[0], k, last=k == len(CAMERAS) - 1, labels=labels)
    if failure is not None:
        raise failure
    return Answer(
        outcome=Outcome.RECOGNISED,
        object_id="tower" + labels,
        candidates=("tower at front 2.3" + labels,),
        posterior=_posterior(views - 1, labels),
        pose=CAMERAS[views - 1],
        pose_sd={"theta_deg": 0.21, "x_mm": 1.4, "y_mm": 0.6, "z_mm": 2.2},
        unobservable=(),
        why=END,
        travel_mm=830.0,
        rotation_deg=68.0,
        pose_sure=True,
    )


def _building(kind: int, name: str) -> ObjectModel:
    front = np.array([[0, 0, 0], [600, 0, 0], [600, 300, 0], [0, 300, 0]], dtype=float)
    side = np.array([[600, 0, 0], [600, 0, 400], [600, 300, 400], [600, 300, 0]], dtype=float)
    faces = (Face("front", front), Face("side", side))
    parts = []
    for face, along, columns in (("front", np.array([1.0, 0, 0]), 7), ("side", np.array([0, 0, 1.0]), 4)):
        origin = front[0] if face == "front" else side[0]
        for row in range(3):
            for column in range(columns):
                if (row * 5 + column * 3 + kind) % 7 == 0:
                    continue
                corner = origin + along * (30 + 80 * column) + np.array([0, 30 + 90 * row, 0])
                across, down = along * 40, np.array([0, 55.0, 0])
                corners = np.array([corner, corner + across, corner + across + down, corner + down])
                part_class = "OPEN" if (row + column + kind) % 6 == 5 else "DW4"
                parts.append(Part(f"{face} {row}.{column}", part_class, corners, face))
    return ObjectModel(name, tuple(parts), faces)


def _pixels(camera: CameraPose, points: FloatArray) -> FloatArray:
    to_camera = camera.to_camera()
    return project(points @ to_camera.rotation.T + to_camera.translation_mm, INTERNALS)


def _seen(building: ObjectModel, camera: CameraPose) -> list[tuple[Part, FloatArray]]:
    seen = []
    for part in building.parts:
        if float(part.normal @ (camera.centre_mm - part.centre_mm)) <= 0:
            continue
        depth = (part.corners_mm - camera.centre_mm) @ camera.to_camera().rotation[2]
        pixels = _pixels(camera, part.corners_mm)
        if depth.min() > 1 and (pixels > 4).all() and (pixels < [WIDTH - 4, HEIGHT - 4]).all():
            seen.append((part, pixels))
    return seen


def _picture(seen: list[tuple[Part, FloatArray]]) -> Image:
    import cv2

    image = np.full((HEIGHT, WIDTH, 3), (178, 196, 205), dtype=np.uint8)
    noise = np.random.default_rng(1).normal(0, 4, image.shape)
    for part, pixels in seen:
        shade = (70, 62, 58) if part.part_class == "DW4" else (238, 240, 242)
        cv2.fillPoly(image, [pixels.round().astype(np.int32)], shade, cv2.LINE_AA)
    return np.asarray((image + noise).clip(0, 255), dtype=np.uint8)


def _posterior(k: int, labels: str) -> dict[str, float]:
    rows = (
        (0.36, 0.34, 0.27, 0.03),
        (0.61, 0.33, 0.04, 0.02),
        (0.94, 0.05, 0.002, 0.008),
        (0.996, 0.002, 0.001, 0.001),
    )
    names = ("tower" + labels, "lean-to" + labels, "barn" + labels, "unknown")
    return dict(zip(names, rows[k], strict=True))


def _step(building: ObjectModel, k: int, last: bool, labels: str) -> Step:
    camera = CAMERAS[k]
    seen = _seen(building, camera)
    found = [(part, pixels) for n, (part, pixels) in enumerate(seen) if n % 7 != 6]
    rng = np.random.default_rng(k)
    parts = [
        DetectedPart(pixels + rng.normal(0, 0.4, pixels.shape), {part.part_class + labels: 0.97}, 0.4, 0.9)
        for part, pixels in found
    ]
    clutter = np.array([[20.0, 400], [80, 404], [78, 470], [22, 466]])
    parts.append(DetectedPart(clutter, {"DW4" + labels: 0.5, "OPEN" + labels: 0.2}, 1.0, 0.3))
    numbers = {part.id: n for n, (part, _) in enumerate(found)}
    matches = tuple(PartMatch(part.id, pixels, numbers.get(part.id)) for part, pixels in seen)
    posterior = _posterior(k, labels)
    place = "front 2.3" + labels
    leaders = (
        HypothesisSummary("tower" + labels, place, posterior["tower" + labels], camera, matches),
        HypothesisSummary("lean-to" + labels, "front 1.1", posterior["lean-to" + labels], camera),
    )
    belief = BeliefSummary(posterior, (374, 41, 3, 1)[k], (8.1, 4.37, 0.9, 0.04)[k], leaders)
    pose = _rig_pose(camera)
    move = None if last else Move(_rig_pose(CAMERAS[k + 1]), WHYS[k] + labels, 2.1, 1.4)
    frame = Frame(_picture(seen), pose, pose, f"r{k:02d}.png" + labels, k, 12.5 * k)
    return Step(k, frame, tuple(parts), belief, move, StepSeconds(0.081, 0.12, 0.04))


def _rig_pose(camera: CameraPose) -> RigPose:
    x, y, z = (float(v) for v in camera.centre_mm + OBJECT_IN_RIG)
    return RigPose(x, y, z, camera.theta_deg, 0.25)
