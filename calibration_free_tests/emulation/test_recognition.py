"""Scan, then mock, then recognise: the same answer as recognising live on the emulated bench that was scanned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration_free_tests.emulation.sample import EXAMPLES, config
from drivers.frame_checks import BadFrameError
from recognition.geometry import CameraPose, camera_in_object, camera_in_rig, wrap_deg
from recognition.modelbase_io import load_model_base
from recognition.recogniser import recognise
from recognition.settings import RecogniserSettings
from recognition.steps import Answer, Outcome
from rig.bench import BenchConfig, load_bench, open_rig
from rig.emulation import EmulatedBench, object_view, stand_in_front
from rig.hal import Rig, RigPose
from rig.imagegrid import GridInfo, GridWriter
from rig.scan import BackgroundStore, Scan, load_plan, numbered, preflight
from sim_backends.simulated_clock import SimulatedClock

SEED = 2
START = RigPose(201.0, 161.0, 121.0, 0.0, 0.0)
CLOSE_MM, CLOSE_DEG = 2.0, 0.3
"""A hundredth of the distance to the building; the same-looking windows are 70 mm apart. The two answers come from
pictures with other noise, and, since the mock offers what was scanned only, from other views."""


def answer_on(rig: Rig, bench: BenchConfig) -> Answer:
    settings = RecogniserSettings(bounds=bench.bounds(), mount=bench.mount, rates=bench.rates, max_views=8, seed=1)
    rig.move_to(rig.nearest(START))
    loop = recognise(rig, load_model_base("architecture"), settings)
    while True:
        try:
            next(loop)
        except StopIteration as end:
            answer: Answer = end.value
            return answer


def off(pose: CameraPose | None, true: CameraPose) -> tuple[float, float]:
    """How far a pose is from another, mm and degrees."""
    assert pose is not None
    return float(np.linalg.norm(pose.centre_mm - true.centre_mm)), abs(wrap_deg(pose.theta_deg - true.theta_deg))


def test_a_scan_of_the_emulated_bench_is_recognised_like_the_bench_itself(tmp_path: Path) -> None:
    told = config()
    scene = stand_in_front(told, load_model_base("architecture"), "LH", seed=SEED)
    clock = SimulatedClock()
    bench = EmulatedBench(told, object_view(told, scene, seed=SEED), clock=clock, seed=SEED)
    plan = load_plan(EXAMPLES / "scan_emulated.yaml")
    with bench.open() as guard:
        guard.home()
        guard.reference("theta_deg", 0.0)
        preflight(guard, list(plan.poses))
        info = GridInfo(internals="fixed_by_zoom")
        with GridWriter(tmp_path / "grid", info) as writer, BackgroundStore(writer) as store:
            scan = Scan(guard, numbered(plan.poses), store, clock=clock, bad_frames=(BadFrameError,))
            assert len(list(scan)) == 27
        live = answer_on(guard, told)
        live_true = camera_in_object(camera_in_rig(bench.pose, told.mount), scene.object_in_rig)
    mock_bench = replace(load_bench(EXAMPLES / "mock_emulated.yaml"), grid=tmp_path / "grid")
    with open_rig(mock_bench) as mock:
        mocked = answer_on(mock, mock_bench)
        mocked_true = camera_in_object(camera_in_rig(mock.pose, told.mount), scene.object_in_rig)

    assert (live.outcome, live.object_id) == (Outcome.RECOGNISED, "LH")
    assert (mocked.outcome, mocked.object_id) == (live.outcome, live.object_id)
    for answer, true in ((live, live_true), (mocked, mocked_true)):
        off_mm, off_deg = off(answer.pose, true)
        assert off_mm <= CLOSE_MM
        assert off_deg <= CLOSE_DEG
    assert bench.gantry.monitor is not None
    assert bench.gantry.monitor.violations == []
