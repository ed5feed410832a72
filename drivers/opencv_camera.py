"""An uncalibrated camera through OpenCV: V4L2 by stable path, a video file, or Motion-JPEG over HTTP.

Frames are drained without pause, and `capture` hands out only pictures whose exposure is proved to have begun after the
rig had settled (decision 0052), and that are neither frozen, black, over-exposed nor of another size.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from drivers.camera_locks import Lock
from drivers.camera_session import CameraSession, Received
from drivers.camera_settings import CameraSettings
from drivers.camera_source import CameraSource, open_settings_source
from drivers.draining import Drain, ThreadDrain
from drivers.frame_checks import BadFrameError, PictureFault, PictureLook, faults_of, look_at, told
from rig.devices import Clock, Identity, Picture
from rig.errors import HardwareError

OpenSource = Callable[[CameraSettings, Clock], CameraSource]

_SILENT_PERIODS = 3.0
_FRAMES_UNTIL_LOCKED = 4
"""Cameras take a new exposure over a frame or two after they were told."""


class OpenCvCamera:
    """A `rig.devices.LiveCamera`. ``Picture.exposed_at_s`` is the latest time that its exposure surely began after."""

    Settings = CameraSettings

    def __init__(
        self,
        settings: CameraSettings,
        clock: Clock,
        *,
        open_source: OpenSource = open_settings_source,
        drain: Drain | None = None,
    ) -> None:
        """Open nothing yet.

        Args:
            settings: from the bench file.
            clock: monotonic time.
            open_source: opens the camera; the bench passes an emulated one where it has no hardware.
            drain: who takes frames out of the buffer; ``None``: a thread. On simulated time an `InlineDrain`.
        """
        self._settings, self._clock, self._open_source = settings, clock, open_source
        self._drain = drain or ThreadDrain(clock)
        self._session: CameraSession | None = None
        self._size: tuple[int, int] | None = None
        self.last_look: PictureLook | None = None
        """Levels and sharpness of the last picture that `capture` looked at."""

    @property
    def locks(self) -> tuple[Lock, ...]:
        """What the device let lock and what it did not; empty before `connect`."""
        session = self._session
        return (session.locks or ()) if session is not None else ()

    @property
    def frame_period_s(self) -> float | None:
        """Measured time between frames, s; ``None``: too few have come."""
        return self._session.frame_period_s if self._session is not None else None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the pictures, pixels; ``None`` before `connect`."""
        return self._size

    def connect(self) -> Identity:
        """Open the camera that was meant, let it warm up, lock what it lets lock, and go on draining.

        Raises:
            HardwareError: no such camera, another one, in use, no permission, no pictures, or another size.
        """
        self.close()
        source = self._open_source(self._settings, self._clock)
        session = CameraSession(source, self._clock, self._settings)
        identity = source.identity
        self._session = session
        self._drain.start(session.drain_once, session.finish)
        try:
            self._warm_up(session)
        except BaseException:
            self.close()
            raise
        return identity

    def capture(self, after_s: float) -> Picture:
        """A picture without fault whose exposure began after ``after_s`` on the clock.

        Raises:
            BadFrameError: the camera is frozen, or gives black, over-exposed or wrongly sized pictures.
            HardwareError: not connected, unplugged, hangs, or gave no fresh picture in time.
        """
        if not math.isfinite(after_s):
            raise ValueError(f"after_s = {after_s} is no time")
        session = self._connected()
        began_s, seen, bad = self._clock.now_s(), 0, 0
        while True:
            received = session.latest
            if received is not None and received.picture.sequence > seen and received.picture.exposed_at_s > after_s:
                seen = received.picture.sequence
                faults = self._look(received)
                if not faults:
                    return received.picture
                bad += 1
                self._refuse_bad(bad, faults)
            self._refuse_silence(session, began_s)
            if self._clock.now_s() - began_s >= self._settings.deadlines.capture_s:
                raise self._late(session, after_s, bad)
            self._drain.idle()

    def latest(self) -> Picture | None:
        """The newest picture, however old and whatever its faults, for previews."""
        received = self._session.latest if self._session is not None else None
        return None if received is None else received.picture

    def close(self) -> None:
        """Release the camera, also one that hangs: it then follows as soon as its read returns. Safe to call twice."""
        if self._session is not None:
            self._session = None
            self._drain.stop()

    def _warm_up(self, session: CameraSession) -> None:
        """Run, then lock, then take the first picture after that."""
        began_s = self._clock.now_s()
        self._wait_for(session, began_s, "first", began_s + self._settings.warm_up_s, 0)
        session.lock()
        while session.locks is None:
            self._refuse_silence(session, began_s)
            self._drain.idle()
        before = session.latest.picture.sequence if session.latest is not None else 0
        received = self._wait_for(session, began_s, "next", self._clock.now_s(), before + _FRAMES_UNTIL_LOCKED)
        height, width = received.picture.image.shape[:2]
        # A camera that gives another size than before the link was lost has a fault, whatever size the bench allows.
        expected = self._settings.size or self._size
        if expected not in (None, (width, height)):
            asked = "{}x{}".format(*expected or ())
            remedy = (
                f"not {asked}. Ask for a size that it has (`v4l2-ctl --list-formats-ext` tells), or leave width_px and "
                "height_px out"
                if self._settings.size
                else f"not {asked} as before. Does another program change the camera's settings? Try again"
            )
            raise HardwareError(f"{self._settings.source}: gives {width}x{height} pixels, {remedy}")
        self._size = (width, height)

    def _wait_for(self, session: CameraSession, began_s: float, which: str, until_s: float, after: int) -> Received:
        """The first frame that has a proved age, comes later than ``until_s``, and is numbered above ``after``."""
        while True:
            received = session.latest
            if (
                received is not None
                and received.picture.sequence > after
                and received.received_at_s >= until_s
                and math.isfinite(received.picture.exposed_at_s)
            ):
                return received
            self._refuse_lost(session)
            waited_s = self._clock.now_s() - began_s
            if waited_s >= self._settings.deadlines.connect_s:
                raise HardwareError(
                    f"{self._settings.source}: the {which} picture has not come after {waited_s:.1f} s. Close other "
                    "programs that use the camera; ask for a smaller size or frame rate if this computer is too slow"
                )
            self._drain.idle()

    def _connected(self) -> CameraSession:
        if self._session is None:
            raise HardwareError(f"{self._settings.source}: not connected. Connect first")
        return self._session

    def _look(self, received: Received) -> tuple[PictureFault, ...]:
        limits = self._settings.limits
        self.last_look = look_at(received.picture.image, limits)
        return faults_of(self.last_look, limits, size=self._size, repeats=received.repeats)

    def _refuse_bad(self, bad: int, faults: tuple[PictureFault, ...]) -> None:
        if bad >= self._settings.limits.attempts:
            assert self.last_look is not None
            what = told(self.last_look, self._settings.limits, faults)
            raise BadFrameError(f"{self._settings.source}: {bad} fresh pictures in a row; the last is {what}", faults)

    def _refuse_lost(self, session: CameraSession) -> None:
        if session.trouble:
            raise HardwareError(
                f"{self._settings.source}: {session.trouble}. Check cable and power, then connect again"
            )

    def _refuse_silence(self, session: CameraSession, began_s: float) -> None:
        self._refuse_lost(session)
        silent_s = self._clock.now_s() - max(session.last_frame_s, began_s)
        told_s = 1.0 / self._settings.frame_rate_hz if self._settings.frame_rate_hz is not None else 0.0
        period_s = max(told_s, session.frame_period_s or 0.0)
        if silent_s >= max(self._settings.deadlines.silence_s, _SILENT_PERIODS * period_s):
            raise HardwareError(
                f"{self._settings.source}: no frame for {silent_s:.1f} s: it hangs. Unplug it, plug it in and connect "
                "again"
            )

    def _late(self, session: CameraSession, after_s: float, bad: int) -> HardwareError:
        waited = f"{self._settings.source}: no picture within {self._settings.deadlines.capture_s:g} s"
        if bad:
            return HardwareError(f"{waited} but {bad} with faults. Look at the live picture")
        received = session.latest
        age = (
            "none has come"
            if received is None
            else f"the newest may be {after_s - received.picture.exposed_at_s:.2f} s too old"
        )
        return HardwareError(
            f"{waited} that was surely exposed after the rig settled: {age}. Ask for a smaller size or frame rate if "
            "this computer cannot keep up, or check latency_s"
        )
