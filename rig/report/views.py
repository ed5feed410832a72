"""The pictures of a run with the parts drawn in: found ones, and where the leading hypothesis expected some."""

from __future__ import annotations

import base64

import numpy as np
from markupsafe import Markup

from recognition.steps import Step
from rig.errors import RigError
from rig.hal import Image
from rig.report import svg

MAX_WIDTH = 900
JPEG_QUALITY = 82


def data_uri(image: Image) -> str:
    """The picture as a JPEG of at most ``MAX_WIDTH`` columns, to be put into the page itself."""
    import cv2

    height, width = image.shape[:2]
    if width > MAX_WIDTH:
        size = (MAX_WIDTH, max(1, round(height * MAX_WIDTH / width)))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    done, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise RigError("a picture of the run cannot be encoded for the report")
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii")


def overlay(step: Step) -> Markup:
    """Outlines over the picture, in its pixels."""
    height, width = step.frame.image.shape[:2]
    leader = step.belief.leaders[0] if step.belief.leaders else None
    matches = leader.matches if leader else ()
    expected: list[Markup] = []
    found: list[Markup] = []
    clutter: list[Markup] = []
    for match in matches:
        css, state = ("missed", "expected, not found") if match.detection is None else ("expected", "expected")
        expected.append(svg.polygon(match.predicted_px, css, f"{match.part_id}: {state}"))
    matched = {match.detection: match.part_id for match in matches}
    for number, part in enumerate(step.parts):
        name = matched.get(number)
        score = (
            f"{part.part_class} {100 * part.class_scores[part.part_class]:.0f} %" if part.class_scores else "no class"
        )
        title = f"{score}, taken for {name}" if name else f"{score}, not explained"
        (found if name else clutter).append(svg.polygon(part.corners_px, "found" if name else "clutter", title))
    # Pixel (0, 0) is the centre of the top-left pixel, so the picture's edge lies half a pixel outside.
    shifted = Markup('<g transform="translate(0.5 0.5)">{}</g>').format(
        # What counts is drawn last: many other outlines may lie around a part.
        Markup("").join([*clutter, *expected, *found])
    )
    return svg.canvas(width, height, [shifted], f"Parts in view {step.index + 1}", "overlay")
