"""Point 33: frames are exposed after settling, whatever a buffer of unknown depth holds and however late we are."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest

from calibration_free_tests.camera.emulated_bench import BLOCK_PX, Bench
from drivers.freshness import FreshnessBound
from rig.errors import HardwareError
from sim_backends.camera_emulator import CameraTiming
from sim_backends.frame_counter import read_counter

DEPTHS = range(1, 9)
EXPOSURE_PROP = 15  # cv2.CAP_PROP_EXPOSURE
AUTOMATIC_PROP = 21  # cv2.CAP_PROP_AUTO_EXPOSURE
LOCKABLE = {EXPOSURE_PROP: 80.0, AUTOMATIC_PROP: 3.0}


def timing(depth: int, keeps: Literal["oldest", "newest"] = "oldest") -> CameraTiming:
    return CameraTiming(buffer_frames=depth, exposure_s=0.012, jitter_s=0.01, keeps=keeps)


def assert_all_fresh(bench: Bench, moves: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(moves):
        shot = bench.move_and_capture(rng)
        assert not shot.stale
        # What the driver says of the exposure is a bound from below, and the rig stood still during all of it.
        assert shot.after_s < shot.picture.exposed_at_s <= shot.truth.began_s
        assert shot.truth.began_at == shot.truth.ended_at == bench.axis.pose_at(shot.got_s)


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("polls", [True, False], ids=["polled", "counted"])
def test_frames_are_exposed_after_settling(depth: int, polls: bool) -> None:
    bench = Bench(timing(depth), polls=polls, seed=depth)
    bench.camera.connect()
    assert_all_fresh(bench, 40, seed=depth)


@pytest.mark.parametrize("depth", [1, 3, 8])
@pytest.mark.parametrize("polls", [True, False], ids=["polled", "counted"])
@pytest.mark.parametrize("keeps", ["oldest", "newest"])
def test_a_computer_that_is_late_gets_no_stale_frame(
    depth: int, polls: bool, keeps: Literal["oldest", "newest"]
) -> None:
    bench = Bench(timing(depth, keeps), polls=polls, slow_host=True, seed=depth)
    bench.camera.connect()
    assert_all_fresh(bench, 40, seed=depth)


@pytest.mark.parametrize("depth", [1, 8])
def test_a_locked_exposure_saves_a_frame_and_stays_fresh(depth: int) -> None:
    waits = []
    for changes in ({}, {"exposure_s": 0.012}):
        bench = Bench(timing(depth), controls=dict(LOCKABLE), seed=depth, **changes)
        bench.camera.connect()
        rng = np.random.default_rng(7)
        shots = [bench.move_and_capture(rng) for _ in range(60)]
        assert not any(shot.stale for shot in shots)
        waits.append(np.mean([shot.got_s - shot.after_s for shot in shots]))
    assert waits[1] < waits[0] - 0.01


@pytest.mark.soak
@pytest.mark.parametrize("depth", DEPTHS)
def test_ten_thousand_moves_bring_no_stale_frame(depth: int) -> None:
    for slow_host in (False, True):
        bench = Bench(timing(depth), slow_host=slow_host, seed=depth)
        bench.camera.connect()
        assert_all_fresh(bench, 625, seed=100 + depth)


@pytest.mark.parametrize("depth", [1, 4, 8])
def test_the_emulated_buffer_catches_a_reader_that_takes_the_next_frame(depth: int) -> None:
    """The judge can say stale: a plain read after each move is old nearly always."""
    bench = Bench(timing(depth), seed=depth)
    bench.camera.connect()
    rng, stale = np.random.default_rng(0), 0
    for _ in range(50):
        bench.axis.move(float(rng.uniform(0.0, 50.0)), bench.clock.now_s(), 0.4)
        bench.clock.sleep_s(0.4)
        after_s = bench.clock.now_s()
        good, image = bench.captures[0].read()
        assert good
        assert image is not None
        stale += bench.judged(image).began_s <= after_s
    assert stale == 50


def test_a_latency_told_too_small_is_what_would_let_stale_frames_pass() -> None:
    """The one thing that the proof takes on trust, so the settings say so."""
    bench = Bench(timing(1), latency_s=0.0, exposure_s=0.001, controls=dict(LOCKABLE))
    bench.camera.connect()
    rng = np.random.default_rng(3)
    assert any(bench.move_and_capture(rng).stale for _ in range(100))


def test_a_frame_exposed_during_a_move_differs_from_a_settled_one() -> None:
    bench = Bench(CameraTiming(frame_rate_hz=10.0, exposure_s=0.1))
    bench.axis.move(15.0, 99.0, 0.05)
    bench.clock.sleep_s(0.4)
    moving, settled = bench.emulated.exposure_of(1), bench.emulated.exposure_of(2)
    assert moving.began_at.x_mm == 0.0
    assert moving.ended_at == settled.began_at
    blurred, sharp = (bench.emulated.draw(e)[20:].astype(int) for e in (moving, settled))
    assert np.abs(blurred - sharp).mean() > 10.0


def test_frames_are_numbered_and_the_newest_can_always_be_looked_at() -> None:
    bench = Bench()
    assert bench.camera.latest() is None
    bench.camera.connect()
    first = bench.camera.latest()
    later = bench.camera.capture(bench.clock.now_s())
    assert first is not None
    assert later.sequence > first.sequence
    assert bench.camera.latest() is later
    assert read_counter(later.image, BLOCK_PX) is not None


def test_no_picture_is_given_rather_than_one_that_may_be_stale() -> None:
    """Two frames a second, eight of which may have been waiting: four seconds until one is surely fresh."""
    bench = Bench(CameraTiming(frame_rate_hz=2.0), polls=False, frame_rate_hz=2.0, deadlines={"capture_s": 2.0})
    bench.camera.connect()
    start_s = bench.clock.now_s()
    with pytest.raises(HardwareError, match=r"within 2 s that was surely exposed.*too old.*latency_s"):
        bench.camera.capture(start_s)
    assert bench.clock.now_s() - start_s < 2.6


@pytest.mark.parametrize("after_s", [math.nan, math.inf, -math.inf])
def test_a_time_that_is_none_is_refused(after_s: float) -> None:
    bench = Bench()
    bench.camera.connect()
    with pytest.raises(ValueError, match="is no time"):
        bench.camera.capture(after_s)


def test_nothing_is_known_of_a_frame_until_the_buffer_was_empty_or_has_gone_round() -> None:
    bound = FreshnessBound(3, latency_s=0.5)
    assert [bound.grabbed(t, exposure_s=0.0) for t in (10.0, 11.0, 12.0)] == [-math.inf] * 3
    assert bound.grabbed(13.0, exposure_s=0.0) == 9.5
    assert bound.grabbed(14.0) == 9.5
    assert bound.grabbed(15.0) == 10.5


def test_a_frame_after_an_empty_buffer_arrived_after_that_and_the_next_was_exposed_after_that() -> None:
    bound = FreshnessBound(None, latency_s=0.5)
    bound.seen_empty(20.0)
    assert bound.grabbed(20.2) == -math.inf
    assert bound.grabbed(20.4) == 19.5
    bound.seen_empty(30.0)
    assert bound.grabbed(30.1, exposure_s=0.25) == 29.25
