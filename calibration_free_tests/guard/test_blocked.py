"""STOP on a real pseudo-terminal, past a full planner, a blocked camera and a disk that does not come back.

How quick it is, benchmarks/bench_stop.py measures on an idle machine; here is only that it happens.
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from calibration_free_tests.gantry.simulated_bench import BOTH, name_of
from calibration_free_tests.guard.real_time import AT_ONCE_S, StopBench, motion_after_kill
from rig.guard import State
from sim_backends.grbl_emulator.dialects import Dialect


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_stop_goes_out_past_a_full_planner_and_a_blocked_disk(tmp_path: Path, dialect: Dialect) -> None:  # 19
    with StopBench(tmp_path, dialect) as bench:
        move = bench.moving(200.0, more=15)
        with bench.storing():
            latency_s, report = bench.stop()
            assert math.isfinite(latency_s)
            assert report.confirmed
            assert "STOP could not be latched for other processes" in report.trouble
            assert bench.guard.state is State.STOPPED
            move.join(AT_ONCE_S)
            assert not move.is_alive()
        assert not bench.machine.planner.running
        assert 0.0 < bench.machine.planner.position[0] < 200.0


def test_stop_goes_out_past_a_blocked_camera(tmp_path: Path) -> None:  # 19
    with StopBench(tmp_path) as bench:
        with bench.photographing():
            latency_s, report = bench.stop()
            assert math.isfinite(latency_s)
            assert report.confirmed
            assert "a capture" in bench.guard.running
        assert bench.guard.state is State.STOPPED


def test_a_process_that_is_killed_while_it_jogs_leaves_little_motion() -> None:  # 18
    _, went_mm = motion_after_kill(0.3)
    assert went_mm < 40.0
