"""From picture to answer: a rendered building is recognised through the real detector and changing internals."""

from __future__ import annotations

import numpy as np
import pytest

from recognition.geometry import wrap_deg
from recognition.modelbase_io import load_model_base
from recognition.rates import DetectionRates
from recognition.recogniser import recognise
from recognition.settings import BenchBounds, RecogniserSettings
from recognition.steps import Answer, Outcome, Step
from sim_backends.rendered_rig import RenderedRig
from sim_backends.simulate import draw_scene, rendered_rig

SETTINGS = RecogniserSettings(
    bounds=BenchBounds(distance_min_mm=60, distance_max_mm=2000, view_angle_min_deg=15, view_angle_max_deg=70),
    rates=DetectionRates(found=0.97, clutter=1.0, corner_sd_px=0.5),
)


def before_some_parts(rig: RenderedRig, rng: np.random.Generator) -> None:
    """Move to a random place that shows two parts or more."""
    poses = list(rig.reachable())
    for index in rng.permutation(len(poses)):
        whole = [p for p in rig.parts(poses[index]) if p.fully_in_frame and p.visible_fraction > 0.99]
        if len(whole) >= 2:
            rig.move_to(poses[index])
            return
    raise AssertionError("no view shows two parts")


def finish(rig: RenderedRig, name: str) -> tuple[list[Step], Answer]:
    loop = recognise(rig, load_model_base(name), SETTINGS)
    steps = []
    while True:
        try:
            steps.append(next(loop))
        except StopIteration as end:
            return steps, end.value


@pytest.mark.parametrize(
    ("models", "thing", "seed"),
    [
        ("architecture", "LH", 1),
        ("architecture", "GH", 2),
        # One of eight buildings, 1,979 windows of one class.
        ("campus", "dormitory", 1),
        ("campus", "workshop", 3),
    ],
)
def test_a_rendered_building_is_recognised_and_the_camera_placed(models: str, thing: str, seed: int) -> None:
    rig = rendered_rig(draw_scene(load_model_base(models), thing, seed), distances_mm=(150.0, 300.0), seed=seed)
    before_some_parts(rig, np.random.default_rng(seed))
    steps, answer = finish(rig, models)
    truth = rig.truth(rig.pose).camera_in_object
    assert (answer.outcome, answer.object_id) == (Outcome.RECOGNISED, thing)
    assert answer.pose is not None
    assert np.linalg.norm(answer.pose.centre_mm - truth.centre_mm) < 50.0
    assert abs(wrap_deg(answer.pose.theta_deg - truth.theta_deg)) < 5.0
    assert len(steps) <= 8
