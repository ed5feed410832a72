"""When a STOP is latched for other processes, and what undoes it: a release, and nothing that only crosses one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from calibration_free_tests.guard.sample import at, bench, homed
from drivers.stopping_all import in_threads
from rig.clock import SystemClock
from rig.devices import StopReport
from rig.errors import HardwareError
from rig.guard import State, StoppedError
from rig.runtime import FileLatch

SOON_S = 5.0


class MemoryLatch:
    """A latch that keeps its note, and where a test may act while it is written or cleared."""

    def __init__(self) -> None:
        self.kept = ""
        self.before_set: Callable[[], object] = lambda: None
        self.before_clear: Callable[[], object] = lambda: None

    def note(self) -> str:
        return self.kept

    def set(self, note: str) -> str:
        self.before_set()
        self.kept = self.kept or note
        return ""

    def clear(self) -> None:
        self.before_clear()
        self.kept = ""


def eventually(happened: Callable[[], bool]) -> bool:
    ends_s = time.monotonic() + SOON_S
    while not happened() and time.monotonic() < ends_s:
        time.sleep(0.002)
    return happened()


# When it is latched.


def test_a_stop_is_latched_for_other_processes_while_a_servo_is_still_stopping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch = FileLatch(tmp_path / "bench.stopped")
    made, seen = homed(latch=latch), []
    stop_zoom = made.zoom.stop

    def slowly() -> StopReport:
        seen.append(eventually(lambda: latch.note().startswith("a person")))
        return stop_zoom()

    monkeypatch.setattr(made.zoom, "stop", slowly)
    assert made.guard.stop("a person").confirmed
    assert seen == [True]


def test_a_latch_that_hangs_delays_no_device_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.guard.stopping.LATCH_S", 0.05)
    latch, freed = MemoryLatch(), threading.Event()
    latch.before_set = lambda: freed.wait(SOON_S)
    made = bench(latch=latch, clock=SystemClock(), stops=in_threads)
    made.guard.connect()
    began_s = time.monotonic()
    report = made.guard.stop("a person")
    took_s = time.monotonic() - began_s
    freed.set()
    assert took_s < SOON_S / 2
    assert made.gantry.stops == made.pan.stops == made.zoom.stops == 1
    assert "STOP is not latched for other processes yet" in report.trouble
    assert made.guard.state is State.STOPPED


def test_where_no_thread_can_be_had_the_stop_is_latched_after_the_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    latch = MemoryLatch()
    made = homed(latch=latch)
    latch.before_set = lambda: told.append(made.gantry.stops)
    told: list[int] = []

    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    assert made.guard.stop("a person").confirmed
    assert (told, latch.kept) == ([1], "a person")


# What undoes it.


@pytest.mark.parametrize("when", ["while the devices are asked", "just before the latch is cleared"])
def test_a_stop_that_falls_into_a_release_stays_latched(when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    latch = MemoryLatch()
    made = homed(latch=latch)
    made.guard.stop("the first")

    def stop_again() -> None:
        monkeypatch.undo()
        latch.before_clear = lambda: None
        thread = threading.Thread(target=made.guard.stop, args=("the second",))
        thread.start()
        thread.join(SOON_S)

    if when == "while the devices are asked":
        status = made.gantry.status
        monkeypatch.setattr(made.gantry, "status", lambda: (stop_again(), status())[1])
    else:
        latch.before_clear = stop_again
    with pytest.raises(StoppedError, match="another STOP came"):
        made.guard.release()
    assert made.guard.state is State.STOPPED
    assert latch.note()
    with pytest.raises(StoppedError):
        made.guard.move_to(at(x_mm=-170.0))
    assert made.guard.release() is State.IDLE
    assert latch.note() == ""
    made.guard.move_to(at(x_mm=-170.0))


def test_a_release_that_the_devices_do_not_survive_leaves_the_stop_latched(monkeypatch: pytest.MonkeyPatch) -> None:
    latch = MemoryLatch()
    made = homed(latch=latch)
    made.guard.stop("a person")

    def fail() -> None:
        raise HardwareError("anything")

    latch.before_clear = fail
    with pytest.raises(HardwareError):
        made.guard.release()
    assert made.guard.state is State.STOPPED
    assert latch.note() == "a person"
