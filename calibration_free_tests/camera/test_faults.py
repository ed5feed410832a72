"""Frozen, black, over-exposed, wrongly sized: found and named; unplugged or hanging: told in time, closed cleanly."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from calibration_free_tests.camera.emulated_bench import Bench, settings
from drivers.camera_settings import PictureLimits
from drivers.draining import ThreadDrain
from drivers.frame_checks import BadFrameError, PictureFault, RepeatWatch, faults_of, look_at
from drivers.opencv_camera import OpenCvCamera
from rig.devices import Identity
from rig.errors import HardwareError
from rig.hal import Image
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.emulated_capture import EmulatedCapture
from sim_backends.simulated_clock import SimulatedClock

FAULTY = {
    CameraFaultKind.FREEZE: PictureFault.FROZEN,
    CameraFaultKind.BLACK: PictureFault.BLACK,
    CameraFaultKind.OVER_EXPOSED: PictureFault.OVER_EXPOSED,
    CameraFaultKind.WRONG_SIZE: PictureFault.WRONG_SIZE,
}


def connected(*faults: CameraFault, **changes: Any) -> Bench:
    bench = Bench(faults=faults, **changes)
    bench.camera.connect()
    return bench


def broken(kind: CameraFaultKind, bench: Bench, seconds: float = 0.0) -> None:
    bench.emulated.faults.append(CameraFault(kind, bench.clock.now_s(), seconds))


@pytest.mark.parametrize("kind", FAULTY, ids=lambda kind: kind.value)
def test_a_camera_with_faulty_pictures_is_refused_and_the_fault_named(kind: CameraFaultKind) -> None:
    bench = connected()
    broken(kind, bench)
    start_s = bench.clock.now_s()
    with pytest.raises(BadFrameError, match=FAULTY[kind].value) as caught:
        bench.camera.capture(start_s)
    assert caught.value.faults[0] is FAULTY[kind]
    assert isinstance(caught.value, HardwareError)
    assert bench.clock.now_s() - start_s < 1.0


def test_a_camera_that_comes_back_with_another_size_is_refused_whatever_size_the_bench_allows() -> None:
    bench = connected()
    bench.camera.close()
    broken(CameraFaultKind.WRONG_SIZE, bench, seconds=5.0)
    with pytest.raises(HardwareError, match=r"gives 32x24 pixels, not 64x48 as before"):
        bench.camera.connect()
    bench.clock.sleep_s(5.0)
    bench.camera.connect()
    assert bench.move_and_capture(np.random.default_rng(3)).picture.image.shape == (48, 64, 3)


@pytest.mark.parametrize("kind", FAULTY, ids=lambda kind: kind.value)
def test_a_fault_that_passes_costs_a_moment_and_never_a_bad_picture(kind: CameraFaultKind) -> None:
    bench = connected()
    broken(kind, bench, seconds=0.15)
    shot = bench.move_and_capture(np.random.default_rng(1))
    assert not shot.stale
    assert not shot.truth.faults


def test_dropped_frames_cost_time_and_nothing_else() -> None:
    bench = connected()
    rng = np.random.default_rng(2)
    for _ in range(20):
        bench.emulated.faults[:] = [CameraFault(CameraFaultKind.DROPPED, bench.clock.now_s() + 0.3, 0.3)]
        assert not bench.move_and_capture(rng).stale


def test_a_bench_can_allow_dark_pictures() -> None:
    bench = connected(limits={"allow": ("black",)})
    broken(CameraFaultKind.BLACK, bench)
    assert bench.camera.capture(bench.clock.now_s()).image.max() < 24


def test_checks_find_every_fault_and_stop_nothing_sound() -> None:
    """Short form of ``benchmarks/bench_camera.py``, on small pictures of a moving axis."""
    faults = [CameraFault(kind, 102.0 + 4.0 * n, 2.0) for n, kind in enumerate([*FAULTY] * 3)]
    bench, limits, watch = Bench(faults=faults), PictureLimits(), RepeatWatch()
    capture = EmulatedCapture(bench.emulated, bench.clock)
    bench.axis.move(500.0, 100.0, 60.0)
    judged = []
    while bench.clock.now_s() < 150.0:
        image = capture.read()[1]
        assert image is not None
        assert capture.grabbed is not None
        found = faults_of(look_at(image, limits), limits, size=(64, 48), repeats=watch.repeats(image))
        judged.append((frozenset(FAULTY[kind] for kind in capture.grabbed.faults), frozenset(found)))
    assert [pair for pair in judged if pair[0] != pair[1]] == []
    counts = Counter(truth for truth, _ in judged)
    assert counts[frozenset()] > 700
    assert all(counts[frozenset({fault})] > 170 for fault in FAULTY.values())


def test_a_ring_of_old_buffers_is_a_frozen_camera_too() -> None:
    rng, watch = np.random.default_rng(0), RepeatWatch()
    ring = [rng.integers(0, 256, (48, 64, 3), dtype=np.uint8) for _ in range(4)]
    assert [watch.repeats(image) for image in ring] == [False] * 4
    assert all(watch.repeats(image) for image in ring * 3)
    ring[0][20, 30, 1] ^= 1
    assert not watch.repeats(ring[0])


def test_sharpness_is_told_and_falls_with_blur() -> None:
    sharp = np.random.default_rng(0).integers(60, 200, (240, 320, 3), dtype=np.uint8)
    limits = PictureLimits()
    told = [look_at(cv2.GaussianBlur(sharp, (0, 0), blur) if blur else sharp, limits) for blur in (0.0, 1.0, 3.0)]
    assert told[0].sharpness > 3.0 * told[1].sharpness > 9.0 * told[2].sharpness
    assert all(not faults_of(look, limits, size=None, repeats=False) for look in told)
    grey = look_at(sharp[..., 0], limits)
    assert grey.size == (320, 240)


# --- gone, and hanging ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "unplugged",
    [None, OSError(19, "No such device"), cv2.error("select() failed")],
    ids=["reads fail", "OSError", "cv2.error"],
)
@pytest.mark.parametrize("polls", [True, False], ids=["polled", "counted"])
def test_unplugging_during_a_capture_is_noticed_within_a_second(unplugged: Exception | None, polls: bool) -> None:
    bench = connected(unplugged=unplugged, polls=polls)
    at_s = bench.clock.now_s() + 0.05
    bench.emulated.faults.append(CameraFault(CameraFaultKind.UNPLUG, at_s, 3.0))
    with pytest.raises(HardwareError, match=r"every read has failed.*[Cc]onnect again"):
        bench.camera.capture(at_s)
    assert bench.clock.now_s() - at_s < 1.0
    assert not bench.captures[0].isOpened()
    bench.clock.sleep_s(5.0)
    with pytest.raises(HardwareError, match="connect again"):  # plugged in again, it resumes nothing by itself
        bench.camera.capture(bench.clock.now_s())
    bench.camera.connect()
    assert not bench.move_and_capture(np.random.default_rng(0)).stale
    assert [capture.isOpened() for capture in bench.captures] == [False, True]


def test_connecting_to_a_camera_that_is_not_there_says_so() -> None:
    bench = Bench(faults=[CameraFault(CameraFaultKind.UNPLUG, 0.0)])
    with pytest.raises(HardwareError, match="no such camera"):
        bench.camera.connect()
    with pytest.raises(HardwareError, match="not connected"):
        bench.camera.capture(bench.clock.now_s())


def test_a_camera_that_gives_nothing_is_closed_again() -> None:
    bench = Bench(faults=[CameraFault(CameraFaultKind.HANG, 0.0)])
    start_s = bench.clock.now_s()
    with pytest.raises(HardwareError, match="first picture has not come"):
        bench.camera.connect()
    assert bench.clock.now_s() - start_s < 11.0
    assert not bench.captures[0].isOpened()
    assert bench.camera.latest() is None


def test_a_hanging_camera_ends_a_capture_within_a_second() -> None:
    bench = connected()
    broken(CameraFaultKind.HANG, bench)
    start_s = bench.clock.now_s()
    with pytest.raises(HardwareError, match=r"no frame for .* hangs"):
        bench.camera.capture(start_s)
    assert bench.clock.now_s() - start_s < 1.0


def test_an_error_that_nobody_expected_ends_the_draining_and_is_told() -> None:
    bench = connected()

    def grab() -> bool:
        raise ZeroDivisionError("a bug in a camera's driver")

    bench.captures[0].grab = grab  # type: ignore[method-assign]  # the fault that is planted
    with pytest.raises(HardwareError, match=r"ZeroDivisionError: a bug in a camera's driver.*connect again"):
        bench.camera.capture(bench.clock.now_s())
    assert not bench.captures[0].isOpened()
    bench.camera.connect()
    assert not bench.move_and_capture(np.random.default_rng(0)).stale


class Stuck:
    """A source that gives noise, until a read is told to hang in the kernel; simulated time knows nothing of it."""

    identity = Identity("stuck", "", "nowhere")
    bounded_buffer = True

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock, self.hang, self.hung, self.free = clock, threading.Event(), threading.Event(), threading.Event()
        self.released, self.frames = threading.Event(), 0

    def frame_waiting(self, timeout_s: float) -> bool | None:
        return None

    def grab(self) -> bool:
        if self.hang.is_set():
            self.hung.set()
            self.free.wait(30.0)
        self.frames += 1
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        return True, np.random.default_rng(self.frames).integers(80, 160, (48, 64, 3), dtype=np.uint8)

    def set(self, prop: int, value: float) -> bool:
        return False

    def get(self, prop: int) -> float:
        return 0.0

    def release(self) -> None:
        self.released.set()


class Yielding(SimulatedClock):
    """Simulated time that also lets the draining thread run."""

    def sleep_s(self, seconds: float) -> None:
        super().sleep_s(seconds)
        time.sleep(0)


def stuck() -> tuple[Stuck, OpenCvCamera, Yielding]:
    clock = Yielding(10.0)
    source = Stuck(clock)
    camera = OpenCvCamera(
        settings(warm_up_s=0.0, deadlines={"connect_s": 1e6, "silence_s": 1e6, "capture_s": 2.0}),
        clock,
        open_source=_opening(source),
        drain=ThreadDrain(clock),
    )
    camera.connect()
    return source, camera, clock


def _opening(source: Stuck) -> Callable[..., Any]:
    return lambda _settings, _clock: source


def test_a_read_that_hangs_blocks_no_capture_beyond_its_deadline_and_no_close() -> None:
    source, camera, clock = stuck()
    source.hang.set()
    assert source.hung.wait(10.0)
    start_s = clock.now_s()
    with pytest.raises(HardwareError, match="no picture within 2 s"):
        camera.capture(start_s)
    assert clock.now_s() - start_s < 2.1
    began = time.monotonic()
    camera.close()
    assert time.monotonic() - began < 1.0
    assert not source.released.is_set()  # nobody pulls a buffer away under a read
    source.free.set()
    assert source.released.wait(10.0)


def test_closing_twice_is_safe_and_ends_the_thread() -> None:
    source, camera, _ = stuck()
    camera.close()
    camera.close()
    assert source.released.is_set()
    assert not [thread for thread in threading.enumerate() if thread.name == "camera drain"]
