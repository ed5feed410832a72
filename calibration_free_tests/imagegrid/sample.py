"""Small image grids for tests."""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rig.hal import Frame, Image, RigPose
from rig.imagegrid import GridInfo, GridWriter


def picture(seed: int, size: tuple[int, int] = (24, 16)) -> Image:
    """Random pixels, ``(h, w, 3)`` for a size of ``(w, h)``."""
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)


def encoded(image: np.ndarray, suffix: str, *options: int) -> bytes:
    good, data = cv2.imencode(suffix, image, options)
    assert good
    return data.tobytes()


def frame_at(pose: RigPose, number: int = 0, commanded: RigPose | None = None) -> Frame:
    return Frame(picture(number), pose, commanded or pose, "", number, 12.5 + number)


def lattice(
    xs: Iterable[float] = (0.0, 10.0, 20.0),
    ys: Iterable[float] = (0.0, 10.0),
    thetas: Iterable[float] = (-15.0, 0.0, 15.0),
    zooms: Iterable[float] = (0.25, 0.75),
) -> list[RigPose]:
    return [RigPose(x, y, 5.0, theta, zoom) for x, y, theta, zoom in product(xs, ys, thetas, zooms)]


def write_grid(folder: Path, poses: Iterable[RigPose], info: GridInfo | None = None, suffix: str = ".png") -> Path:
    with GridWriter(folder, info or GridInfo(provenance="a test")) as writer:
        for number, pose in enumerate(poses):
            writer.add(frame_at(pose, number), f"images/{number:03d}{suffix}")
    return folder


def lines_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]


def write_lines(folder: Path, lines: Iterable[dict[str, Any] | str]) -> None:
    text = "".join((line if isinstance(line, str) else json.dumps(line)) + "\n" for line in lines)
    (folder / "frames.jsonl").write_text(text)
