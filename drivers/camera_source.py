"""Opens what frames come from: a V4L2 camera, a video file, or a Motion-JPEG stream over HTTP.

A source is shaped like OpenCV's VideoCapture, and can also say whether a frame is waiting, which is what the proof that
a picture is fresh rests on (decision 0052).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drivers.camera_identity import FoundCamera, find_camera, refuse_inaccessible
from drivers.camera_settings import CameraSettings
from drivers.port_lock import PortLock, lock_port
from rig.devices import Clock, Identity
from rig.errors import HardwareError
from rig.hal import Image


class SourceEndedError(OSError):
    """There will be no more frames."""


class CameraSource(Protocol):
    """An open camera. One thread at a time."""

    @property
    def identity(self) -> Identity:
        """What was opened."""
        ...

    @property
    def bounded_buffer(self) -> bool:
        """Never more than `CameraSettings.buffer_frames` frames lie between camera and reader."""
        ...

    def frame_waiting(self, timeout_s: float) -> bool | None:
        """Wait for a frame.

        Returns:
            True: one can be grabbed now. False: when this was called, nothing of the next frame had arrived, nor has
            a whole one since. None: it cannot be told; a grab may wait.
        """
        ...

    def grab(self) -> bool:
        """Take the next frame, waiting for it; False: there was none."""
        ...

    def retrieve(self) -> tuple[bool, Image | None]:
        """Decode the frame that was grabbed; False: it is damaged."""
        ...

    def set(self, prop: int, value: float) -> bool:
        """Set one of OpenCV's properties; False: refused."""
        ...

    def get(self, prop: int) -> float:
        """Read one of OpenCV's properties; 0 or -1: there is none."""
        ...

    def release(self) -> None:
        """Close it. Safe to call twice."""
        ...


class _Capture:
    """What the sources on OpenCV's VideoCapture have in common."""

    def __init__(self, capture: Any, identity: Identity) -> None:
        self._capture, self.identity = capture, identity

    def retrieve(self) -> tuple[bool, Image | None]:
        """Decode the frame that was grabbed."""
        good, image = self._capture.retrieve()
        return bool(good), None if image is None else np.asarray(image, dtype=np.uint8)

    def set(self, prop: int, value: float) -> bool:
        """Set a property."""
        return bool(self._capture.set(prop, value))

    def get(self, prop: int) -> float:
        """Read a property."""
        return float(self._capture.get(prop))

    def release(self) -> None:
        """Close it."""
        self._capture.release()


class V4l2Source(_Capture):
    """A camera of this computer. The kernel says whether a frame is waiting."""

    bounded_buffer = True

    def __init__(self, capture: Any, identity: Identity, lock: PortLock | None = None) -> None:
        super().__init__(capture, identity)
        self._lock, self._streaming = lock, False

    def frame_waiting(self, timeout_s: float) -> bool | None:
        """Poll the device; OpenCV takes whole milliseconds, and 0 for ever."""
        if not self._streaming:
            return None  # OpenCV's poll starts the stream by taking a frame, and would then call the buffer empty
        if not self._capture.isOpened():
            raise OSError("the device is closed")  # OpenCV's poll crashes on what is not open
        ready, _ = self._capture.waitAny([self._capture], max(1_000_000, int(timeout_s * 1e9)))
        return bool(ready)

    def grab(self) -> bool:
        """Take the next frame; the first one starts the stream."""
        self._streaming = bool(self._capture.grab())
        return self._streaming

    def release(self) -> None:
        """Close it and give the lock back."""
        super().release()
        if self._lock is not None:
            self._lock.release()


class FileSource(_Capture):
    """A video file that plays like a camera: each frame comes when it is due, and the end is the end."""

    bounded_buffer = True

    def __init__(self, capture: Any, identity: Identity, clock: Clock, frame_rate_hz: float) -> None:
        super().__init__(capture, identity)
        self._clock, self._period_s, self._frames = clock, 1.0 / frame_rate_hz, 0
        self._start_s = clock.now_s()

    def frame_waiting(self, timeout_s: float) -> bool | None:
        """Wait until the next frame is due, or the time-out."""
        until_due_s = self._start_s + self._frames * self._period_s - self._clock.now_s()
        self._clock.sleep_s(max(0.0, min(timeout_s, until_due_s)))
        return until_due_s <= timeout_s

    def grab(self) -> bool:
        """Take the next frame.

        Raises:
            SourceEndedError: that was the last one.
        """
        if not self._capture.grab():
            raise SourceEndedError(f"the file has ended after {self._frames} frames")
        self._frames += 1
        return True


def open_settings_source(settings: CameraSettings, clock: Clock) -> CameraSource:
    """Open the camera that a bench names, and no other.

    Raises:
        HardwareError: it is not there, is another one, is in use, or permission is denied; says what to do.
    """
    if settings.kind == "v4l2":
        return _open_v4l2(settings)
    if settings.kind == "http":
        from drivers.http_camera import HttpSource

        return HttpSource(settings.source, settings.deadlines.connect_s, clock)
    return _open_file(settings, clock)


def _open_v4l2(settings: CameraSettings) -> V4l2Source:
    import cv2

    camera = find_camera(settings)
    refuse_inaccessible(settings, camera)
    lock = lock_port(camera.node)
    capture = cv2.VideoCapture(camera.node, cv2.CAP_V4L2)
    if not capture.isOpened():
        lock.release()
        raise HardwareError(
            f"{settings.source} ({camera.node}): gives no pictures. Close other programs that use it"
            + (", or name the path that ends in -video-index0" if camera.index else "")
        )
    ask_for_format(capture, settings)
    return V4l2Source(capture, _identity(settings, camera), lock)


def ask_for_format(capture: Any, settings: CameraSettings) -> None:
    """Ask for pixel format, size and frame rate, in the order that drivers take them in; connecting checks the size."""
    import cv2

    if settings.pixel_format is not None:
        # A static method that OpenCV's stubs do not know in all supported versions.
        capture.set(cv2.CAP_PROP_FOURCC, float(cv2.VideoWriter.fourcc(*settings.pixel_format)))
    if settings.size is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, float(settings.size[0]))
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, float(settings.size[1]))
    if settings.frame_rate_hz is not None:
        capture.set(cv2.CAP_PROP_FPS, settings.frame_rate_hz)


def _identity(settings: CameraSettings, camera: FoundCamera) -> Identity:
    return Identity("V4L2 camera", camera.identity, settings.source)


def _open_file(settings: CameraSettings, clock: Clock) -> FileSource:
    import cv2

    if not Path(settings.source).is_file():
        raise HardwareError(f"{settings.source}: no such file. Name a V4L2 path, an http:// address or a video file")
    capture = cv2.VideoCapture(settings.source, cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise HardwareError(f"{settings.source}: is no video that OpenCV can read. Convert it to Motion-JPEG in AVI")
    rate_hz = settings.frame_rate_hz or capture.get(cv2.CAP_PROP_FPS) or 25.0
    return FileSource(capture, Identity("video file", f"{rate_hz:g} frames a second", settings.source), clock, rate_hz)
