"""A camera on an emulated axis, on simulated time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.camera_settings import CameraSettings
from drivers.draining import Drain, InlineDrain
from drivers.opencv_camera import OpenCvCamera
from rig.devices import Picture
from rig.hal import Image, RigPose
from sim_backends.camera_emulator import CameraTiming, EmulatedCamera, Exposure
from sim_backends.camera_faults import CameraFault
from sim_backends.emulated_capture import EmulatedCapture
from sim_backends.frame_counter import read_counter
from sim_backends.simulated_clock import SimulatedClock

BLOCK_PX = 4
SIZE = (64, 48)


def striped(pose: RigPose) -> Image:
    """A small picture that moves with x, mid grey, without noise."""
    columns = (120.0 + 60.0 * np.sin((np.arange(SIZE[0]) + pose.x_mm) / 5.0)).astype(np.uint8)
    return np.repeat(np.repeat(columns[None, :, None], SIZE[1], axis=0), 3, axis=2)


class Axis:
    """Moves along x at even speed; the true pose at any time since the last move was told."""

    def __init__(self) -> None:
        self.start_s = self.end_s = 0.0
        self.start_mm = self.end_mm = 0.0

    def move(self, x_mm: float, now_s: float, seconds: float) -> None:
        self.start_mm, self.end_mm, self.start_s, self.end_s = self.end_mm, x_mm, now_s, now_s + seconds

    def pose_at(self, t_s: float) -> RigPose:
        if t_s >= self.end_s:
            return RigPose(self.end_mm, 0.0, 0.0, 0.0)
        share = max(0.0, (t_s - self.start_s) / (self.end_s - self.start_s))
        return RigPose(self.start_mm + share * (self.end_mm - self.start_mm), 0.0, 0.0, 0.0)


def settings(**changes: Any) -> CameraSettings:
    return CameraSettings(**{"source": "http://127.0.0.1:1/emulated", "latency_s": 0.03, "warm_up_s": 0.1} | changes)


class SlowHost:
    """A computer that is busy with other things: any call on the camera may begin late and return late."""

    def __init__(self, capture: EmulatedCapture, clock: SimulatedClock, seed: int) -> None:
        self._capture, self._clock, self._rng = capture, clock, np.random.default_rng(seed)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._capture, name)

    def frame_waiting(self, timeout_s: float) -> bool | None:
        return self._late(self._capture.frame_waiting, timeout_s)

    def grab(self) -> bool:
        return self._late(self._capture.grab)

    def retrieve(self) -> tuple[bool, Image | None]:
        return self._late(self._capture.retrieve)

    def _late(self, call: Callable[..., Any], *arguments: Any) -> Any:
        self._dawdle()
        answer = call(*arguments)
        self._dawdle()
        return answer

    def _dawdle(self) -> None:
        if self._rng.random() < 0.15:
            self._clock.sleep_s(float(self._rng.uniform(0.0, 0.12)))


class Bench:
    """An axis, a camera that looks along it, its driver, and a clock; nothing is connected yet."""

    def __init__(
        self,
        timing: CameraTiming | None = None,
        *,
        faults: Sequence[CameraFault] = (),
        polls: bool = True,
        unplugged: Exception | None = None,
        controls: dict[int, float] | None = None,
        stubborn: frozenset[int] = frozenset(),
        drain: Drain | None = None,
        slow_host: bool = False,
        seed: int = 0,
        **changes: Any,
    ) -> None:
        self.clock, self.axis = SimulatedClock(100.0), Axis()
        self.emulated = EmulatedCamera(
            self.axis.pose_at,
            striped,
            timing,
            faults=faults,
            counter_px=BLOCK_PX,
            seed=seed,
            start_s=99.0,
        )
        self.clock.attach(self.emulated)
        self.captures: list[EmulatedCapture] = []

        def open_source(_settings: CameraSettings, clock: Any) -> Any:
            capture = EmulatedCapture(
                self.emulated, clock, polls=polls, unplugged=unplugged, controls=controls, stubborn=stubborn
            )
            self.captures.append(capture)
            return SlowHost(capture, self.clock, seed) if slow_host else capture

        self.camera = OpenCvCamera(
            settings(**changes), self.clock, open_source=open_source, drain=drain or InlineDrain()
        )

    def move_and_capture(self, rng: np.random.Generator) -> Shot:
        """Move somewhere, settle, and take a picture; the host does not drain meanwhile."""
        seconds = float(rng.uniform(0.02, 0.6))
        self.axis.move(float(rng.uniform(0.0, 50.0)), self.clock.now_s(), seconds)
        self.clock.sleep_s(seconds + float(rng.uniform(0.0, 0.05)))
        after_s = self.clock.now_s()
        picture = self.camera.capture(after_s)
        return Shot(after_s, self.clock.now_s(), picture, self.judged(picture.image))

    def judged(self, image: Image) -> Exposure:
        """When and where a picture was really exposed, by the counter that it shows."""
        counter = read_counter(image, BLOCK_PX)
        assert counter is not None
        return self.emulated.exposure_of(counter)


@dataclass(frozen=True)
class Shot:
    """A picture that was asked for at ``after_s`` and had at ``got_s``, and the truth about it."""

    after_s: float
    got_s: float
    picture: Picture
    truth: Exposure

    @property
    def stale(self) -> bool:
        return not self.truth.began_s > self.after_s
