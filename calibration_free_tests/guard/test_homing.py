"""What counts as homed (decision 0051): homed in this session, left homed by the last one, or as the gantry says."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from calibration_free_tests.guard.sample import RULES, START, Bench, bench
from rig.devices import Identity
from rig.errors import RigError
from rig.guard import State
from rig.guard.rules import Homing
from rig.runtime import FileHomingMemory

WHO = Identity("GRBL", "1.1h", "/dev/ttyUSB0")


class Machine:
    """A gantry that stays on while processes that use it come and go."""

    def __init__(self, folder: Path, homing: Homing) -> None:
        self.rules = replace(RULES, homing=homing)
        self.boot = folder / "boot_id"
        self.boot.write_text("this start")
        self.record = folder / "bench.homed"
        self.place_mm = (0.0, 0.0, 0.0)

    def session(self, gantry_says_homed: bool = True) -> Bench:
        """A process that has connected."""
        memory = FileHomingMemory(self.record, self.boot)
        made = bench(self.rules, memory=memory, homing="trusted" if gantry_says_homed else "required")
        made.gantry.place_mm = self.place_mm
        made.guard.connect()
        return made

    def end(self, made: Bench) -> None:
        made.guard.close()
        self.place_mm = made.gantry.place_mm


def used(machine: Machine) -> Bench:
    """A session that has homed and moved."""
    made = machine.session()
    made.guard.home()
    made.guard.move_to(START)
    return made


def test_by_default_every_session_homes_whatever_the_gantry_says(tmp_path: Path) -> None:
    machine = Machine(tmp_path, "each_session")
    machine.end(used(machine))
    assert machine.session().guard.state is State.UNHOMED
    assert RULES.homing == "each_session"


def test_a_gantry_that_stands_where_it_was_left_homed_is_homed_where_the_bench_says_so(tmp_path: Path) -> None:
    machine = Machine(tmp_path, "remembered")
    assert machine.session().guard.state is State.UNHOMED
    machine.end(used(machine))
    again = machine.session()
    assert (again.guard.state, again.motions) == (State.IDLE, [])
    assert (again.guard.pose.x_mm, again.guard.pose.y_mm, again.guard.pose.z_mm) == (-180.0, -140.0, 10.0)


@pytest.mark.parametrize("why", ["moved", "not homed", "computer restarted", "garbled", "not a number", "used up"])
def test_what_contradicts_the_record_voids_it(why: str, tmp_path: Path) -> None:
    machine = Machine(tmp_path, "remembered")
    machine.end(used(machine))
    x, y, z = machine.place_mm
    if why == "moved":
        machine.place_mm = (x + 0.06, y, z)
    elif why == "computer restarted":
        machine.boot.write_text("the next start")
    elif why == "garbled":
        machine.record.write_text("{")
    elif why == "not a number":
        machine.record.write_text(machine.record.read_text().replace(str(x), "NaN"))
    elif why == "used up":
        # A session that is killed leaves nothing behind.
        machine.session()
    made = machine.session(gantry_says_homed=why != "not homed")
    assert made.guard.state is State.UNHOMED
    assert not machine.record.exists()


@pytest.mark.parametrize("ends", ["alarm", "stopped", "held", "failed", "restarted", "unhomed"])
def test_only_a_session_that_ends_homed_at_rest_and_in_order_is_remembered(ends: str, tmp_path: Path) -> None:
    machine = Machine(tmp_path, "remembered")
    made = machine.session() if ends == "unhomed" else used(machine)
    if ends == "alarm":
        made.gantry.raise_alarm(1)
    elif ends == "stopped":
        made.guard.stop()
    elif ends == "held":
        made.guard.hold()
    elif ends == "restarted":
        made.gantry.restart()
    elif ends == "failed":
        made.gantry.get_stuck()
        with suppress(RigError):
            made.guard.move_to(replace(START, x_mm=0.0))
    machine.end(made)
    assert not machine.record.exists()


def test_the_gantrys_word_is_taken_only_where_the_bench_says_so(tmp_path: Path) -> None:
    machine = Machine(tmp_path, "as_found")
    machine.place_mm = (430.0, 60.0, 10.0)
    made = machine.session()
    assert made.guard.state is State.IDLE
    made.guard.move_to(START)
    assert machine.session(gantry_says_homed=False).guard.state is State.UNHOMED


def test_a_record_is_of_one_gantry(tmp_path: Path) -> None:
    memory = FileHomingMemory(tmp_path / "bench.homed")
    memory.remember(WHO, (1.0, 2.0, 3.0))
    assert memory.recall(replace(WHO, where="/dev/ttyUSB1")) is None
    assert memory.recall(WHO) is None
    memory.remember(WHO, (1.0, 2.0, 3.0))
    assert memory.recall(WHO) == (1.0, 2.0, 3.0)
    assert memory.recall(WHO) is None


def test_where_no_record_can_be_written_the_next_session_homes(tmp_path: Path) -> None:
    memory = FileHomingMemory(tmp_path / "missing" / "bench.homed")
    memory.remember(WHO, (1.0, 2.0, 3.0))
    assert memory.recall(WHO) is None
