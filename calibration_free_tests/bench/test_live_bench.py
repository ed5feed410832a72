"""Live bench files are read strictly, drivers' settings too; what is wrong is told with its place and a remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibration_free_tests.bench.plugins import install
from drivers.stopping_all import one_after_another
from rig.bench import BenchConfig, load_bench, open_live, open_rig
from rig.errors import InputError
from rig.guard import Box, Guard
from rig.hal import RigPose
from sim_backends.simulated_clock import SimulatedClock

REAL = """\
schema: 1
kind: live
devices:
  gantry:
    driver: grbl
    port: /dev/serial/by-path/a
    x: {lower_mm: -398, upper_mm: -1, feed_mm_per_min: 5000}
    y: {lower_mm: -298, upper_mm: -1, feed_mm_per_min: 5000}
    z: {lower_mm: -198, upper_mm: -1, feed_mm_per_min: 2500}
  pan: {driver: dynamixel, port: b, id: 1, model: XM430-W350, mode: extended,
    role: {kind: pan, lower_deg: -100, upper_deg: 100}}
  camera: {driver: opencv, source: "http://127.0.0.1:8000/stream"}
axes:
  x_mm: {lower: 0, upper: 390, speed_mm_per_s: 80, offset_mm: 399}
  y_mm: {lower: 0, upper: 290, speed_mm_per_s: 80, offset_mm: 299}
  z_mm: {lower: 0, upper: 190, speed_mm_per_s: 40, offset_mm: 199}
  theta_deg: {lower: -90, upper: 90, speed_deg_per_s: 30}
safety: {keep_out: [{name: model, x_mm: [100, 200], y_mm: [0, 100], z_mm: [50, 100]}], margin_mm: 30}
mount: {x_mm: 3, z_mm: 25}
"""
SIMPLE = """\
schema: 1
kind: live
devices:
  gantry: {driver: simple}
  zoom: {driver: simple, lower: 0, upper: 1}
  camera: {driver: simple}
axes:
  x_mm: {lower: -200, upper: 200, speed_mm_per_s: 100, sign: -1, offset_mm: 250, backlash_mm: 2, approach: from_above}
  y_mm: {lower: 0, upper: 400, speed_mm_per_s: 100, scale: 1.002}
  z_mm: {lower: 0, upper: 250, speed_mm_per_s: 100}
  zoom: {speed_per_s: 0.5}
  squareness_deg: {xy: 0.2, yz: -0.1}
