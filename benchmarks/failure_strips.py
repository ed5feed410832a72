"""Draws what went wrong in a recognition: outlines only, on white, for photographs that must not be passed on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from recognition.steps import Step
from rig.evaluate.trial import Trial

FloatArray = npt.NDArray[np.float64]
Canvas = npt.NDArray[np.uint8]

WIDTH, HEIGHT, SHOWN, A_ROW, HEAD = 1280, 960, 400, 4, 22
DETECTED, TRUE, EXPECTED = (190, 190, 190), (200, 110, 0), (30, 30, 220)
"""Blue, green, red: what was detected is grey, what is there blue, what the leading hypothesis expects red."""
QUALITY = 80


def write_failure(folder: Path, trial: Trial, steps: Sequence[Step], true_px: Sequence[Sequence[FloatArray]]) -> Path:
    """Write a strip of the run's views (JPEG) and its log (text) into a folder; returns the picture's path.

    Args:
        folder: made if need be.
        trial: the failure.
        steps: its views.
        true_px: for each view, corners ``(n, 2)`` of the parts that are really there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stem = Path(trial.name.replace(" ", "_")).stem
    picture = folder / f"{stem}.jpg"
    strip = draw_strip([draw_view(step, true) for step, true in zip(steps, true_px, strict=True)])
    if not cv2.imwrite(str(picture), strip, [cv2.IMWRITE_JPEG_QUALITY, QUALITY]):
        raise OSError(f"{picture} could not be written")
    (folder / f"{stem}.txt").write_text("\n".join([trial.line, *trial.log]) + "\n")
    return picture


def draw_view(step: Step, true_px: Sequence[FloatArray]) -> Canvas:
    """One view, ``(SHOWN * 3/4 + HEAD, SHOWN, 3)``: detected, true and expected outlines under a line of text."""
    scale = SHOWN / WIDTH
    canvas = np.full((round(HEIGHT * scale) + HEAD, SHOWN, 3), 255, dtype=np.uint8)
    outline(canvas, [part.corners_px for part in step.parts], scale, DETECTED, 1)
    outline(canvas, true_px, scale, TRUE, 2)
    leaders = step.belief.leaders
    if leaders:
        outline(canvas, [match.predicted_px for match in leaders[0].matches], scale, EXPECTED, 1)
    # The head is drawn last: outlines that leave the frame would run through it.
    canvas[:HEAD] = 240
    text = f"{step.index + 1}: {step.belief.hypotheses_left} left"
    if leaders:
        text += f", {leaders[0].object_id} {leaders[0].probability:.2f} at {leaders[0].place}"
    cv2.putText(canvas, text[:58], (4, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    canvas[:, -1] = canvas[-1] = 150
    return canvas


def outline(canvas: Canvas, polygons: Sequence[FloatArray], scale: float, colour: Sequence[int], width: int) -> None:
    """Draw closed polygons, full-size pixels, below the head."""
    for corners in polygons:
        points = np.clip((corners + 0.5) * scale - 0.5, -2 * WIDTH, 2 * WIDTH) + np.array([0, HEAD])
        # Four more bits of position than whole pixels.
        fixed = np.round(points * 16).astype(np.int32)
        cv2.polylines(canvas, [fixed], True, tuple(colour), width, cv2.LINE_AA, shift=4)


def draw_strip(views: Sequence[Canvas]) -> Canvas:
    """Views side by side, a few in a row."""
    rows = [list(views[k : k + A_ROW]) for k in range(0, len(views), A_ROW)]
    blank = np.full_like(views[0], 255)
    if len(rows) > 1:
        rows[-1] += [blank] * (A_ROW - len(rows[-1]))
    return np.vstack([np.hstack(row) for row in rows])
