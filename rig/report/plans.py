"""Where the camera was: the object from above with the camera's path, and its walls unfolded with what was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from recognition.geometry import (
    CameraPose,
    FloatArray,
    Mount,
    Pose4,
    camera_in_object,
    camera_in_rig,
)
from recognition.modelbase import ObjectModel, Part
from recognition.steps import Answer, Step
from rig.modelshow import FlatFace, unfold
from rig.report import svg

PLAN_WIDTH, PLAN_HEIGHT = 1060.0, 520.0
MARGIN = 54.0
GAP = 26.0
LETTER = 6.8
"""Width of a letter of a wall's name."""


@dataclass(frozen=True)
class Sightings:
    """In which views the leading hypotheses found each part of an object, or missed it: part id to view numbers."""

    found: Mapping[str, tuple[int, ...]]
    missed: Mapping[str, tuple[int, ...]]

    @staticmethod
    def of(thing: ObjectModel, steps: Sequence[Step]) -> Sightings:
        """Collect them from the steps in which this object led."""
        found: dict[str, tuple[int, ...]] = {}
        missed: dict[str, tuple[int, ...]] = {}
        for step in steps:
            leader = step.belief.leaders[0] if step.belief.leaders else None
            if leader is not None and leader.object_id == thing.id:
                for match in leader.matches:
                    seen = missed if match.detection is None else found
                    seen[match.part_id] = (*seen.get(match.part_id, ()), step.index + 1)
        return Sightings(found, missed)

    def css(self, part: Part) -> str:
        """Found in some view, only ever missed, or never looked at."""
        return "found" if part.id in self.found else "missed" if part.id in self.missed else "unseen"

    def title(self, part: Part) -> str:
        """The tooltip."""
        found = f", found in view {_listed(self.found[part.id])}" if part.id in self.found else ""
        missed = f", missed in view {_listed(self.missed[part.id])}" if part.id in self.missed else ""
        return f"{part.id} ({part.part_class}){found}{missed}"


def camera_path(steps: Sequence[Step], answer: Answer, mount: Mount) -> list[CameraPose]:
    """The camera in the object frame at every view, from the last pose and the rig's moves; empty without a pose."""
    if answer.pose is None or not steps:
        return []
    cameras = [camera_in_rig(step.frame.rig_pose, mount) for step in steps]
    object_in_rig: Pose4 = cameras[-1].to_camera().inverse() @ answer.pose.to_camera()
    return [camera_in_object(camera, object_in_rig) for camera in cameras]


def plan(thing: ObjectModel, sightings: Sightings, path: Sequence[CameraPose]) -> Markup:
    """The object from above, X to the right and Z up the page, and the camera's numbered places and directions."""
    centres = np.array([[camera.x_mm, camera.z_mm] for camera in path]).reshape(-1, 2)
    surfaces = [part.corners_mm for part in thing.parts] + [face.corners_mm for face in thing.faces]
    scale, origin, height = _fit(np.concatenate([np.concatenate(surfaces)[:, [0, 2]], centres]))

    def place(xz: FloatArray) -> FloatArray:
        return np.asarray((xz - origin) * [scale, -scale] + [0.0, height])

    body = [svg.polyline(place(_span(wall.corners_mm)), "wall") for wall in thing.faces]
    drawn: set[tuple[str, bytes]] = set()
    for part in sorted(thing.parts, key=lambda part: ("unseen", "missed", "found").index(sightings.css(part))):
        css, span = sightings.css(part), place(_span(part.corners_mm)).round(1)
        # Windows above each other coincide in the plan: one line is enough for all of them.
        if (css, span.tobytes()) not in drawn:
            drawn.add((css, span.tobytes()))
            body.append(svg.polyline(span, f"opening {css}"))
    body += _path(place(centres), [np.radians(camera.theta_deg) for camera in path])
    body += _scale_bar(scale, height)
    return svg.canvas(PLAN_WIDTH, height, body, "The object from above with the camera's path", "plan")


