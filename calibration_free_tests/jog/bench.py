"""A homed bench of simple devices behind a real guard, on a clock that a test can let run slowly."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration_free_tests.guard.sample import Bench, bench
from rig.devices import Picture
from rig.hal import Image
from rig.jog.jogger import Jogger
from rig.jog.keeping import HandGrid
from rig.jog.marks import Marks
from sim_backends.simulated_clock import SimulatedClock

SOON_S = 5.0


class Gate(SimulatedClock):
    """Simulated time that a test can stop: whoever waits then goes on only when the gate is opened, or is stopped.

    While it is shut, every wait lasts a thousandth of a second, so that a device sees a STOP, and no time passes.
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

    def rest(self) -> None:
        assert self.jogger.rest(SOON_S), f"still {self.jogger.running}"

    def told(self) -> list[tuple[str, str]]:
        return [(message.kind, message.text) for message in self.jogger.messages]

    @property
    def last(self) -> tuple[str, str]:
        return self.told()[-1]


def eventually(happened: Callable[[], bool]) -> bool:
    """Other threads need a moment."""
    ends_s = time.monotonic() + SOON_S
    while not happened() and time.monotonic() < ends_s:
        time.sleep(0.002)
    return happened()


@contextmanager
def session(folder: Path, *, homed: bool = True, **others: Any) -> Iterator[Session]:
    """A jog session at a bench; homed and in the middle of nothing, unless told otherwise."""
    gate = Gate()
    made = bench(clock=gate, **others)
    made.camera.scene = lambda sequence: scene(sequence, made)
    made.guard.connect()
    if homed:
        made.guard.home()
        made.guard.move_to(replace_start())
    grid = HandGrid(folder / "grid", "bench.yaml")
    with made.guard, grid, Jogger(made.guard, grid, Marks(folder / "marks.json"), idle_s=0.01) as jogger:
        try:
            yield Session(made, gate, jogger, folder)
        finally:
            gate.open = True


def replace_start() -> Any:
    from calibration_free_tests.guard.sample import at

    return at(x_mm=-100.0, y_mm=20.0, z_mm=60.0, theta_deg=15.0, zoom=0.4)


def scene(sequence: int, made: Bench) -> Image:
    """A row of windows that moves with the gantry; no two pictures are the same."""
    image = np.full((240, 320, 3), (96, 140, 178), np.uint8)
    shift = int(made.gantry.place_mm[0]) % 64
    for left in range(-64, 320, 64):
        x = left + shift
        for y in (30, 130):
            image[y : y + 70, max(0, x) : max(0, x + 40)] = (60, 50, 45)
            image[y + 5 : y + 65, max(0, x + 5) : max(0, x + 35)] = (150, 190, 120 + sequence % 8)
    return image


def newest(made: Bench) -> Picture:
    """A picture as the camera draws it now."""
    return Picture(made.camera.scene(1), threading.get_ident() % 1000 + 1, made.clock.now_s())
