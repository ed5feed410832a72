"""Garbage is collected while nothing moves, and never while something does."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

from calibration_free_tests.jog.bench import eventually, session
from rig.guard import State
from rig.jog.jogger import Jogger
from rig.jog.keeping import HandGrid
from rig.jog.marks import Marks
from rig.jog.pauses import Pauses
from sim_backends.simulated_clock import SimulatedClock


class Knot:
    """Garbage that only a collection finds."""

    def __init__(self) -> None:
        self.me = self


def dropped() -> weakref.ref[Knot]:
    return weakref.ref(Knot())


def test_nothing_is_collected_but_at_rest_and_not_too_often() -> None:
    clock = SimulatedClock()
    with Pauses(clock, every_s=10.0) as pauses:
        assert not gc.isenabled()
        knot = dropped()
        pauses.take()
        assert knot() is not None
        clock.sleep_s(10.0)
        pauses.take()
        assert knot() is None
        assert gc.get_freeze_count() > 0
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_a_rest_is_only_where_no_command_runs(tmp_path: Path) -> None:
    states: list[State] = []
    with session(tmp_path, idle_s=60.0) as s:
        guard = s.made.guard
        grid, marks = HandGrid(tmp_path / "other", "bench.yaml"), Marks(tmp_path / "other.json")
        with Jogger(guard, grid, marks, idle_s=0.001, at_rest=lambda: states.append(guard.state)) as jogger:
            assert eventually(lambda: len(states) > 3)
            s.gate.open = False
            jogger.step("x_mm", 1)
            s.under_way()
            rests = len(states)
            s.gate.open = True
            assert jogger.rest(5.0)
            assert eventually(lambda: len(states) > rests)
        assert set(states) == {State.IDLE}
