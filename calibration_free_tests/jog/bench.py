"""A homed bench of simple devices behind a real guard, on a clock that a test can stop, and a jog session at it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration_free_tests.guard.sample import Bench, bench
from rig.devices import Picture
from rig.guard import State
from rig.hal import Image, RigPose
from rig.jog.jogger import Jogger
from rig.jog.keeping import HandGrid
from rig.jog.marks import Marks
from sim_backends.simulated_clock import SimulatedClock

SOON_S = 5.0
PLACE = RigPose(-100.0, 20.0, 60.0, 15.0, 0.4)


class Gate(SimulatedClock):
    """Simulated time that a test can stop: while the gate is shut a motion never ends by itself.

    Waits then last a thousandth of a second of real time, so that a device sees a STOP.
    """

    def __init__(self) -> None:
        super().__init__(100.0)
        self.open = True

    def sleep_s(self, seconds: float) -> None:
        if self.open:
            super().sleep_s(seconds)
        else:
            time.sleep(0.001)


@dataclass
class Session:
    """A jogger at a bench."""

    made: Bench
    gate: Gate
    jogger: Jogger
    folder: Path

    @property
    def state(self) -> State:
        return self.made.guard.state

    @property
    def pose(self) -> RigPose:
        return self.made.guard.pose

    @property
    def told(self) -> list[tuple[str, str]]:
        return [(message.kind, message.text) for message in self.jogger.messages]

    def rest(self) -> None:
        assert self.jogger.rest(SOON_S), f"still under way: {self.jogger.running}"

    def heard(self, text: str) -> bool:
        """It has been told, or is soon."""
        return eventually(lambda: any(text in words for _, words in self.told))

    def under_way(self) -> None:
        """Wait until something moves."""
        assert eventually(lambda: self.state in (State.JOGGING, State.MOVING))


def eventually(happened: Callable[[], bool]) -> bool:
    """Other threads need a moment."""
    ends_s = time.monotonic() + SOON_S
    while not happened() and time.monotonic() < ends_s:
        time.sleep(0.002)
    return happened()


@contextmanager
def session(folder: Path, *, homed: bool = True, **others: Any) -> Iterator[Session]:
    """A session at a bench that is connected, and, unless told otherwise, homed and at `PLACE`."""
    gate = Gate()
    made = bench(clock=gate, **others)
    made.camera.scene = lambda sequence: windows(sequence, made)
    made.guard.connect()
    if homed:
        made.guard.home()
        made.guard.move_to(PLACE)
    made.motions.clear()
    grid = HandGrid(folder / "grid", "bench.yaml")
    with made.guard, grid, Jogger(made.guard, grid, Marks(folder / "marks.json"), idle_s=0.01) as jogger:
        try:
            yield Session(made, gate, jogger, folder)
        finally:
            gate.open = True


def windows(sequence: int, made: Bench) -> Image:
    """A row of windows that moves with the gantry; no two pictures in a row are the same."""
    image = np.full((240, 320, 3), (96, 140, 178), np.uint8)
    shift = int(made.gantry.place_mm[0]) % 64
    for left in range(shift - 64, 320, 64):
        for top in (30, 130):
            image[top : top + 70, max(0, left) : max(0, left + 40)] = (60, 50, 45)
            image[top + 5 : top + 65, max(0, left + 5) : max(0, left + 35)] = (150, 190, 120 + sequence % 8)
    return image


def newest(made: Bench, sequence: int = 1) -> Picture:
    """What a camera that draws all the time has drawn now."""
    return Picture(made.camera.scene(sequence), sequence, made.clock.now_s())
