"""A Motion-JPEG stream is really read over the loopback interface, and nothing else is ever served or followed."""

from __future__ import annotations

import inspect
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration_free_tests.camera.emulated_bench import Axis, settings, striped
from drivers.http_camera import HttpSource
from drivers.mjpeg import MultipartParser, StreamError, decode_jpeg, jpeg_end, jpeg_size
from drivers.opencv_camera import OpenCvCamera
from rig.errors import HardwareError
from rig.hal import Image, RigPose
from sim_backends.camera_emulator import CameraTiming, EmulatedCamera
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.frame_counter import read_counter
from sim_backends.mjpeg_server import LOOPBACK, MjpegServer

FAST = CameraTiming(frame_rate_hz=50.0, exposure_s=0.005, readout_s=0.005)


class RealClock:
    def now_s(self) -> float:
        return time.monotonic()

    def sleep_s(self, seconds: float) -> None:
        time.sleep(seconds)


CLOCK = RealClock()


@contextmanager
def served(faults: list[CameraFault] | None = None) -> Iterator[tuple[EmulatedCamera, MjpegServer]]:
    camera = EmulatedCamera(
        Axis().pose_at, striped, FAST, faults=faults or [], counter_px=6, start_s=CLOCK.now_s(), noise_sd=4.0
    )
    with MjpegServer(camera, CLOCK) as server:
        yield camera, server


def connected(url: str, **changes: object) -> OpenCvCamera:
    # A busy computer sends late: this is about the wire, the age is judged on simulated time.
    told = {"latency_s": 0.3, "warm_up_s": 0.0, "deadlines": {"silence_s": 5.0}} | changes
    camera = OpenCvCamera(settings(source=url, **told), CLOCK)
    camera.connect()
    return camera


def test_a_stream_over_loopback_is_read_and_its_frames_are_fresh() -> None:
    with served() as (emulated, server):
        camera = connected(server.url)
        try:
            for _ in range(2):
                after_s = CLOCK.now_s()
                picture = camera.capture(after_s)
                counter = read_counter(picture.image, 6)
                assert counter is not None
                assert emulated.exposure_of(counter).began_s > after_s
            assert camera.size == (64, 48)
        finally:
            camera.close()


def test_other_programs_can_read_the_emulated_stream() -> None:
    with served() as (_, server):
        capture = cv2.VideoCapture(server.url, cv2.CAP_FFMPEG)
        counters = [read_counter(capture.read()[1], 6) for _ in range(3)]
        capture.release()
    assert all(counter is not None for counter in counters)
    assert counters == sorted(set(counters), key=lambda n: n or 0)


def test_the_emulated_stream_is_for_this_computer_only() -> None:
    assert not {"host", "address", "interface", "bind"} & set(inspect.signature(MjpegServer).parameters)
    with served() as (_, server):
        assert server.address[0] == LOOPBACK == "127.0.0.1"
        assert _ask(server, Host="cameras.example").startswith(b"HTTP/1.0 403")
        assert _ask(server, path="/elsewhere", Host="localhost").startswith(b"HTTP/1.0 404")


@pytest.mark.timeout(30)
def test_a_picture_that_takes_long_to_draw_makes_frames_fewer_but_not_older() -> None:
    def slow(pose: RigPose) -> Image:
        time.sleep(0.05)  # as a large scene does, in real time: two and a half frames
        return striped(pose)

    deep = replace(FAST, buffer_frames=8)
    camera = EmulatedCamera(Axis().pose_at, slow, deep, counter_px=6, start_s=CLOCK.now_s())
    with MjpegServer(camera, CLOCK, on_time_s=0.2) as server:
        number, ages_s = 0, []
        for _ in range(12):
            following = server.next_frame(number)
            assert following is not None
            number, frame = following
            image = decode_jpeg(frame)
            assert image is not None
            counter = read_counter(image, 6)
            assert counter is not None
            ages_s.append(CLOCK.now_s() - camera.exposure_of(counter).arrives_s)
    assert max(ages_s) < 0.5


def test_an_unplugged_camera_ends_its_stream_and_is_noticed_within_a_second() -> None:
    with served() as (emulated, server):
        camera = connected(server.url)
        start_s = CLOCK.now_s()
        emulated.faults.append(CameraFault(CameraFaultKind.UNPLUG, start_s, 0.0))
        with pytest.raises(HardwareError, match=r"stream has ended.*connect again"):
            camera.capture(start_s)
        assert CLOCK.now_s() - start_s < 1.0
        camera.close()
        with pytest.raises(HardwareError, match=r"503"):
            connected(server.url)


def _ask(server: MjpegServer, path: str = "/stream.mjpg", **headers: str) -> bytes:
    with socket.create_connection(server.address) as connection:
        lines = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
        connection.sendall(f"GET {path} HTTP/1.0\r\n{lines}\r\n".encode())
        return connection.makefile("rb").read()


@contextmanager
def answering(answer: bytes | Callable[[socket.socket], None]) -> Iterator[str]:
    """A server that answers one request with the given bytes and then says nothing."""
    with socket.create_server((LOOPBACK, 0)) as listener:
        done = threading.Event()

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.recv(4096)
                if isinstance(answer, bytes):
                    connection.sendall(answer)
                else:
                    answer(connection)
                done.wait(5.0)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield f"http://{LOOPBACK}:{listener.getsockname()[1]}/"
        finally:
            done.set()
            thread.join()


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (b"HTTP/1.0 302 Found\r\nLocation: http://elsewhere.example/\r\n\r\n", r"302 Found \(to .* not followed\)"),
        (b"HTTP/1.0 401 Unauthorized\r\n\r\n", r"401 Unauthorized"),
        (b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n<html>", r"sends text/html, no Motion-JPEG stream"),
        (b"SSH-2.0-OpenSSH_9.6\r\n\r\n", r"does not speak HTTP"),
        (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", r"in chunks"),
        (b"HTTP/1.0 200 OK\r\n" + b"X: y\r\n" * 200 + b"\r\n", r"does not speak HTTP: got more than 100 headers"),
    ],
)
def test_what_is_no_stream_is_refused_and_redirections_are_not_followed(answer: bytes, message: str) -> None:
    with answering(answer) as url, pytest.raises(HardwareError, match=message):
        connected(url)


