"""Recognising through a camera that hangs askew: right where the bench file tells how it hangs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recognition.geometry import Mount, wrap_deg
from recognition.modelbase_io import load_model_base
from recognition.recogniser import recognise
from recognition.settings import RecogniserSettings
from recognition.steps import Answer, Outcome, Step
from rig.bench import load_bench, open_rig
from rig.cli.recognising import on_bench
from rig.hal import RigPose
from sim_backends.rendered_rig import RenderedRig
from sim_backends.simulate import draw_scene, rendered_rig, simulate

HUNG = Mount(x_mm=12.0, z_mm=45.0, pan_zero_deg=4.0, roll_deg=1.0, pitch_deg=-0.6)
TOLD = "mount: {x_mm: 12, z_mm: 45, pan_zero_deg: 4, roll_deg: 1, pitch_deg: -0.6}\n"
BENCH = """\
schema: 1
kind: mock
grid: grid
camera: {internals: fixed_by_zoom, view_angle_deg: [15, 60]}
object: {distance_mm: [60, 2000]}
detection: {found: 0.97, clutter: 5, corner_sd_px: 0.5}
"""
MODELS = load_model_base("architecture")


@pytest.fixture(scope="module")
def rendered() -> RenderedRig:
    return rendered_rig(draw_scene(MODELS, "LH", 1), distances_mm=(150.0, 300.0), mount=HUNG, seed=1)


@pytest.fixture(scope="module")
def folder(rendered: RenderedRig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A grid of the views around one that shows two parts or more."""
    poses = list(rendered.reachable())
    rng = np.random.default_rng(1)
    for index in rng.permutation(len(poses)):
        if sum(part.fully_in_frame and part.visible_fraction > 0.99 for part in rendered.parts(poses[index])) >= 2:
            break
    start = poses[index]
    poses.sort(key=lambda pose: rendered.travel_s(start, pose))
    made = tmp_path_factory.mktemp("bench")
    simulate(rendered, poses[:30], made / "grid", quality=93)
    return made


def answer_on(folder: Path, text: str) -> tuple[Answer, RigPose]:
    path = folder / "bench.yaml"
    path.write_text(text)
    bench = load_bench(path)
    with open_rig(bench) as rig:
        loop, last = recognise(rig, MODELS, on_bench(RecogniserSettings(), bench)), rig.pose
        while True:
            try:
                step: Step = next(loop)
                last = step.frame.rig_pose
            except StopIteration as end:
                return end.value, last


def gap(rendered: RenderedRig, answer: Answer, last: RigPose) -> tuple[float, float]:
    true, found = rendered.truth(last).camera_in_object, answer.pose
    assert found is not None
    return float(np.linalg.norm(found.centre_mm - true.centre_mm)), abs(wrap_deg(found.theta_deg - true.theta_deg))


def test_the_place_is_right_where_the_bench_tells_the_mount(rendered: RenderedRig, folder: Path) -> None:
    answer, last = answer_on(folder, BENCH + TOLD)
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, "LH")
    off_mm, off_deg = gap(rendered, answer, last)
    assert off_mm < 2.0
    assert off_deg < 0.2


def test_the_place_is_not_found_where_it_does_not(rendered: RenderedRig, folder: Path) -> None:
    answer, last = answer_on(folder, BENCH)
    assert answer.pose is None or gap(rendered, answer, last)[0] > 10.0
