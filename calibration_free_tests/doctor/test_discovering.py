"""What is connected is found without a bench file; the first bench file loads, is careful, and passes the doctor."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.doctor.sample import BUS_PORT, CAMERA, GANTRY_PORT, HEALTHY_FIRMWARE, Workbench, text_of
from drivers.dynamixel.settings import DynamixelSettings
from drivers.grbl_settings import GrblSettings
from rig.bench import LiveBenchFile, load_bench
from rig.devices import Identity
from rig.doctor import Surroundings, Verdict, discover, examine, first_bench, found_object
from rig.doctor.discovery import Seen, SeenGantry, SeenPort
from rig.doctor.first_bench import limits_of
from rig.doctor.surroundings import stable_name
from rig.errors import HardwareError
from sim_backends.faults import Fault, FaultKind
from sim_backends.grbl_emulator.dialects import FLUIDNC, GRBL_1_1, GRBLHAL, Dialect


@dataclass
class Adapter:
    """A serial port as pyserial lists it."""

    device: str
    vid: int | None = 0x0403
    pid: int | None = 0x6014
    serial_number: str | None = None


def around(bench: Workbench, **changes: Any) -> Surroundings:
    """The computer that the bench is connected to."""
    return replace(
        bench.world,
        adapters=lambda: [Adapter(BUS_PORT), Adapter(GANTRY_PORT), Adapter("/dev/ttyS0", vid=None)],
        stable_name=lambda device: device,
        cameras=lambda: [bench.found_camera, replace(bench.found_camera, index=1)],
        open_gantry=bench.open_gantry,
        open_bus=bench.open_bus,
        **changes,
    )


@pytest.mark.parametrize("dialect", [GRBL_1_1, GRBLHAL, FLUIDNC], ids=lambda dialect: dialect.name)
def test_gantry_servos_and_camera_are_found_and_nothing_is_touched(tmp_path: Path, dialect: Dialect) -> None:
    bench = Workbench(tmp_path, dialect)
    with bench.untouched():
        found = found_object(discover(around(bench)))
    gantry, servos = found["ports"]
    assert (gantry["port"], servos["port"]) == (GANTRY_PORT, BUS_PORT)
    assert gantry["answers"][0].startswith(dialect.name)
    assert gantry["answers"][0].endswith("at 115200 baud")
    assert servos["answers"] == [
        "servo 1, XM430-W350, at 1000000 baud",
        "servo 2, XL330-M288, at 1000000 baud",
    ]
    assert found["cameras"] == [{"path": CAMERA, "identity": "Bench camera 046d:0825 1234"}]


def test_servos_at_any_baud_rate_are_found(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    bench.pan.write(8, b"\x01")
    answers = found_object(discover(around(bench)))["ports"][1]["answers"]
    assert answers == ["servo 1, XM430-W350, at 57600 baud", "servo 2, XL330-M288, at 1000000 baud"]


def test_a_gantry_never_hears_packets_for_servos(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    bench.gantry_baud = 57600
    discover(around(bench))
    assert b"\xff\xff\xfd" not in b"".join(data for _, data in bench.gantry_wire.written)


def test_a_port_where_nobody_answers_is_told(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    bench.machine.apply_fault(Fault(FaultKind.HANG, at_s=0.0))
    found = discover(around(bench))
    assert found.gantry is None
    assert found_object(found)["ports"][0] == {"port": GANTRY_PORT, "answers": [], "trouble": ""}
    with pytest.raises(HardwareError, match="no gantry was found"):
        first_bench(found)


def test_a_port_that_cannot_be_opened_is_told_with_its_remedy(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)

    def refuse(*_: Any) -> Any:
        raise HardwareError(f"{BUS_PORT}: in use by process 4711. Stop that process")

    world = replace(around(bench), open_bus=refuse, open_gantry=refuse)
    assert {port["trouble"] for port in found_object(discover(world))["ports"]} == {
        f"{BUS_PORT}: in use by process 4711. Stop that process"
    }


@pytest.mark.parametrize("dialect", [GRBL_1_1, GRBLHAL, FLUIDNC], ids=lambda dialect: dialect.name)
def test_the_first_bench_file_loads_and_passes_the_doctor(tmp_path: Path, dialect: Dialect) -> None:
    bench = Workbench(tmp_path, dialect)
    path = tmp_path / "first.yaml"
    path.write_text(first_bench(discover(around(bench))))
    config = load_bench(path)
    findings = list(examine(config, bench.world, tmp_path))
    wrong = [f for f in findings if f.ok is not Verdict.PASS and f.what != "keep-out"]
    assert not wrong, text_of(wrong)
    assert "TODO" not in path.read_text()


def test_the_first_bench_file_stays_inside_the_firmwares_travel_at_half_its_speed(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    path = tmp_path / "first.yaml"
    path.write_text(first_bench(discover(around(bench))))
    config = load_bench(path)
    gantry, pan = config.devices["gantry"].settings, config.devices["pan"].settings
    assert isinstance(gantry, GrblSettings)
    assert isinstance(pan, DynamixelSettings)
    assert [(axis.lower_mm, axis.upper_mm) for axis in gantry.axes] == [(-398.0, -2.0), (-298.0, -2.0), (-198.0, -2.0)]
    assert [axis.feed_mm_per_min for axis in gantry.axes] == [3000.0, 3000.0, 1500.0]
    assert (pan.id, pan.model, pan.mode, pan.role.lower, pan.role.upper) == (1, "XM430-W350", "extended", -30.0, 30.0)
    assert set(config.devices) == {"gantry", "pan", "camera"}  # a zoom ring only once its table is measured
    assert isinstance(config.file, LiveBenchFile)
    assert config.file.axes.theta_deg is not None
    assert config.devices["camera"].settings.model_dump()["usb_id"] == "046d:0825"


def test_the_marks_taken_off_the_zoom_ring_leave_a_file_that_loads(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    path = tmp_path / "first.yaml"
    text = first_bench(discover(around(bench)))
    path.write_text(re.sub(r"^  # (zoom:.*|  [a-z]+: .*)$", r"  \1", text, flags=re.MULTILINE))
    zoom = load_bench(path).devices["zoom"].settings
    assert isinstance(zoom, DynamixelSettings)
    assert (zoom.id, zoom.model, zoom.role.zero_ticks) == (2, "XL330-M288", 2500)


def test_a_zero_at_home_and_settings_that_are_not_told_still_give_careful_limits() -> None:
    def limits(kind: str, firmware: dict[int, float]) -> list[tuple[float, float, float]]:
        return limits_of(SeenGantry("port", 115200, Identity(kind, "", ""), firmware))

    assert limits("grblHAL", {**HEALTHY_FIRMWARE, 22: 9, 23: 1})[:2] == [(2.0, 398.0, 3000.0), (-298.0, -2.0, 3000.0)]
    assert limits("FluidNC", {}) == [(-98.0, -2.0, 250.0)] * 3
    assert limits("GRBL", {**HEALTHY_FIRMWARE, 130: 5, 120: 1})[0] == (-4.5, -0.5, 60.0)


def test_without_a_camera_or_servos_the_file_loads_and_the_doctor_names_what_is_missing(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    world = replace(around(bench), adapters=lambda: [Adapter(GANTRY_PORT)], cameras=lambda: [])
    path = tmp_path / "first.yaml"
    path.write_text(first_bench(discover(world)))
    config = load_bench(path)
    assert set(config.devices) == {"gantry", "camera"}
    from drivers.camera_identity import find_camera

    findings = list(examine(config, replace(bench.world, find_camera=find_camera), tmp_path))
    (camera,) = [f for f in findings if f.ok is Verdict.FAIL]
    assert (camera.subject, camera.what) == ("camera", "identity")
    assert "no such camera" in camera.told


def test_what_devices_say_of_themselves_cannot_break_the_file(tmp_path: Path) -> None:
    evil = Identity("GRBL", "1.1h\nkind: mock", "")
    seen = Seen((SeenPort('/dev/"x', SeenGantry('/dev/"x: #', 115200, evil, HEALTHY_FIRMWARE)),), ())
    path = tmp_path / "first.yaml"
    path.write_text(first_bench(seen))
    settings = load_bench(path).devices["gantry"].settings
    assert isinstance(settings, GrblSettings)
    assert settings.port == '/dev/"x: #'


def test_a_port_is_named_by_where_it_is_plugged_in(tmp_path: Path) -> None:
    by_path, by_id = tmp_path / "by-path", tmp_path / "by-id"
    for folder in (by_path, by_id):
        folder.mkdir()
        (folder / "adapter").symlink_to(tmp_path / "ttyUSB0")
    (tmp_path / "ttyUSB0").touch()
    assert stable_name(str(tmp_path / "ttyUSB0"), (by_path, by_id)) == str(by_path / "adapter")
    assert stable_name(str(tmp_path / "ttyUSB1"), (by_path, by_id)) == str(tmp_path / "ttyUSB1")
