"""Where the camera was: the object from above with the camera's path, and its walls unfolded with what was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
from recognition.steps import Answer, Step
from rig.report import svg

PLAN_WIDTH, PLAN_HEIGHT = 1060.0, 520.0
WALL_WIDTH = 1060.0
GAP = 26.0


@dataclass(frozen=True)
class Outline:
    """A part's outline: id, face, ``(n, 3)`` corners in the object frame, and which views found or missed it."""

    id: str
    face: str
    corners_mm: FloatArray
    found: tuple[int, ...]
    missed: tuple[int, ...]

    @property
    def css(self) -> str:
        """Found in some view, only ever missed, or never looked at."""
        return "found" if self.found else "missed" if self.missed else "unseen"

    @property
    def title(self) -> str:
        """The tooltip."""
        seen = f", found in view {_listed(self.found)}" if self.found else ""
        missed = f", missed in view {_listed(self.missed)}" if self.missed else ""
        return f"{self.id}{seen}{missed}"


def outlines_of(item: Mapping[str, Any], steps: Sequence[Step]) -> list[Outline]:
    """The parts of one object of a run's record, with what the leading hypotheses said of them."""
    found: dict[str, list[int]] = {}
    missed: dict[str, list[int]] = {}
    for step in steps:
        leader = step.belief.leaders[0] if step.belief.leaders else None
        if leader is not None and leader.object_id == item["id"]:
            for match in leader.matches:
                seen = missed if match.detection is None else found
                seen.setdefault(match.part_id, []).append(step.index + 1)
    return [
        Outline(
            id=part["id"],
            face=part["face"],
            corners_mm=part["corners_mm"],
            found=tuple(found.get(part["id"], ())),
            missed=tuple(missed.get(part["id"], ())),
        )
        for part in item["parts"]
    ]


def camera_path(steps: Sequence[Step], answer: Answer, mount: Mount) -> list[CameraPose]:
    """The camera in the object frame at every view, from the last pose and the rig's moves; empty without a pose."""
    if answer.pose is None or not steps:
        return []
    cameras = [camera_in_rig(step.frame.rig_pose, mount) for step in steps]
    object_in_rig: Pose4 = cameras[-1].to_camera().inverse() @ answer.pose.to_camera()
    return [camera_in_object(camera, object_in_rig) for camera in cameras]


def plan(outlines: Sequence[Outline], walls: Sequence[FloatArray], path: Sequence[CameraPose]) -> Markup:
    """The object from above, X to the right and Z up the page, and the camera's numbered places and directions."""
    centres = np.array([[camera.x_mm, camera.z_mm] for camera in path]).reshape(-1, 2)
    points = [outline.corners_mm[:, [0, 2]] for outline in outlines] + [wall[:, [0, 2]] for wall in walls] + [centres]
    scale, origin, size = _fit(np.concatenate(points), PLAN_WIDTH, PLAN_HEIGHT, margin=34.0)

    def place(xz: FloatArray) -> FloatArray:
        return np.asarray((xz - origin) * [scale, -scale] + [0.0, size[1]])

    body = [svg.polyline(place(_span(wall)), "wall") for wall in walls]
    drawn: set[tuple[str, bytes]] = set()
    for outline in sorted(outlines, key=lambda item: ("unseen", "missed", "found").index(item.css)):
        span = place(_span(outline.corners_mm)).round(1)
        # Windows above each other coincide in the plan: one line is enough for all of them.
        if (outline.css, span.tobytes()) not in drawn:
            drawn.add((outline.css, span.tobytes()))
            body.append(svg.polyline(span, f"opening {outline.css}"))
    body += _path(place(centres), [np.radians(camera.theta_deg) for camera in path])
    body += _scale_bar(scale, size)
    return svg.canvas(PLAN_WIDTH, float(size[1]), body, "The object from above with the camera's path", "plan")


