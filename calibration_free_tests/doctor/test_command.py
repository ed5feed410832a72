"""``rig doctor`` as a person and a script meet it."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rig.doctor
from calibration_free_tests.doctor.sample import BUS_PORT, GANTRY_PORT, Workbench
from calibration_free_tests.doctor.test_discovering import Adapter, around
from rig.bench import load_bench
from rig.cli.app import app
from rig.doctor import DiskLook

Done = tuple[int, str, str]


@pytest.fixture
def bench(tmp_path: Path) -> Workbench:
    return Workbench(tmp_path)


@pytest.fixture
def run(bench: Workbench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    monkeypatch.setattr(rig.doctor, "this_computer", lambda: around(bench))

    def command(*arguments: str) -> Done:
        with pytest.raises(SystemExit) as end:
            app(["doctor", *arguments], prog_name="rig")
        told = capsys.readouterr()
        return int(end.value.code or 0), told.out, told.err

    return command


def test_a_healthy_bench_ends_with_0_and_a_line_for_each_check(bench: Workbench, run: Any) -> None:
    code, out, _ = run(str(bench.bench_file))
    *rows, summary = out.splitlines()
    assert code == 0
    assert all(row.startswith("pass ") for row in rows)
    assert summary == f"{len(rows)} pass"


@pytest.mark.parametrize(("value", "coloured"), [("1", False), ("", True)])
def test_a_person_who_wants_no_colours_gets_none(
    bench: Workbench, run: Any, monkeypatch: pytest.MonkeyPatch, value: str, coloured: bool
) -> None:
    monkeypatch.setenv("NO_COLOR", value)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    _, out, _ = run(str(bench.bench_file))
    assert ("\x1b" in out) is coloured


def test_warnings_are_allowed_and_tell_their_remedy(bench: Workbench, run: Any) -> None:
    bench.pan.temperature_c = 75.0
    code, out, _ = run(str(bench.bench_file))
    (row,) = [row for row in out.splitlines() if row.startswith("warn ")]
    assert code == 0
    assert row.split()[:3] == ["warn", "pan", "temperature"]
    assert "75 °C; at 80 °C it switches itself off. Let it cool" in row


def test_a_failed_check_ends_with_3_and_the_others_are_told(bench: Workbench, run: Any) -> None:
    bench.file["devices"]["pan"]["id"] = 9
    code, out, _ = run(str(bench.bench_file), "--json")
    told = json.loads(out)
    assert code == 3
    assert told["healthy"] is False
    assert told["counts"]["fail"] == 1
    (wrong,) = [finding for finding in told["findings"] if finding["ok"] == "fail"]
    assert wrong == {
        "subject": "pan",
        "what": "answers",
        "ok": "fail",
        "told": "nobody has the id 9; there is id 1 (XM430-W350) at 1000000 baud, id 2 (XL330-M288) at 1000000 baud",
        "remedy": "Set devices.pan.id to the one that is meant",
    }
    assert sum(told["counts"].values()) == len(told["findings"])


def test_the_output_folder_that_is_named_is_tried(bench: Workbench, run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[Path] = []

    def disk(folder: Path) -> DiskLook:
        tried.append(folder)
        return DiskLook(int(1e12), 1e9)

    monkeypatch.setattr(rig.doctor, "this_computer", lambda: replace(around(bench), disk=disk))
    run(str(bench.bench_file), "--out-folder", str(bench.folder / "grids"))
    assert tried == [bench.folder / "grids"]


def test_a_bad_bench_file_ends_with_2_and_its_place(tmp_path: Path, run: Any) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("schema: 1\nkind: live\n")
    code, _, err = run(str(path))
    assert code == 2
    assert "bad.yaml:" in err


@pytest.mark.parametrize("arguments", [[], ["bench.yaml", "--discover"], ["bench.yaml", "--out", "x.yaml"]])
def test_what_does_not_go_together_is_refused(run: Any, arguments: list[str]) -> None:
    assert run(*arguments)[0] == 2


def test_discover_lists_what_answers_and_writes_a_bench_file_that_loads(bench: Workbench, run: Any) -> None:
    path = bench.folder / "new.yaml"
    code, out, err = run("--discover", "--out", str(path))
    assert code == 0
    assert f"port    {GANTRY_PORT}: GRBL 1.1h.20190825 at 115200 baud" in out
    assert f"port    {BUS_PORT}: servo 1, XM430-W350, at 1000000 baud" in out
    assert "restarts some boards" in err
    assert set(load_bench(path).devices) == {"gantry", "pan", "camera"}


def test_discover_for_scripts_is_one_object(run: Any) -> None:
    code, out, _ = run("--discover", "--json")
    assert code == 0
    assert set(json.loads(out)) == {"ports", "cameras"}


def test_discover_overwrites_nothing(bench: Workbench, run: Any) -> None:
    path = bench.bench_file
    before = path.read_text()
    code, _, err = run("--discover", "--out", str(path))
    assert (code, path.read_text()) == (2, before)
    assert "there is a file of that name" in err


def test_discover_without_a_gantry_writes_no_file_and_ends_with_3(
    bench: Workbench, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    lonely = replace(around(bench), adapters=lambda: [Adapter(BUS_PORT)])
    monkeypatch.setattr(rig.doctor, "this_computer", lambda: lonely)
    code, out, err = run("--discover", "--out", str(bench.folder / "new.yaml"))
    assert code == 3
    assert "servo 1" in out
    assert "no gantry was found" in err
    assert not (bench.folder / "new.yaml").exists()


def test_discover_says_so_where_there_is_nothing(bench: Workbench, run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = replace(around(bench), adapters=lambda: [], cameras=lambda: [])
    monkeypatch.setattr(rig.doctor, "this_computer", lambda: empty)
    code, out, _ = run("--discover")
    assert (code, out.split()) == (0, ["port", "none", "camera", "none"])
