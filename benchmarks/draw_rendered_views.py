"""Draws docs/pictures/rendered_views.jpg: six views of the renderer, clean and cluttered.

Run from the repository: ``python -m benchmarks.draw_rendered_views [FILE]``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from calibration_free_tests.renderer.bench_building import building, camera_at
from recognition.geometry import Pose4
from sim_backends.appearance import Appearance
from sim_backends.clutter import draw_clutter
from sim_backends.renderer import Internals, Scene, render

ROOT = Path(__file__).resolve().parents[1]
PLACE = Pose4(7.0, 20.0, 5.0, -10.0)
BRICK = Appearance(seed=3, material="brick", wall_bgr=(112, 132, 172))
STONE = Appearance(seed=5, material="stone", reflections=0.6)
PLASTER = Appearance(seed=8, wall_bgr=(150, 182, 200), sun=(0.9, -0.6, -0.3))
# Theta, x, y, z of the camera in the object frame, the focal length, and the radial term.
VIEWS = (
    (BRICK, False, (0, 0, -150, -400), 1760, 0.0),
    (STONE, True, (40, 600, -140, -330), 1500, 0.0),
    (PLASTER, False, (20, 60, -170, -160), 1760, 0.0),
    (BRICK, True, (-35, -420, -140, -260), 1760, 0.0),
    (PLASTER, True, (30, 150, -100, -300), 1400, 0.0),
    (STONE, False, (-50, -420, -150, -150), 1100, -0.15),
)


def main() -> None:
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures" / "rendered_views.jpg"
    model = building()
    clutter = draw_clutter(model, np.random.default_rng(3))
    tiles = []
    for look, cluttered, place, f, k1 in VIEWS:
        scene = Scene(model, PLACE, look, clutter if cluttered else ())
        inner = Internals(f, f, 640, 480, k1)
        picture = render(scene, camera_at(*place, PLACE), inner, rng=np.random.default_rng(1))
        tiles.append(cv2.resize(picture, (480, 360), interpolation=cv2.INTER_AREA))
    sheet = np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])])
    target.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(target), sheet, [cv2.IMWRITE_JPEG_QUALITY, 82]):
        raise SystemExit(f"cannot write {target}")
    print(f"{target} ({target.stat().st_size / 1024:.0f} KB)")


if __name__ == "__main__":
    main()
