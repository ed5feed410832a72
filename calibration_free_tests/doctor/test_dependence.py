"""Every check runs; what rests on one that failed is told as not tested. Devices of other drivers are asked too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.doctor.planted import FAULTS
from calibration_free_tests.doctor.sample import GANTRY_PORT, Workbench, text_of
from calibration_free_tests.guard.sample import bench as bench_with_guard
from rig.bench import Device, load_bench
from rig.devices import GantryStatus, Motion
from rig.doctor import Finding, Verdict, examine
from rig.doctor.finding import in_two
from rig.doctor.gantry import state_finding
from rig.errors import HardwareError, InputError
from rig.runtime import Attendance
from sim_backends.grbl_emulator.dialects import GRBL_1_1
from sim_backends.simple_devices import (
    SimpleAxis,
    SimpleAxisSettings,
    SimpleCamera,
    SimpleCameraSettings,
    SimpleGantry,
    SimpleGantrySettings,
)


def lines(findings: list[Finding]) -> set[tuple[str, str]]:
    return {(finding.subject, finding.what) for finding in findings}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_line_is_told_whatever_fails(tmp_path: Path, fault: Any) -> None:
    (tmp_path / "healthy").mkdir()
    (tmp_path / "faulty").mkdir()
    dialect = fault.dialects[0]
    healthy = Workbench(tmp_path / "healthy", dialect).findings()
    faulty = fault.findings(tmp_path / "faulty", dialect)
    assert lines(faulty) == lines(healthy)
    assert len(faulty) == len(healthy)


def test_what_rests_on_a_failed_check_names_it(tmp_path: Path) -> None:
    (fault,) = [fault for fault in FAULTS if fault.name == "no permission for the port"]
    findings = fault.findings(tmp_path, GRBL_1_1)
    untested = [finding for finding in findings if finding.ok is Verdict.NOT_TESTED]
    assert {finding.subject for finding in untested} == {"gantry"}
    assert {finding.told for finding in untested} == {"rests on gantry: permission, which failed"}
    assert ("gantry", "travel") in lines(untested)


def test_a_bench_that_a_process_holds_is_left_alone(tmp_path: Path) -> None:
    class Guard:
        def glance(self) -> Any:
            raise HardwareError("not asked for here")

    bench = Workbench(tmp_path)
    config = load_bench(bench.bench_file)

    def refuse(device: Device, clock: Any) -> Any:
        raise AssertionError(f"{device.role} was opened")

    with Attendance(bench.world.runtime(), config.key, config.name).listen(Guard()):  # type: ignore[arg-type]  # only glance is asked for
        findings = bench.findings(make=refuse)
    (held,) = [finding for finding in findings if finding.ok is Verdict.FAIL]
    assert (held.subject, held.what) == ("runtime", "in use")
    untested = [finding for finding in findings if finding.ok is Verdict.NOT_TESTED]
    assert {finding.subject for finding in untested} == {"gantry", "pan", "zoom", "camera"}
    assert {finding.told for finding in untested} == {"rests on runtime: in use, which failed"}


def test_a_held_bench_names_the_process_and_what_it_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Attendance, "ask", lambda self, what: {"pid": 4711, "state": "moving"})
    (held,) = [finding for finding in Workbench(tmp_path).findings() if finding.ok is Verdict.FAIL]
    assert held.told == "process 4711 holds the bench (moving)"
    assert held.remedy.startswith("Wait until it is done or end it")


def other_drivers(bench: Workbench, **makes: Any) -> list[Finding]:
    """The bench with devices whose drivers are none of ours."""
    devices = {
        "gantry": Device("gantry", "simple", SimpleGantry, SimpleGantrySettings()),
        "pan": Device("pan", "simple", SimpleAxis, SimpleAxisSettings(lower=-100.0, upper=100.0)),
        "camera": Device("camera", "simple", SimpleCamera, SimpleCameraSettings()),
    }
    config = replace(load_bench(bench.bench_file), devices=devices)
    world = replace(bench.world, make=lambda device, clock: makes.get(device.role, device.make)(device.settings, clock))
    return list(examine(config, world, bench.folder))


def test_devices_of_other_drivers_are_connected_and_asked(tmp_path: Path) -> None:
    findings = other_drivers(Workbench(tmp_path))
    wrong = [finding for finding in findings if finding.ok is not Verdict.PASS]
    assert {(finding.subject, finding.what) for finding in wrong} <= {("pan", "state")}, text_of(wrong)
    assert lines(findings) >= {
        ("gantry", "firmware"),
        ("gantry", "state"),
        ("pan", "answers"),
        ("pan", "state"),
        ("camera", "pictures"),
        ("camera", "fresh picture"),
    }


def test_a_dead_device_of_another_driver_is_named(tmp_path: Path) -> None:
    class Dead(SimpleAxis):
        def connect(self) -> Any:
            raise HardwareError("the axis does not answer. Switch it on")

    findings = other_drivers(Workbench(tmp_path), pan=Dead)
    (dead,) = [finding for finding in findings if finding.ok is Verdict.FAIL]
    assert (dead.subject, dead.what) == ("pan", "answers")
    assert (dead.told, dead.remedy) == ("the axis does not answer", "Switch it on")


def test_a_mock_bench_has_nothing_to_look_at(tmp_path: Path) -> None:
    path = tmp_path / "mock.yaml"
    path.write_text("schema: 1\nkind: mock\n")
    with pytest.raises(InputError, match="mock bench"):
        list(examine(load_bench(path), Workbench(tmp_path).world, tmp_path))


@pytest.mark.parametrize("motion", [Motion.MOVING, Motion.HOLDING, Motion.HELD, Motion.HOMING])
def test_a_gantry_that_somebody_else_moves_is_no_healthy_one(motion: Motion) -> None:
    finding = state_finding(GantryStatus(motion, None, False, 0.0))
    assert finding.ok is Verdict.FAIL
    assert "stop it" in finding.remedy


@pytest.mark.parametrize("alarm", [None, 2, 11])
@pytest.mark.parametrize("homed", [True, False])
def test_the_gantrys_state_has_the_name_that_rig_status_gives_it(alarm: int | None, homed: bool) -> None:
    made = bench_with_guard()
    made.guard.connect()
    if homed:
        made.guard.home()
    if alarm is not None:
        made.gantry.raise_alarm(alarm)
    state = made.guard.status().state
    assert state_finding(made.gantry.status()).told.startswith(f"{state.value}: ")


def test_the_gantrys_port_is_asked_for_only_once_it_may_be(tmp_path: Path) -> None:
    opened: list[str] = []
    bench = Workbench(tmp_path)

    def make(device: Device, clock: Any) -> Any:
        opened.append(device.role)
        return bench.make(device, clock)

    bench.findings(make=make, may_use=lambda device: device != GANTRY_PORT)
    assert opened == ["pan", "zoom", "camera"]


@pytest.mark.parametrize(
    ("message", "told", "remedy"),
    [
        ("x is 3. Do this. And that", "x is 3", "Do this. And that"),
        ("from 0 .. 5 of 1.5 mm. Narrow it", "from 0 .. 5 of 1.5 mm", "Narrow it"),
        ("nothing to do", "nothing to do", ""),
    ],
)
def test_a_message_is_told_apart_from_its_remedy(message: str, told: str, remedy: str) -> None:
    assert in_two(message) == (told, remedy)