def unfolded(thing: ObjectModel, sightings: Sightings) -> Markup:
    """The walls side by side as seen from outside; parts coloured by what was seen."""
    faces = [face for face in unfold(thing) if face.polygons]
    if not faces:
        return Markup("")
    tallest = max(_height_mm(face) for face in faces)
    total = sum(face.width_mm for face in faces)
    # Rows of walls about three and a half times as wide as high look right and leave parts large enough to tell.
    rows = max(1, round(float(np.sqrt(total / (3.5 * tallest)))))
    widest = max(1.08 * total / rows, *(face.width_mm for face in faces))
    scale = min((PLAN_WIDTH - GAP * len(faces) / rows) / widest, 260.0 / tallest)
    body, y = [], 0.0
    for row in _rows(faces, scale):
        foot, x = y + scale * max(_height_mm(face) for face in row), 0.0
        for face in row:
            body.append(_wall(face, sightings, np.array([x, foot]), scale))
            x += _room(face, scale) + GAP
        y = foot + 2 * GAP
    return svg.canvas(PLAN_WIDTH, y - 0.6 * GAP, body, "The walls unfolded", "plan")


def _rows(faces: Sequence[FlatFace], scale: float) -> list[list[FlatFace]]:
    rows: list[list[FlatFace]] = []
    taken = 0.0
    for face in faces:
        width = _room(face, scale)
        if not rows or taken + width > PLAN_WIDTH:
            rows.append([])
            taken = 0.0
        rows[-1].append(face)
        taken += width + GAP
    return rows


def _room(face: FlatFace, scale: float) -> float:
    """Width that a wall takes: its own, or that of its name, lest names run into each other."""
    return max(face.width_mm * scale, LETTER * len(face.name))


def _height_mm(face: FlatFace) -> float:
    return face.bottom_mm - face.top_mm


def _wall(face: FlatFace, sightings: Sightings, foot: FloatArray, scale: float) -> Markup:
    """One wall with its lower left corner at ``foot``."""
    x, y = (float(v) for v in foot)
    height = _height_mm(face) * scale
    body = [svg.rect(x, y - height, face.width_mm * scale, height, "panel")]
    for part, flat in sorted(face.polygons, key=lambda item: sightings.css(item[0])):
        points = (flat - [face.left_mm, face.bottom_mm]) * scale + foot
        body.append(svg.polygon(points, f"window {sightings.css(part)}", sightings.title(part)))
    body.append(svg.text(x, y + 15.0, face.name, "tick"))
    return Markup("").join(body)


def _span(corners_mm: FloatArray) -> FloatArray:
    """``(2, 2)`` ends in X and Z of a vertical surface seen from above."""
    points = corners_mm[:, [0, 2]]
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle)[2][0]
    reach = (points - middle) @ direction
    return np.asarray(middle + np.outer([reach.min(), reach.max()], direction))


def _fit(points: FloatArray) -> tuple[float, FloatArray, float]:
    """Scale, lower corner and height on the page so that all points fit, in the middle of the page's width."""
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, 1e-6)
    room = np.array([PLAN_WIDTH, PLAN_HEIGHT]) - 2 * MARGIN
    scale = float((room / extent).min())
    origin = low - MARGIN / scale - np.array([(room[0] / scale - extent[0]) / 2, 0.0])
    return scale, origin, float(extent[1] * scale + 2 * MARGIN)


def _path(places: FloatArray, turns: Sequence[float]) -> list[Markup]:
    body = [svg.polyline(places, "path")] if len(places) > 1 else []
    taken: dict[bytes, int] = {}
    for number, (place, turn) in enumerate(zip(places, turns, strict=True), 1):
        # The optical axis in X and Z is (-sin, cos); Z points up the page.
        ahead = np.array([-np.sin(turn), -np.cos(turn)])
        tip, aside = place + 40 * ahead, np.array([-ahead[1], ahead[0]])
        # Views from one place (pan or zoom only) get their numbers side by side.
        key = place.round(0).tobytes()
        taken[key] = taken.get(key, -1) + 1
        x, y = (float(v) for v in place - 6 * ahead)
        x += 21.0 * taken[key]
        body.append(svg.polygon(np.array([place, tip + 13 * aside, tip - 13 * aside]), "sight"))
        body.append(svg.circle(x, y, 10, "badge", f"view {number}"))
        body.append(svg.text(x, y + 4, str(number), "count", "middle"))
    return body


def _scale_bar(scale: float, height: float) -> list[Markup]:
    length = svg.nice_length(160.0 / scale)
    x, y = 12.0, height - 12.0
    bar = svg.line(x, y, x + length * scale, y, "bar")
    return [bar, svg.text(x + length * scale + 8, y + 4, svg.millimetres(length), "tick")]


def _listed(views: Sequence[int]) -> str:
    return ", ".join(map(str, views))
