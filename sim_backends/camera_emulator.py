"""A camera whose picture depends on where the emulated axes are while it is exposed.

The sensor runs freely: it exposes, reads out and sends frame after frame, whoever reads. What has arrived waits in a
buffer of 1 to 8 frames, as in a driver. A frame shows the mean of the views at the begin and the end of its exposure,
so one that was exposed during a move differs from one that was exposed after it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rig.hal import Image, RigPose
from sim_backends.appearance import Sensor
from sim_backends.camera_faults import CameraFault, CameraFaultKind, at_work
from sim_backends.camera_pictures import Pictures
from sim_backends.frame_counter import draw_counter
from sim_backends.sensor import expose

_NEVER_ARRIVE = {CameraFaultKind.DROPPED, CameraFaultKind.HANG, CameraFaultKind.UNPLUG}
_REMEMBERED = 4096
_TOO_BRIGHT = 8.0


@dataclass(frozen=True, slots=True)
class CameraTiming:
    """How the camera runs.

    Attributes:
        frame_rate_hz: frames a second; an exposure may not be longer than their distance.
        exposure_s: of each frame.
        readout_s: from the end of the exposure until the frame has arrived.
        jitter_s: readout takes up to so much longer, at random.
        buffer_frames: how many frames wait to be read.
        keeps: what a full buffer keeps: the ``oldest`` frames, as V4L2 does, or the ``newest``.
    """

    frame_rate_hz: float = 30.0
    exposure_s: float = 0.01
    readout_s: float = 0.02
    jitter_s: float = 0.0
    buffer_frames: int = 4
    keeps: Literal["oldest", "newest"] = "oldest"

    def __post_init__(self) -> None:
        if not 1 <= self.buffer_frames <= 8:
            raise ValueError(f"buffer_frames = {self.buffer_frames} is outside 1 .. 8")
        if not 0.0 < self.exposure_s <= 1.0 / self.frame_rate_hz:
            raise ValueError(f"exposure_s = {self.exposure_s} does not fit into {self.frame_rate_hz} frames a second")


@dataclass(slots=True)
class Exposure:
    """One frame: its number from 1 on, when it was exposed, where the rig was, and when it arrived."""

    counter: int
    began_s: float
    began_at: RigPose
    ended_s: float = math.inf
    ended_at: RigPose | None = None
    arrives_s: float = math.inf
    faults: frozenset[CameraFaultKind] = frozenset()


@dataclass(frozen=True, slots=True)
class Arrived:
    """What waits in the buffer: the frame that is shown (a frozen camera repeats one), when it came, and its faults."""

    exposure: Exposure
    arrived_s: float
    faults: frozenset[CameraFaultKind]


class EmulatedCamera:
    """The camera itself. Attach it to a simulated clock behind the axes whose pose it asks for; readers carry it along
    too."""

    def __init__(
        self,
        pose_at: Callable[[float], RigPose],
        pictures: Pictures,
        timing: CameraTiming | None = None,
        *,
        faults: Sequence[CameraFault] = (),
        noise_sd: float = 2.0,
        counter_px: int | None = None,
        seed: int = 0,
        start_s: float = 0.0,
    ) -> None:
        """Switch it on.

        Args:
            pose_at: the rig's true pose at a time that has just come.
            pictures: what is seen from a pose, without noise.
            timing: how it runs.
            faults: what goes wrong.
            noise_sd: of the sensor, grey levels. Without any, a rig at rest gives frames that look frozen.
            counter_px: size of the blocks of a frame counter in the top left corner; ``None``: none is drawn.
            seed: of noise and jitter; the same seed gives the same pictures.
            start_s: when the first exposure begins.
        """
        self.timing = timing or CameraTiming()
        self.faults = list(faults)
        self._pose_at, self._pictures = pose_at, pictures
        self._noise_sd, self._counter_px, self._seed = noise_sd, counter_px, seed
        self._jitter = np.random.default_rng([seed, 0])
        self._start_s, self._count = start_s, 0
        self._exposing: Exposure | None = None
        self._on_the_way: deque[Exposure] = deque()
        self._before_freeze: Exposure | None = None
        self._frozen: Exposure | None = None
        self._recent: deque[Exposure] = deque(maxlen=_REMEMBERED)
        self.buffer: deque[Arrived] = deque()

    def next_event_s(self) -> float:
        """When an exposure begins or ends next, or a frame arrives."""
        turn_s = self._begin_s() if self._exposing is None else self._exposing.began_s + self.timing.exposure_s
        return min(turn_s, self._on_the_way[0].arrives_s) if self._on_the_way else turn_s

    def advance_to(self, now_s: float) -> None:
        """Let everything happen up to this time."""
        while (event_s := self.next_event_s()) <= now_s:
            if self._on_the_way and self._on_the_way[0].arrives_s <= event_s:
                self._arrive(self._on_the_way.popleft())
            elif self._exposing is None:
                self._count += 1
                self._exposing = Exposure(self._count, event_s, self._pose_at(event_s))
            else:
                self._end_exposure(self._exposing, event_s)
                self._exposing = None

    def exposure_of(self, counter: int) -> Exposure:
        """For judges only: when the frame of that number was exposed and where; of the last few thousand frames."""
        first = self._recent[0].counter
        return self._recent[counter - first]

    def plugged(self, since_s: float, now_s: float) -> bool:
        """Whether it was plugged in all that time: what was opened before the plug was out stays dead."""
        pulls = [fault for fault in self.faults if fault.kind is CameraFaultKind.UNPLUG]
        return not any(fault.at_s <= now_s and since_s < fault.until_s for fault in pulls)

    def draw(self, exposure: Exposure) -> Image:
        """The picture of a frame; the same frame always gives the same bytes."""
        assert exposure.ended_at is not None
        shown = self._mean_view(exposure.began_at, exposure.ended_at)
        if self._counter_px is not None:
            draw_counter(shown, exposure.counter, self._counter_px)
        if CameraFaultKind.WRONG_SIZE in exposure.faults:
            shown = np.ascontiguousarray(shown[::2, ::2])
        bright = _TOO_BRIGHT if CameraFaultKind.OVER_EXPOSED in exposure.faults else 1.0
        dark = CameraFaultKind.BLACK in exposure.faults
        sensor = Sensor(blur_px=0.0, noise_sd=self._noise_sd, exposure=0.0 if dark else bright)
        return expose(shown, sensor, np.random.default_rng([self._seed, 1, exposure.counter]))

    def _begin_s(self) -> float:
        return self._start_s + self._count / self.timing.frame_rate_hz

    def _end_exposure(self, exposure: Exposure, now_s: float) -> None:
        exposure.ended_s, exposure.ended_at = now_s, self._pose_at(now_s)
        if self.faults:
            exposure.faults = frozenset(kind for kind in CameraFaultKind if at_work(self.faults, kind, now_s))
        late_s = self.timing.readout_s + self.timing.jitter_s * float(self._jitter.random())
        # Frames do not overtake each other.
        before_s = self._on_the_way[-1].arrives_s if self._on_the_way else now_s
        exposure.arrives_s = max(now_s + late_s, before_s)
        self._recent.append(exposure)
        self._on_the_way.append(exposure)

    def _arrive(self, exposure: Exposure) -> None:
        if exposure.faults & _NEVER_ARRIVE:
            return
        arrived_s, faults = exposure.arrives_s, exposure.faults
        if CameraFaultKind.FREEZE in exposure.faults:
            exposure = self._frozen = self._frozen or self._before_freeze or exposure
        else:
            self._before_freeze, self._frozen = exposure, None
        arrived = Arrived(exposure, arrived_s, faults)
        if len(self.buffer) == self.timing.buffer_frames:
            if self.timing.keeps == "oldest":
                return
            self.buffer.popleft()
        self.buffer.append(arrived)

    def _mean_view(self, first: RigPose, last: RigPose) -> Image:
        import cv2

        view = self._pictures(first)
        if last == first:
            return view.copy()
        return np.asarray(cv2.addWeighted(view, 0.5, self._pictures(last), 0.5, 0.0), dtype=np.uint8)
