"""One connection to a camera: takes its frames one by one, and keeps the newest with what is proved about its age."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.camera_locks import Lock, lock_controls
from drivers.camera_settings import CameraSettings
from drivers.camera_source import CameraSource, SourceEndedError
from drivers.frame_checks import RepeatWatch
from drivers.freshness import FreshnessBound
from rig.devices import Clock, Picture
from rig.hal import Image

POLL_S = 0.005
"""How finely it is known when the buffer was empty; longer than a round trip in a laboratory's network."""
_AFTER_FAILURE_S = 0.01
_INTERVALS, _FEWEST_INTERVALS = 15, 3


@dataclass(frozen=True, slots=True)
class Received:
    """A frame as it was taken out of the buffer.

    Attributes:
        picture: ``exposed_at_s`` is a time that its exposure is proved to have begun after, ``-inf`` where none is.
        received_at_s: when it was taken.
        repeats: it has the same bytes as one of the frames before it.
    """

    picture: Picture
    received_at_s: float
    repeats: bool


class CameraSession:
    """Everything about one open source. `drain_once` and `finish` are called by the drain, all else by anybody.

    Attributes:
        latest: the newest frame.
        last_frame_s: when a frame was last taken out, or the session's begin.
        trouble: why there will be no more frames; empty while there may be.
        locks: what became of the controls; ``None`` until `lock` was asked for and done.
    """

    def __init__(self, source: CameraSource, clock: Clock, settings: CameraSettings) -> None:
        import cv2

        self._source, self._clock, self._settings = source, clock, settings
        self._bound = FreshnessBound(settings.buffer_frames if source.bounded_buffer else None, settings.latency_s)
        self._repeats = RepeatWatch()
        self._intervals_s: deque[float] = deque(maxlen=_INTERVALS)
        self._waited = self._waited_before = False
        self._sequence = 0
        self._failing_since_s: float | None = None
        self._asked: Callable[[], None] | None = None
        self._read_errors = (OSError, cv2.error)
        self.latest: Received | None = None
        self.last_frame_s = clock.now_s()
        self.trouble = ""
        self.locks: tuple[Lock, ...] | None = None

    @property
    def frame_period_s(self) -> float | None:
        """Median time between frames that had to be waited for, s; ``None``: too few have come."""
        intervals = list(self._intervals_s)
        return statistics.median(intervals) if len(intervals) >= _FEWEST_INTERVALS else None

    @property
    def _longest_exposure_s(self) -> float:
        """The exposure if it is locked; infinite where it is not known."""
        locked = any(lock.name == "exposure" and lock.held for lock in self.locks or ())
        return self._settings.exposure_s if locked and self._settings.exposure_s is not None else math.inf

    def lock(self) -> None:
        """Have the controls locked before the next frame is taken; `locks` tells when it is done."""

        def action() -> None:
            self.locks = lock_controls(self._source, self._settings)

        self._asked = action

    def drain_once(self) -> bool:
        """Wait a moment for a frame and take it; False: there will be no more."""
        try:
            if self._asked is not None:
                asked, self._asked = self._asked, None
                asked()
            self._take()
        except SourceEndedError as error:
            self.trouble = str(error)
        except self._read_errors as error:
            self._failed(str(error).strip() or type(error).__name__)
        except Exception as error:
            # Whatever it is: draining ends, and whoever waits for a picture is told why there will be none.
            self.trouble = f"taking a frame failed with {type(error).__name__}: {error}"
        return not self.trouble

    def finish(self) -> None:
        """Release the source; the session is then over."""
        self.trouble = self.trouble or "closed"
        self._source.release()

    def _take(self) -> None:
        began_s = self._clock.now_s()
        waiting = self._source.frame_waiting(POLL_S)
        if waiting is False:
            self._bound.seen_empty(began_s)
            self._waited = True
            return
        grab_began_s = self._clock.now_s()
        if not self._source.grab():
            raise OSError("a read gave no frame")
        exposed_after_s = self._bound.grabbed(grab_began_s, self._longest_exposure_s)
        good, image = self._source.retrieve()
        if not good or image is None:
            raise OSError("a frame cannot be decoded")
        self._failing_since_s = None
        self._keep(image, exposed_after_s)

    def _keep(self, image: Image, exposed_after_s: float) -> None:
        now_s = self._clock.now_s()
        if self._waited and self._waited_before:
            self._intervals_s.append(now_s - self.last_frame_s)
        self._waited, self._waited_before = False, self._waited
        self.last_frame_s = now_s
        self._sequence += 1
        picture = Picture(image, self._sequence, exposed_after_s)
        self.latest = Received(picture, now_s, self._repeats.repeats(image))

    def _failed(self, why: str) -> None:
        now_s = self._clock.now_s()
        if self._failing_since_s is None:
            self._failing_since_s = now_s
        if now_s - self._failing_since_s >= self._settings.deadlines.lost_s:
            self.trouble = f"every read has failed for {now_s - self._failing_since_s:.1f} s ({why})"
        else:
            self._clock.sleep_s(_AFTER_FAILURE_S)
