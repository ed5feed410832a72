"""``rig home``, ``move``, ``status`` and ``capture``, as people and scripts meet them, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from calibration_free_tests.cli.person import BENCH, SOON_S, Person, moving, run
from calibration_free_tests.guard.sample import bench as fresh_bench
from rig.imagegrid import read_grid


def test_homing_tells_where_it_stands_and_what_each_device_is(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("home", person.bench) == 0
    text = capsys.readouterr().out
    assert "state   idle" in text
    assert "x 0.000  y 0.000  z 0.000 mm  theta 0.000°" in text
    assert "gantry  idle, homed" in text
    assert "pan     idle, referenced, torque on, 30 °C, 12.0 V" in text
    assert run("home", person.bench, "--theta-deg", 30, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["pose"]["theta_deg"]) == ("idle", 30.0)
    assert told["identities"]["gantry"] == "simulated gantry 1 at nowhere"


def test_a_bench_that_was_just_switched_on_is_homed_and_referenced_by_one_command(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fresh_bench()
    made.gantry.raise_alarm(11)  # as a controller is that wants to be homed
    made.pan.lose_power()
    monkeypatch.setattr("rig.bench.open_live", lambda config: made.guard)
    assert run("home", person.bench) == 1
    told, error = capsys.readouterr()
    assert "state   unhomed" in told
    assert "Look where the pan stands and say it; if at 0: `rig home BENCH --theta-deg 0`" in error
    assert run("home", person.bench, "--json") == 1
    assert json.loads(capsys.readouterr().out)["exit_code"] == 1
    assert run("home", person.bench, "--theta-deg", 30, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["pose"]["theta_deg"]) == ("idle", 30.0)


def test_a_servo_with_a_hardware_error_is_rebooted_homed_and_referenced_by_one_command(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fresh_bench()
    made.pan.overheat()
    monkeypatch.setattr("rig.bench.open_live", lambda config: made.guard)
    assert run("home", person.bench) == 3
    assert "overheated" in capsys.readouterr().err
    made.clock.sleep_s(60.0)
    assert run("home", person.bench, "--reboot", "pan", "--theta-deg", 30, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["pose"]["theta_deg"]) == ("idle", 30.0)


def test_what_needs_no_reboot_gets_none(
    person: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fresh_bench()
    made.gantry.raise_alarm(11)
    monkeypatch.setattr("rig.bench.open_live", lambda config: made.guard)
    assert run("home", person.bench, "--reboot", "pan") == 1
    assert "pan reports no hardware error" in capsys.readouterr().err
    assert made.pan.referenced
    assert run("home", person.bench, "--reboot", "gantry") == 2
    assert made.motions == []


def test_a_move_goes_there_and_by_a_step_and_leaves_other_axes(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("move", person.bench, "--home", "--x-mm", 5, "--theta-deg", -9, "--json") == 0
    pose = json.loads(capsys.readouterr().out)["pose"]
    assert pose == {"x_mm": 5.0, "y_mm": 0.0, "z_mm": 0.0, "theta_deg": -9.0, "zoom": 0.0}
    assert run("move", person.bench, "--home", "--by", "--y-mm", 2, "--json") == 0
    assert json.loads(capsys.readouterr().out)["pose"]["y_mm"] == 2.0


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--x-mm", "5"], 1, "where the rig stands is not known. Home it first"),
        (["--by", "--x-mm", "5"], 2, "dx_mm = 5 is more than 0, the longest jog before homing"),
        (["--home", "--x-mm", "501"], 2, "x_mm = 501 is outside 0 .. 500"),
        (["--home", "--x-mm", "nan"], 2, "x_mm = nan is outside 0 .. 500"),
        (["--home", "--by", "--y-mm", "-1"], 2, "y_mm = -1 is outside 0 .. 400"),
        (["--home", "--zoom", "0.5"], 2, "zoom = 0.5 is outside 0 .. 0"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_message_and_an_exit_code(
    person: Person, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, told: str
) -> None:
    assert run("move", person.bench, *arguments) == code
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("rig: ")
    assert told in error
    assert run("move", person.bench, *arguments, "--json") == code
    out, again = capsys.readouterr()
    assert again == error
    assert json.loads(out) == {"error": error.removeprefix("rig: ").removesuffix("\n"), "exit_code": code}


@pytest.mark.parametrize("arguments", [[], ["--home"], ["--by"]])
def test_a_move_of_no_axis_is_refused_with_the_names_of_all(
    person: Person, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run("move", person.bench, *arguments) == 2
    told = capsys.readouterr().err
    assert "nothing is to be moved. Name one axis or more: --x-mm, --y-mm, --z-mm, --theta-deg, --zoom" in told


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["status", "missing.yaml"], "missing.yaml: there is no such file"),
        (["move", "bench.yaml", "--w-mm", "5"], "No such option: --w-mm"),
        (["home"], "Missing argument 'BENCH'"),
        (["stop"], "no process of yours holds a bench"),
        (["scan", "missing.yaml"], "missing.yaml: there is no such file"),
    ],
)
def test_with_json_an_error_is_one_object_on_stdout_too(
    person: Person, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    assert run(*arguments, "--json") == 2
    out, error = capsys.readouterr()
    found = json.loads(out)
    assert found["exit_code"] == 2
    assert told in found["error"]
    assert told in error


def test_a_mock_bench_moves_nothing_by_hand(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    person.bench.write_text("schema: 1\nkind: mock\n")
    for command in (["home"], ["move", "--x-mm", 5], ["status"], ["stop"]):
        assert run(*command, person.bench) == 2
        assert "this is a mock bench: nothing moves there" in capsys.readouterr().err


def test_the_status_of_a_bench_that_nobody_holds_is_asked_of_its_devices(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("status", person.bench) == 0
    text = capsys.readouterr().out
    assert text.startswith("state   unhomed\npose    not known\n")
    assert "! gantry: not homed" in text
    assert text.endswith(f"next    Home it first (`rig home {person.bench}`, or `--home`)\n")


def test_pictures_by_hand_are_kept_in_one_image_grid_with_their_poses(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = person.folder / "by-hand"
    assert run("capture", person.bench, "--out", folder, "--home", "--x-mm", 900) == 2
    assert "x_mm = 900 is outside 0 .. 500" in capsys.readouterr().err
    assert not folder.exists()
    for x_mm in (3.0, 4.0):
        assert run("capture", person.bench, "--out", folder, "--home", "--x-mm", x_mm, "--json") == 0
        told = json.loads(capsys.readouterr().out)
        assert told["pose"]["x_mm"] == x_mm
        assert Path(told["file"]).exists()
    assert [frame.pose.x_mm for frame in read_grid(folder).frames] == [3.0, 4.0]


def test_a_scan_homes_first_where_it_is_told_to_and_refuses_to_begin_unhomed(
    person: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = person.folder / "plan.yaml"
    plan.write_text("schema: 1\nlattice: {x_mm: [10, 20], y_mm: [5], z_mm: [5], theta_deg: [0], zoom: [0]}\n")
    scan = ("scan", plan, "--bench", person.bench)
    assert run(*scan, "--out", person.folder / "unhomed") == 1
    assert "Home it first" in capsys.readouterr().err
    assert not (person.folder / "unhomed").exists()
    assert run(*scan, "--home", "--out", person.folder / "homed") == 0
    assert [frame.pose.x_mm for frame in read_grid(person.folder / "homed").frames] == [10.0, 20.0]


# Ctrl-C.


@pytest.mark.parametrize("ask", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_once_holds_the_motion_and_ends(person: Person, ask: signal.Signals) -> None:
    with person.running("move", person.bench, "--home", "--x-mm", 500) as mover:
        person.wait_until(moving)
        asked_s = time.monotonic()
        mover.send_signal(ask)
        _, error = mover.communicate(timeout=SOON_S)
    assert mover.returncode == 130
    assert "holding motion" in error
    assert f"motion was held. Home it next (`rig home {person.bench}`, or --home)" in error
    assert "STOP is" not in error
    assert "esume" not in error
    assert time.monotonic() - asked_s < 4.0  # and not when the move would have ended
    assert person.attendance.latch.note() == ""


def test_ctrl_c_twice_is_a_latched_stop(person: Person) -> None:  # 32
    text = BENCH.replace("axes:", "  zoom: {driver: deaf, lower: 0, upper: 1}\naxes:\n  zoom: {speed_per_s: 1}")
    (person.folder / "deaf.py").write_text(DEAF)
    person.environment = dict(person.environment) | {
        "PYTHONPATH": f"{person.environment['PYTHONPATH']}{os.pathsep}{person.folder}"
    }
    info = person.folder / "deaf-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: deaf\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[rig.axes]\ndeaf = deaf:DeafAxis\n")
    person.bench.write_text(text)
    sys.path.insert(0, str(person.folder))
    try:
        with person.running("move", person.bench, "--home", "--zoom", 1) as mover:
            person.wait_until(moving)
            assert mover.stderr is not None
            mover.send_signal(signal.SIGINT)
            assert "Ctrl-C again: STOP" in mover.stderr.readline()
            mover.send_signal(signal.SIGINT)
            _, error = mover.communicate(timeout=SOON_S)
        assert mover.returncode == 130
        assert person.attendance.latch.note().startswith("Ctrl-C twice")
        assert f"STOP: everything is at rest; nothing moves before it is released: rig stop {person.bench} " in error
        assert "Traceback" not in error
    finally:
        sys.path.remove(str(person.folder))


def test_a_scan_that_was_held_goes_on_with_what_it_names(person: Person, capsys: pytest.CaptureFixture[str]) -> None:
    plan, out = person.folder / "plan.yaml", person.folder / "scan"
    plan.write_text("schema: 1\nlattice: {x_mm: [1, 500], y_mm: [5], z_mm: [5], theta_deg: [0], zoom: [0]}\n")
    with person.running("scan", plan, "--bench", person.bench, "--home", "--out", out) as scanner:
        person.wait_until(lambda told: "x_mm 500" in told["running"])
        scanner.send_signal(signal.SIGINT)
        _, error = scanner.communicate(timeout=SOON_S)
    assert scanner.returncode == 130
    hint = f"--home --out {out} --resume"
    assert f"to go on, add {hint}\n" in error
    assert run("scan", plan, "--bench", person.bench, *hint.split()) == 0
    assert [frame.pose.x_mm for frame in read_grid(out).frames] == [1.0, 500.0]


DEAF = '''
"""An axis that heeds only the second of two stops, so that a person must press twice."""
from sim_backends.simple_devices import SimpleAxis

class DeafAxis(SimpleAxis):
    asked = 0

    def move_to(self, position):
        while DeafAxis.asked < 3:
            self.clock.sleep_s(0.01)
        return super().move_to(position)

    def stop(self):
        DeafAxis.asked += 1
        return super().stop()
'''