safety: {homing: as_found, stale_s: 2, tolerance_mm: 0.1}
views: {step_mm: 50, zooms: [0, 0.5], reach: 1}
timing: {settle_s: 0.3, exposure_s: 0.05}
"""


@pytest.fixture(autouse=True)
def drivers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = {"broken": "sim_backends.simple_devices:NoSuchGantry", "absent": "no_such_package:Gantry"}
    monkeypatch.syspath_prepend(str(install(tmp_path / "drivers", gantries=broken)))


def written(folder: Path, text: str) -> Path:
    path = folder / "bench.yaml"
    path.write_text(text)
    return path


def load(folder: Path, text: str) -> BenchConfig:
    return load_bench(written(folder, text))


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        # Drivers.
        ("grbl\n", "grlb\n", "5:13: devices.gantry.driver: there is no driver 'grlb'. Did you mean 'grbl'? Installed"),
        ("opencv", "dynamixel", "there is no driver 'dynamixel'. Installed (rig.cameras): opencv, simple."),
        ("grbl\n", "broken\n", "5:13: devices.gantry.driver: the driver 'broken' cannot be loaded"),
        ("grbl\n", "absent\n", "No module named 'no_such_package'). Install what it needs, or another version of it."),
        ("driver: opencv, ", "", "12:11: devices.camera.driver: this key is missing. Add `driver: ...`."),
        # Their settings.
        ("port: /dev", "prt: /dev", "6:5: devices.gantry.prt: unknown key. Did you mean 'port'?"),
        ("feed_mm_per_min: 2500", "feed_mm_s: 42", "feed_mm_s: unknown key. Did you mean 'feed_mm_per_min'?"),
        ("id: 1", "id: 1.5", "10:41: devices.pan.id: should be a whole number, not 1.5"),
        ("id: 1", "id: '1'", "devices.pan.id: should be a whole number, not the text '1'. Remove the quotes."),
        ("-398", "5", "7:8: devices.gantry.x: lower_mm 5.0 must be below upper_mm -1.0"),
        ("XM430-W350", "XM43", "10:8: devices.pan: model 'XM43' is none of XL330-M077"),
        ("mode: extended", "mode: fast", "devices.pan.mode: should be 'position', 'extended' or 'current_based'"),
        ("kind: pan,", "kind: tilt,", "11:18: devices.pan.role.kind: should be 'pan' or 'zoom', not the text 'tilt'"),
        ("kind: pan,", "", "11:11: devices.pan.role.kind: this key is missing. Add `kind: ...`."),
        # Axes, with units in their names.
        ("speed_mm_per_s: 40", "speed_deg_per_s: 40", "16:32: axes.z_mm.speed_deg_per_s: unknown key. Did you mean"),
        ("lower: -90", "lower: 95", "axes.theta_deg: lower (95) should be below upper (90)"),
        ("upper: 290", "upper: .inf", "15:27: .inf is not a finite number"),
        ("upper: 290", "upper: '290'", "15:27: axes.y_mm.upper: should be a number, not the text '290'. Remove"),
        ("offset_mm: 199", "scale: 25.4", "axes.z_mm.scale: should be less than 2 (it is 25.4)"),
        ("offset_mm: 199", "sign: 2", "axes.z_mm.sign: should be 1 or -1, not 2"),
        ("offset_mm: 199", "backlash_mm: 190", "16:9: axes.z_mm: a backlash of 190 leaves no travel"),
        ("offset_mm: 199", "backlash_mm: -1", "axes.z_mm.backlash_mm: should be greater than or equal to 0"),
        ("  theta_deg: {lower: -90, upper: 90, speed_deg_per_s: 30}\n", "", "give both devices.pan and axes.theta_deg"),
        # Backlash is the guard's.
        ("2500", "2500, backlash_mm: 1", "9:62: devices.gantry.z.backlash_mm: the guard has to know of backlash"),
        ("2500", "2500, backlash_mm: 1", "Say it under axes (`backlash_mm`, `backlash_deg`), and leave it out here."),
        # Safety.
        ("margin_mm: 30", "margin_mm: 25", "18:99: safety.margin_mm: 25 mm is shorter than the mount's lever arm (25"),
        (", margin_mm: 30", "", "18:9: safety.margin_mm: 0 mm is shorter"),
        ("margin_mm: 30", "margin: 30", "18:88: safety.margin: unknown key. Did you mean 'margin_mm'?"),
        ("[100, 200]", "[200, 100]", "safety.keep_out[0]: x_mm should rise from the smallest to the largest value"),
        ("margin_mm: 30", "margin_mm: 30, homing: always", "should be 'each_session', 'remembered' or 'as_found'"),
        ("margin_mm: 30", "margin_mm: 30, tolerance_mm: 0", "safety.tolerance_mm: should be greater than 0"),
        ("margin_mm: 30", "margin_mm: 30, stale_s: .nan", ".nan is not a finite number"),
        # YAML itself.
        ("id: 1", "id: 1, id: 2", "10:44: the key 'id' stands twice in the same place. Keep one of the two."),
        ("port: b", "port: !!str b", "tags such as tag:yaml.org,2002:str are not used here"),
        ("x_mm: 3, z", "x_mm: &a 3, y_mm: *a, z", "anchors (&) and aliases (*) are not used here"),
        ("kind: live", "kind: alive", "2:7: kind: should be 'mock' or 'live', not the text 'alive'"),
        ("kind: live", "kind: live\ngrid: x", "unknown key"),
    ],
)
def test_what_is_wrong_is_told_with_its_place_and_remedy(tmp_path: Path, before: str, after: str, told: str) -> None:
    assert before in REAL
    with pytest.raises(InputError) as caught:
        load(tmp_path, REAL.replace(before, after, 1))
    assert caught.value.exit_code == 2
    assert told in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path}/bench.yaml:")


def test_everything_that_is_wrong_with_the_devices_is_told_at_once(tmp_path: Path) -> None:
    text = REAL.replace("driver: grbl\n", "driver: grlb\n").replace("id: 1", "id: 300").replace("source", "sauce")
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    assert len(str(caught.value).splitlines()) == 4
    for told in ("there is no driver 'grlb'", "devices.pan.id: ", "devices.camera.sauce", "devices.camera.source"):
        assert told in str(caught.value)


def test_what_the_file_says_is_what_the_guard_demands(tmp_path: Path) -> None:
    rules = load(tmp_path, REAL).file.rules  # type: ignore[union-attr]  # a live file
    assert rules.keep_out == (Box("model", (70.0, -30.0, 20.0), (230.0, 130.0, 130.0), 30.0),)
    assert (rules.homing, rules.unhomed_jog_mm, rules.stale_s) == ("each_session", 0.0, 1.0)
    assert (rules.travel.zoom.lower, rules.travel.zoom.upper) == (0.0, 0.0)
    assert dict(rules.overshoot) == {}
    rules = load(tmp_path, SIMPLE).file.rules  # type: ignore[union-attr]  # a live file
    assert dict(rules.overshoot) == {"x_mm": -2.0}
    assert rules.usable.x_mm.upper == 198.0
    assert (rules.homing, rules.tolerance.mm, rules.offers.zooms) == ("as_found", 0.1, (0.0, 0.5))
    assert (rules.travel.settle_s, rules.travel.exposure_s) == (0.3, 0.05)


def test_bench_files_with_the_gantry_on_the_same_port_are_the_same_bench(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    assert load(tmp_path, REAL).key == load(other, REAL.replace("margin_mm: 30", "margin_mm: 40")).key
    assert load(tmp_path, REAL).key != load(other, REAL.replace("by-path/a", "by-path/b")).key
    assert load(tmp_path, SIMPLE).key != load(other, SIMPLE).key


def test_a_bench_file_becomes_a_guarded_rig_that_is_not_connected(tmp_path: Path) -> None:
    clock = SimulatedClock()
    guard = open_live(load(tmp_path, SIMPLE), clock=clock, runtime=tmp_path, stops=one_after_another)
    assert isinstance(guard, Guard)
    with guard:
        guard.home()
        target = RigPose(10.0, 20.0, 30.0, 0.0, 0.25)
        back = guard.move_to(target)
        assert (back.x_mm, back.y_mm, back.z_mm, back.zoom) == pytest.approx((10.0, 20.0, 30.0, 0.25))
        frame = guard.capture()
        assert frame.rig_pose == guard.pose
        assert sorted(path.suffix for path in tmp_path.iterdir() if path.is_socket()) == [".sock"]
    assert not list(tmp_path.glob("*.sock"))


def test_a_mock_bench_is_not_opened_as_a_live_one_and_a_live_one_needs_no_grid(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="this is a mock bench: nothing moves there"):
        open_live(load(tmp_path, "schema: 1\nkind: mock\n"))
    with pytest.raises(InputError, match="a live bench takes its own pictures"):
        open_rig(load(tmp_path, SIMPLE), tmp_path)


def test_drivers_construct_nothing_and_open_nothing_on_loading(tmp_path: Path) -> None:
    config = load(tmp_path, REAL)
    assert {role: device.driver for role, device in config.devices.items()} == {
        "gantry": "grbl",
        "pan": "dynamixel",
        "camera": "opencv",
    }
    assert config.devices["gantry"].settings.port == "/dev/serial/by-path/a"  # type: ignore[attr-defined]  # GRBL's
