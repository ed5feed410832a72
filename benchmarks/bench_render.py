"""Prints how long one rendered picture takes: median and spread over many views, clean and cluttered.

Run from the repository: ``python -m benchmarks.bench_render``. Making all wall textures
of a scene, once, is timed apart.
"""

from __future__ import annotations

import time

import numpy as np

from calibration_free_tests.renderer.bench_building import building
from recognition.geometry import Pose4, camera_in_rig
from sim_backends.appearance import Appearance
from sim_backends.clutter import draw_clutter
from sim_backends.renderer import Internals, Scene, render, visible_parts
from sim_backends.viewpoints import viewing_poses

PLACE = Pose4(7.0, 20.0, 5.0, -10.0)


def main() -> None:
    model = building()
    poses = viewing_poses(model, PLACE, (100.0, 250.0, 600.0))
    poses = [poses[i] for i in np.random.default_rng(1).permutation(len(poses))[:40]]
    clutter = draw_clutter(model, np.random.default_rng(3))
    cases = {
        "plaster": (Scene(model, PLACE), 0.0),
        "brick": (Scene(model, PLACE, Appearance(material="brick", wall_bgr=(112, 132, 172))), 0.0),
        "brick, k1": (Scene(model, PLACE, Appearance(material="brick", wall_bgr=(112, 132, 172))), -0.1),
        "clutter, reflections": (Scene(model, PLACE, Appearance(material="stone", reflections=0.5), clutter), 0.0),
    }
    print("1280 x 960, milliseconds            textures   median   90 %   worst   truth (median)")
    for name, (scene, k1) in cases.items():
        start = time.perf_counter()
        for index in range(len(scene.walls)):
            scene.texture(index)
        textures = 1e3 * (time.perf_counter() - start)
        times, truths = [], []
        for n, pose in enumerate(poses):
            camera, inner = camera_in_rig(pose), Internals(1760, 1770, 650, 470, k1)
            start = time.perf_counter()
            render(scene, camera, inner, rng=np.random.default_rng(n))
            middle = time.perf_counter()
            visible_parts(scene, camera, inner)
            times.append(1e3 * (middle - start))
            truths.append(1e3 * (time.perf_counter() - middle))
        median, high, worst = np.percentile(times[1:], [50, 90, 100])  # the first also fills caches
        print(f"{name:36s} {textures:8.0f} {median:8.0f} {high:6.0f} {worst:7.0f} {np.median(truths):10.0f}")


if __name__ == "__main__":
    main()
