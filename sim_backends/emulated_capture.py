"""Reads an emulated camera through the methods of OpenCV's VideoCapture, on simulated time or real."""

from __future__ import annotations

from rig.devices import Clock, Identity
from rig.errors import HardwareError
from rig.hal import Image
from sim_backends.camera_emulator import Arrived, EmulatedCamera

_SELECT_TIMEOUT_S = 10.0  # OpenCV's, after which a read gives up


class EmulatedCapture:
    """An open camera with the methods of OpenCV's VideoCapture. One reader at a time."""

    bounded_buffer = True

    def __init__(
        self,
        camera: EmulatedCamera,
        clock: Clock,
        *,
        polls: bool = True,
        unplugged: Exception | None = None,
        controls: dict[int, float] | None = None,
        stubborn: frozenset[int] = frozenset(),
    ) -> None:
        """Open it.

        Args:
            camera: what is read.
            clock: passes the time while a read waits.
            polls: it can say whether a frame is waiting.
            unplugged: raised by reads once the plug is out; ``None``: they return False.
            controls: OpenCV's property numbers and the values that they have; others do not exist.
            stubborn: properties that say they were set, and keep their value.

        Raises:
            HardwareError: it is not plugged in.
        """
        self._opened_s = clock.now_s()
        if not camera.plugged(self._opened_s, self._opened_s):
            raise HardwareError("emulated camera: no such camera. Check cable and power")
        self._camera, self._clock, self._polls, self._unplugged = camera, clock, polls, unplugged
        self._controls, self._stubborn = dict(controls or {}), stubborn
        self.grabbed: Arrived | None = None
        """The frame that was grabbed last, for judges and servers."""
        self._open = True
        camera.advance_to(self._opened_s)
        camera.buffer.clear()  # the stream starts when it is opened
        self.identity = Identity("emulated camera", f"{camera.timing.frame_rate_hz:g} frames a second", "emulated")

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Whether it has not been released."""
        return self._open

    def frame_waiting(self, timeout_s: float) -> bool | None:
        """Wait until a frame can be read (True) or the time-out (False); ``None``: it cannot tell."""
        return self._wait(timeout_s) if self._polls else None

    def grab(self) -> bool:
        """Take the next frame, waiting for it as long as OpenCV does."""
        self.grabbed = None
        if not self._wait(_SELECT_TIMEOUT_S) or self._pulled():
            return False
        self.grabbed = self._camera.buffer.popleft()
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        """Draw the frame that was grabbed."""
        return (False, None) if self.grabbed is None else (True, self._camera.draw(self.grabbed.exposure))

    def read(self) -> tuple[bool, Image | None]:
        """`grab`, then `retrieve`."""
        return self.retrieve() if self.grab() else (False, None)

    def set(self, prop: int, value: float) -> bool:
        """Set a control that there is."""
        if prop not in self._controls:
            return False
        if prop not in self._stubborn:
            self._controls[prop] = value
        return True

    def get(self, prop: int) -> float:
        """Read a control; 0 where there is none."""
        return self._controls.get(prop, 0.0)

    def release(self) -> None:
        """Close it. Safe to call twice."""
        self._open = False

    def _wait(self, timeout_s: float) -> bool:
        until_s = self._clock.now_s() + timeout_s
        while True:
            now_s = self._clock.now_s()
            self._camera.advance_to(now_s)
            if self._camera.buffer or not self._camera.plugged(self._opened_s, now_s):
                return True
            if now_s >= until_s or not self._open:
                return False
            self._clock.sleep_s(max(1e-6, min(until_s, self._camera.next_event_s()) - now_s))

    def _pulled(self) -> bool:
        if self._camera.plugged(self._opened_s, self._clock.now_s()):
            return False
        if self._unplugged is not None:
            raise self._unplugged
        return True