def test_an_answer_that_trickles_in_does_not_hold_up_connecting_beyond_its_deadline() -> None:
    def trickle(connection: socket.socket) -> None:
        with suppress(OSError):
            for _ in range(60):
                connection.sendall(b"H")
                time.sleep(0.05)

    start_s = CLOCK.now_s()
    with answering(trickle) as url:
        with pytest.raises(HardwareError, match=r"no whole answer within 0.3 s.*Check"):
            connected(url, deadlines={"connect_s": 0.3})
        assert CLOCK.now_s() - start_s < 1.0


def test_a_stream_that_announces_what_cannot_be_ends_and_says_so() -> None:
    head = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=cam\r\n\r\n"
    broken = b"--cam\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n"
    whole = head + part(jpeg(), length=True) * 8 + broken
    with answering(whole) as url, pytest.raises(HardwareError, match="announced"):
        connected(url, warm_up_s=5.0)


def test_a_stream_that_stalls_half_way_through_a_frame_blocks_neither_connect_nor_close() -> None:
    head = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=x\r\n\r\n"
    start_s = CLOCK.now_s()
    with answering(head + b"--x\r\nContent-Length: 5000\r\n\r\nhalf") as url:
        with pytest.raises(HardwareError, match=r"has not come after|every read has failed"):
            connected(url, deadlines={"connect_s": 0.3})
        assert CLOCK.now_s() - start_s < 1.5


def test_a_stream_is_empty_when_it_is_quiet_but_not_amid_a_frame() -> None:
    head = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=cam\r\n\r\n"
    with answering(head + part(jpeg(), length=True)) as url:
        source = HttpSource(url, 1.0, CLOCK)
        while not source.frame_waiting(0.05):
            pass
        assert source.grab()
        assert source.frame_waiting(0.005) is False
        source.release()
    with answering(head + part(jpeg(), length=True) + part(jpeg(), length=True)[:-50]) as url:
        source = HttpSource(url, 1.0, CLOCK)
        while not source.frame_waiting(0.05):
            pass
        assert source.grab()
        for _ in range(3):
            waiting = source.frame_waiting(0.02)
        assert waiting is None
        source.release()


# --- taking the stream apart ----------------------------------------------------------------------------------------


def jpeg(seed: int = 0) -> bytes:
    image = np.random.default_rng(seed).integers(0, 256, (24, 40, 3), dtype=np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def part(body: bytes, length: bool, boundary: bytes = b"--cam") -> bytes:
    head = b"Content-Length: %d\r\n" % len(body) if length else b""
    return boundary + b"\r\nContent-Type: image/jpeg\r\n" + head + b"\r\n" + body + b"\r\n"


@pytest.mark.parametrize("length", [True, False], ids=["with length", "without length"])
@pytest.mark.parametrize("step", [1, 7, 1000, 100_000])
def test_frames_come_out_whole_however_the_bytes_are_cut(length: bool, step: int) -> None:
    frames = [jpeg(seed) for seed in range(4)]
    stream = b"".join(part(frame, length) for frame in frames)
    parser, found = MultipartParser("--cam"), []
    for at in range(0, len(stream), step):
        found += parser.feed(stream[at : at + step])
    assert found == frames
    assert not parser.amid_part


def test_a_frame_without_length_is_complete_before_the_next_boundary_comes() -> None:
    parser = MultipartParser("cam")
    whole = part(jpeg(), length=False).removesuffix(b"\r\n")
    assert parser.feed(whole[:-1]) == []
    assert parser.amid_part
    assert parser.feed(whole[-1:]) == [jpeg()]
    assert not parser.amid_part


def test_a_part_larger_than_any_picture_is_refused() -> None:
    with pytest.raises(StreamError, match="announced"):
        MultipartParser("cam").feed(b"--cam\r\nContent-Length: 99999999999\r\n\r\n")
    with pytest.raises(StreamError, match="announced"):
        MultipartParser("cam").feed(b"--cam\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n")
    with pytest.raises(StreamError, match="no part"):
        MultipartParser("cam").feed(b"x" * 100_000)


def test_a_length_that_is_no_number_is_taken_for_none() -> None:
    whole = part(jpeg(), length=True)
    for told in (b"\xff5", b"-5", b"5 bytes", "٥".encode()):
        stream = re.sub(rb"Content-Length: \d+", b"Content-Length: " + told, whole)
        assert MultipartParser("cam").feed(stream) == [jpeg()]


def test_a_damaged_picture_is_none() -> None:
    whole = jpeg()
    decoded = decode_jpeg(whole)
    assert decoded is not None
    assert decoded.shape == (24, 40, 3)
    assert jpeg_size(whole) == (40, 24)
    assert jpeg_end(whole) == len(whole)
    assert decode_jpeg(whole[:-20]) is None
    assert decode_jpeg(b"no picture") is None
    height_at = whole.index(b"\xff\xc0") + 5
    huge = whole[:height_at] + b"\xff\xff\xff\xff" + whole[height_at + 4 :]
    assert jpeg_size(huge) == (65535, 65535)
    assert decode_jpeg(huge) is None
