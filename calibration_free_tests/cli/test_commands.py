"""What holds for every command: help with an example, and quick."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from recognition.modelbase_io import load_model_base
from rig.cli.app import app

RIG = str(Path(sys.executable).with_name("rig"))
HEAVY = ("numpy", "numba", "cv2", "scipy", "matplotlib", "pydantic", "yaml", "rich", "jinja2")


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield path
    for name, command in getattr(group, "commands", {}).items():
        yield from commands(command, (*path, name))


EVERY = list(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("path", EVERY, ids=" ".join)
def test_every_command_has_help_with_an_example(path: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app([*path, "--help"], prog_name="rig")
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert "Example:" in text
    assert " ".join(["  rig", *path]).rstrip() in text


def test_commands_of_the_design_are_there() -> None:
    names = {" ".join(path) for path in EVERY}
    assert names >= {"demo", "recognise", "simulate", "scan", "report", "replay"}
    assert names >= {"model check", "model show", "import lightfield"}


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import json, sys\nfrom rig.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(json.loads(done.stderr))
    assert not loaded.intersection(HEAVY)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["replya"], "Did you mean 'replay'"),
        (["replay"], "Missing argument"),
        (["replay", "--bogus"], "No such option"),
        (["recognise", "--models", "architecture", "--threshold", "much", "--grid", "x"], "--threshold"),
        (["recognise", "--grid", "x"], "Missing option '--models'"),
        (["recognise", "--models", "architecture", "--grid", "x", "--policy", "infomation"], "mean 'information'"),
        (["recognise", "--models", "architecture", "--grid", "x", "--detector", "segmentatoin"], "segmentation"),
        (["recognise", "--models", "architecture", "--grid", "x", "--mode", "papre"], "graded"),
        (["simulate", "architecture", "GG", "grid"], "Choose one of: LH, DS, GH"),
        (["import", "lightfield", ".", "grid"], "r00_c16.jpg"),
        (["replay", "nowhere"], "not a run folder"),
        (["report", "nowhere"], "not a run folder"),
        (["model", "check", "architectur"], "Did you mean 'architecture'"),
        (["model", "check", "missing.yaml"], "missing.yaml"),
        (["model", "show", "architecture", "--out", "picture.gif"], ".png"),
    ],
)
def test_bad_input_is_one_message_and_exit_code_2(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = subprocess.run([RIG, *arguments], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    from importlib.metadata import version

    with pytest.raises(SystemExit):
        app(["--version"], prog_name="rig")
    assert capsys.readouterr().out.strip() == version("calibration-free-rig")


def test_model_check_tells_how_parts_stand_to_their_neighbours(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        app(["model", "check", "architecture", "--links", "--json"], prog_name="rig")
    found = json.loads(capsys.readouterr().out)["links"]
    assert {link["from"] for link in found["LH"]} == {
        part.id for part in load_model_base("architecture").objects[0].parts
    }
    first = found["LH"][0]
    with pytest.raises(SystemExit):
        app(["model", "check", "architecture", "--links"], prog_name="rig")
    x, y, z = first["translation_mm"]
    line = f"{first['from']} to {first['to']}: {x:+.1f}, {y:+.1f}, {z:+.1f} mm, turned by "
    assert line in capsys.readouterr().out


def test_model_check_counts_parts_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app(["model", "check", "architecture", "--json"], prog_name="rig")
    assert end.value.code == 0
    assert json.loads(capsys.readouterr().out)["by_object"] == {"LH": 167, "DS": 170, "GH": 122}


def test_model_show_draws_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "a.png"
    with pytest.raises(SystemExit) as end:
        app(["model", "show", "architecture", "--out", str(picture)], prog_name="rig")
    assert end.value.code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("debug", [False, True])
def test_internal_error_shows_a_traceback_only_on_request(
    debug: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("the moon is full")

    monkeypatch.setattr("recognition.modelbase_io.load_model_base", fail)
    if debug:
        with pytest.raises(ZeroDivisionError):
            app(["--debug", "model", "check", "x"], prog_name="rig")
        return
    with pytest.raises(SystemExit) as end:
        app(["model", "check", "x"], prog_name="rig")
    assert end.value.code == 1
    message = capsys.readouterr().err
    assert "ZeroDivisionError: the moon is full" in message
    assert "--debug" in message
    assert len(message.splitlines()) == 1


def test_interrupt_outside_a_run_is_exit_code_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("recognition.modelbase_io.load_model_base", interrupt)
    with pytest.raises(SystemExit) as end:
        app(["model", "check", "x"], prog_name="rig")
    assert end.value.code == 130


def test_closed_pipe_is_no_traceback(tmp_path: Path) -> None:
    command = f"{RIG} model check architecture | head -c 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
