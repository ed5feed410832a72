"""Scan, then mock, then recognise: the same answer as recognising live on the rig that was scanned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.scan.sample import FakeClock
from recognition.modelbase_io import load_model_base
from recognition.recogniser import recognise
from recognition.settings import BenchBounds, RecogniserSettings
from recognition.steps import Answer, Outcome, Step
from rig.bench import BenchConfig, BenchFile, open_rig
from rig.demo import CLEAN_BENCH
from rig.hal import Rig, RigPose
from rig.imagegrid import GridInfo, GridWriter
from rig.scan import BackgroundStore, Scan, numbered, preflight
from sim_backends.internals_policy import ChangingInternals, FixedByZoom
from sim_backends.rendered_rig import RenderedRig
from sim_backends.simulate import draw_scene, rendered_rig

SEED = 1


@pytest.fixture(scope="module")
def live() -> RenderedRig:
    """A building as in the demonstration, looked at from some thirty places along one side."""
    scene = draw_scene(load_model_base("architecture"), "LH", SEED)
    internals = ChangingInternals(FixedByZoom(), f_sd=0.03, centre_sd_px=15.0)
    everywhere = rendered_rig(scene, zooms=(0.0,), internals=internals, seed=SEED)
    shows = [pose for pose in everywhere.reachable() if len(whole_parts(everywhere, pose)) >= 2]
    near = sorted(shows, key=lambda pose: everywhere.travel_s(shows[0], pose))[:30]
    return rendered_rig(scene, offers=near, internals=internals, seed=SEED)


def whole_parts(rig: RenderedRig, pose: RigPose) -> list[str]:
    return [part.id for part in rig.parts(pose) if part.fully_in_frame and part.visible_fraction > 0.99]


def bench_like(rig: RenderedRig) -> BenchConfig:
    """The demonstration's bench, with the limits and speeds of the rig that was scanned."""
    limits = rig.limits
    unit = {"x_mm": "mm_", "y_mm": "mm_", "z_mm": "mm_", "theta_deg": "deg_", "zoom": ""}
    axes = {
        axis: {
            "lower": getattr(limits, axis).lower,
            "upper": getattr(limits, axis).upper,
            f"speed_{of}per_s": getattr(limits, axis).speed_per_s,
        }
        for axis, of in unit.items()
    }
    timing = {"settle_s": limits.settle_s, "exposure_s": limits.exposure_s}
    return BenchConfig("scanned", BenchFile.model_validate({**CLEAN_BENCH, "axes": axes, "timing": timing}))


def answer_on(rig: Rig, start: RigPose) -> tuple[list[Step], Answer]:
    bounds = BenchBounds(distance_min_mm=60, distance_max_mm=2000, view_angle_min_deg=15, view_angle_max_deg=70)
    rig.move_to(rig.nearest(start))
    loop = recognise(rig, load_model_base("architecture"), RecogniserSettings(bounds=bounds, max_views=8))
    steps = []
    while True:
        try:
            steps.append(next(loop))
        except StopIteration as end:
            return steps, end.value


def test_a_scan_is_recognised_like_the_rig_that_was_scanned(tmp_path: Path, live: RenderedRig) -> None:
    poses = list(live.reachable())
    preflight(live, poses)
    info = GridInfo(internals="change_every_view")
    with GridWriter(tmp_path / "grid", info) as writer, BackgroundStore(writer) as store:
        frames = list(Scan(live, numbered(poses), store, clock=FakeClock()))
    assert [frame.pose for frame in frames] == poses

    seen, told = answer_on(live, poses[0])
    with open_rig(bench_like(live), tmp_path / "grid") as mock:
        seen_there, told_there = answer_on(mock, poses[0])
    assert len(seen) > 1
    assert told.outcome is Outcome.RECOGNISED
    assert told.object_id == "LH"
    assert [step.frame.rig_pose for step in seen_there] == [step.frame.rig_pose for step in seen]
    for step, there in zip(seen, seen_there, strict=True):
        assert np.array_equal(step.frame.image, there.frame.image)
    assert (told_there.outcome, told_there.object_id) == (told.outcome, told.object_id)
    assert told.pose is not None
    assert told_there.pose == told.pose
