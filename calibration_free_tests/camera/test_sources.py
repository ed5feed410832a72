"""What OpenCV opens: a video file that plays like a camera, and a V4L2 device whose buffer the kernel tells about."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calibration_free_tests.camera.emulated_bench import settings
from drivers.camera_source import V4l2Source, ask_for_format, open_settings_source
from drivers.draining import InlineDrain
from drivers.opencv_camera import OpenCvCamera
from rig.devices import Identity
from rig.errors import HardwareError
from sim_backends.frame_counter import draw_counter, read_counter
from sim_backends.simulated_clock import SimulatedClock

FRAMES, RATE_HZ = 40, 20.0


@pytest.fixture
def film(tmp_path: Path) -> str:
    path, rng = tmp_path / "film.avi", np.random.default_rng(0)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, (96, 64))
    for number in range(FRAMES):
        image = rng.integers(60, 180, (64, 96, 3), dtype=np.uint8)
        draw_counter(image, number)
        writer.write(image)
    writer.release()
    return str(path)


def test_a_video_file_plays_like_a_camera_and_its_end_is_told(film: str) -> None:
    clock = SimulatedClock(50.0)
    camera = OpenCvCamera(settings(source=film, latency_s=0.0, warm_up_s=0.0), clock, drain=InlineDrain())
    assert camera.connect() == Identity("video file", "20 frames a second", film)
    played: list[int] = []

    def play() -> None:
        while True:
            after_s = clock.now_s()
            number = read_counter(camera.capture(after_s).image)
            assert number is not None
            assert 50.0 + number / RATE_HZ > after_s  # the frame was due later than it was asked for
            played.append(number)

    with pytest.raises(HardwareError, match=r"the file has ended after 40 frames"):
        play()
    assert played == sorted(set(played))
    assert played[-1] >= FRAMES - 2
    assert clock.now_s() == pytest.approx(50.0 + FRAMES / RATE_HZ, abs=0.1)


@pytest.mark.parametrize(("text", "message"), [(None, "no such file"), ("no film", "no video that OpenCV can read")])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    path = tmp_path / "film.avi"
    if text is not None:
        path.write_text(text)
    with pytest.raises(HardwareError, match=message):
        open_settings_source(settings(source=str(path)), SimulatedClock())


class Device:
    """What OpenCV's capture of a V4L2 camera does, as far as the driver uses it."""

    def __init__(self) -> None:
        self.calls: list[Any] = []
        self.ready = self.open = True

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return self.open

    def waitAny(self, streams: list[Any], timeout_ns: int) -> tuple[bool, list[int]]:  # noqa: N802 - OpenCV's name
        assert streams == [self]
        self.calls.append(("wait", timeout_ns))
        return self.ready, [0] if self.ready else []

    def grab(self) -> bool:
        self.calls.append("grab")
        return True

    def set(self, prop: int, value: float) -> bool:
        self.calls.append((prop, value))
        return True

    def release(self) -> None:
        self.calls.append("release")


def test_the_kernel_is_asked_whether_a_frame_waits_but_not_before_the_stream_runs() -> None:
    device = Device()
    source = V4l2Source(device, Identity("V4L2 camera", "", ""))
    assert source.frame_waiting(0.005) is None  # OpenCV would take a frame to start it, and then call the buffer empty
    assert source.grab()
    assert source.frame_waiting(0.005) is True
    device.ready = False
    assert source.frame_waiting(0.0) is False
    assert device.calls == ["grab", ("wait", 5_000_000), ("wait", 1_000_000)]  # 0 would wait for ever
    device.open = False
    with pytest.raises(OSError, match="closed"):  # OpenCV crashes if it is asked then
        source.frame_waiting(0.005)


def test_format_size_and_rate_are_asked_for_in_the_order_that_drivers_take() -> None:
    device = Device()
    asked = settings(pixel_format="MJPG", width_px=1280, height_px=720, frame_rate_hz=30.0)
    ask_for_format(device, asked)
    assert device.calls == [
        (cv2.CAP_PROP_FOURCC, float(cv2.VideoWriter.fourcc(*"MJPG"))),
        (cv2.CAP_PROP_FRAME_WIDTH, 1280.0),
        (cv2.CAP_PROP_FRAME_HEIGHT, 720.0),
        (cv2.CAP_PROP_FPS, 30.0),
    ]