def unfolded(outlines: Sequence[Outline]) -> Markup:
    """The walls side by side as seen from outside, by their directions; parts coloured by what was seen."""
    panels = [_Panel.of(face, parts) for face, parts in _by_face(outlines).items()]
    panels.sort(key=lambda panel: panel.azimuth_deg)
    if not panels:
        return Markup("")
    total = sum(panel.size[0] for panel in panels)
    tallest = max(panel.size[1] for panel in panels)
    rows = max(1, round(np.sqrt(total / (3.2 * tallest))))
    scale = min((WALL_WIDTH - GAP * len(panels) / rows) / (total / rows), 260.0 / tallest)
    # A row breaks between walls, so the widest wall may ask for a smaller scale.
    scale = min(scale, (WALL_WIDTH - GAP) / max(panel.size[0] for panel in panels))
    body, x, y = [], 0.0, 0.0
    for panel in panels:
        width = panel.size[0] * scale
        if x > 0 and x + width > WALL_WIDTH:
            x, y = 0.0, y + tallest * scale + 2 * GAP
        body.append(panel.draw(x, y, scale, tallest))
        x += width + GAP
    return svg.canvas(WALL_WIDTH, y + tallest * scale + GAP, body, "The walls unfolded", "plan")


@dataclass(frozen=True)
class _Panel:
    """One wall laid flat: each part's ``(n, 2)`` corners, x to the right as seen from outside, y down, mm."""

    face: str
    azimuth_deg: float
    flat: tuple[tuple[Outline, FloatArray], ...]
    low: FloatArray
    size: FloatArray

    @staticmethod
    def of(face: str, parts: Sequence[Outline]) -> _Panel:
        normal = np.mean([_outward(part.corners_mm) for part in parts], axis=0)
        along = np.array([-normal[2], 0.0, normal[0]])
        along = along / max(float(np.linalg.norm(along)), 1e-9)
        flat = tuple(
            (part, np.column_stack([part.corners_mm @ along, part.corners_mm[:, 1]]))
            for part in sorted(parts, key=lambda item: item.css)
        )
        points = np.concatenate([corners for _, corners in flat])
        margin = 0.04 * float(np.ptp(points, axis=0).max())
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        azimuth = float(np.degrees(np.arctan2(normal[0], -normal[2])))
        return _Panel(face, azimuth, flat, low, high - low)

    def draw(self, x: float, y: float, scale: float, tallest: float) -> Markup:
        top = y + (tallest - self.size[1]) * scale
        corner = np.array([x, top])
        body = [svg.rect(x, top, self.size[0] * scale, self.size[1] * scale, "panel")]
        body += [
            svg.polygon((flat - self.low) * scale + corner, f"window {part.css}", part.title)
            for part, flat in self.flat
        ]
        body.append(svg.text(x, y + tallest * scale + 15, self.face, "tick"))
        return Markup("").join(body)


def _by_face(outlines: Sequence[Outline]) -> dict[str, list[Outline]]:
    faces: dict[str, list[Outline]] = {}
    for outline in outlines:
        normal = _outward(outline.corners_mm)
        turned = int(round(float(np.degrees(np.arctan2(normal[0], -normal[2]))) / 15) * 15)
        faces.setdefault(outline.face or f"facing {turned}°", []).append(outline)
    return faces


def _outward(corners_mm: FloatArray) -> FloatArray:
    area = np.cross(corners_mm, np.roll(corners_mm, -1, axis=0)).sum(axis=0)
    return np.asarray(-area / max(float(np.linalg.norm(area)), 1e-9))


def _span(corners_mm: FloatArray) -> FloatArray:
    """``(2, 2)`` ends in X and Z of a vertical surface seen from above."""
    points = corners_mm[:, [0, 2]]
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle)[2][0]
    reach = (points - middle) @ direction
    return np.asarray(middle + np.outer([reach.min(), reach.max()], direction))


def _fit(points: FloatArray, width: float, height: float, margin: float) -> tuple[float, FloatArray, FloatArray]:
    """Scale, lower corner and size on the page so that all points fit with the margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, 1e-6)
    scale = float(min((width - 2 * margin) / extent[0], (height - 2 * margin) / extent[1]))
    origin = low - margin / scale
    # The page is as wide as it is: what is left over goes to both sides.
    origin[0] -= (width / scale - extent[0] - 2 * margin / scale) / 2
    return scale, origin, np.array([width, extent[1] * scale + 2 * margin])


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


def _scale_bar(scale: float, size: FloatArray) -> list[Markup]:
    length = svg.nice_length(160.0 / scale)
    x, y = 12.0, float(size[1]) - 12.0
    bar = svg.line(x, y, x + length * scale, y, "bar")
    return [bar, svg.text(x + length * scale + 8, y + 4, svg.millimetres(length), "tick")]


def _listed(views: Sequence[int]) -> str:
    return ", ".join(map(str, views))
