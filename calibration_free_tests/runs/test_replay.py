"""A run read back says what was seen live; a damaged one says where it is damaged."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.scripted_run import scripted_models, scripted_steps
from recognition.steps import Outcome, Step
from rig.errors import InputError
from rig.run import RunRecorder, RunStart, read_run, replay, watch


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    keeper = RunRecorder(tmp_path / "run", RunStart(models="three", bench="scripted"), scripted_models())
    watch(keeper.record(scripted_steps()), lambda _: None)
    return tmp_path / "run"


def edit(folder: Path, line: int, text: str | None) -> None:
    lines = (folder / "events.jsonl").read_text().splitlines(keepends=True)
    lines[line - 1 : line] = [] if text is None else [text]
    (folder / "events.jsonl").write_text("".join(lines))


def test_replay_gives_the_steps_back_bit_for_bit(folder: Path) -> None:
    seen: list[Step] = []
    watch(replay(folder), seen.append)
    for live, read in zip(scripted_steps(), seen, strict=True):
        assert read.belief.posterior == live.belief.posterior
        assert read.belief.entropy_bits == live.belief.entropy_bits
        assert read.move == live.move
        assert read.seconds == live.seconds
        assert read.frame.rig_pose == live.frame.rig_pose
        for a, b in zip(read.parts, live.parts, strict=True):
            assert np.array_equal(a.corners_px, b.corners_px)
            assert a.class_scores == b.class_scores
        for mine, theirs in zip(read.belief.leaders[0].matches, live.belief.leaders[0].matches, strict=True):
            assert (mine.part_id, mine.detection) == (theirs.part_id, theirs.detection)


def test_replay_needs_the_events_only(folder: Path) -> None:
    for path in (folder / "views").iterdir():
        path.unlink()
    assert watch(replay(folder), lambda _: None).outcome is Outcome.RECOGNISED


def test_whole_run_is_read_with_its_pictures(folder: Path) -> None:
    run = read_run(folder)
    assert [step.frame.image.shape for step in run.steps] == [(480, 640, 3)] * 4
    assert [thing.id for thing in run.objects] == ["tower", "lean-to", "barn"]
    assert run.answer.outcome is Outcome.RECOGNISED


@pytest.mark.parametrize("line", range(1, 17))
def test_cut_off_line_is_named_after_the_whole_views(folder: Path, line: int) -> None:
    lines = (folder / "events.jsonl").read_text().splitlines(keepends=True)
    (folder / "events.jsonl").write_text("".join(lines[: line - 1]) + lines[line - 1][:-20])
    seen: list[Step] = []
    with pytest.raises(InputError, match=rf"events\.jsonl:{line}: .*cut off"):
        watch(replay(folder), seen.append)
    whole_views = sum(json.loads(text)["kind"] == "belief" for text in lines[: line - 1])
    assert len(seen) == whole_views


@pytest.mark.parametrize("line", range(2, 17))
def test_a_run_killed_while_it_wrote_is_read_on_request_up_to_the_half_line(folder: Path, line: int) -> None:
    lines = (folder / "events.jsonl").read_text().splitlines(keepends=True)
    (folder / "events.jsonl").write_text("".join(lines[: line - 1]) + lines[line - 1][:-20])
    seen: list[Step] = []
    assert watch(replay(folder, allow_partial=True), seen.append).outcome is Outcome.ABORTED
    assert len(seen) == sum(json.loads(text)["kind"] == "belief" for text in lines[: line - 1])


@pytest.mark.parametrize("lines", range(1, 17))
def test_run_without_an_end_is_read_on_request_only(folder: Path, lines: int) -> None:
    text = (folder / "events.jsonl").read_text().splitlines(keepends=True)[:lines]
    (folder / "events.jsonl").write_text("".join(text))
    with pytest.raises(InputError, match=rf"events\.jsonl:{lines}: .*killed"):
        watch(replay(folder), lambda _: None)
    assert watch(replay(folder, allow_partial=True), lambda _: None).outcome is Outcome.ABORTED


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [
        (1, '{"kind": "start", "schema": 99}\n', "schema 99"),
        (3, "[]\n", "not an event"),
        (4, '{"kind": "belief", "view": 0}\n', "not complete"),
        (3, '{"kind": "party"}\n', "not an event"),
        (4, '{"kind": "belief", "view": 0, "posterior": {"tower": "much"}}\n', "not complete"),
        (4, None, "'move' event is not expected"),
        (5, '{"kind": "move", "view": 0}\n', "move event is not complete"),
        (17, '{"kind": "finish", "outcome": "victory"}\n', "not a valid Outcome|not complete"),
        (17, "[" * 100_000 + "\n", "not JSON"),
    ],
)
def test_damaged_line_is_named(folder: Path, line: int, text: str | None, message: str) -> None:
    edit(folder, line, text)
    with pytest.raises(InputError, match=message) as caught:
        watch(replay(folder), lambda _: None)
    assert re.search(rf"events\.jsonl:{line}\b", str(caught.value))


def test_event_after_the_end_is_refused(folder: Path) -> None:
    last = (folder / "events.jsonl").read_text().splitlines()[-1]
    edit(folder, 18, last + "\n")
    with pytest.raises(InputError, match=r"events\.jsonl:18: an event follows"):
        watch(replay(folder), lambda _: None)


def test_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nothing"):
        with pytest.raises(InputError, match="not a run folder"):
            watch(replay(path), lambda _: None)


def test_changed_picture_is_refused(folder: Path) -> None:
    path = folder / "views" / "001.jpg"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"views/001\.jpg: .*SHA-256"):
        read_run(folder)


def test_picture_outside_the_run_is_never_read(folder: Path) -> None:
    event = json.loads((folder / "events.jsonl").read_text().splitlines()[1])
    for file in ("../secret.jpg", "/etc/passwd", "views/../../x"):
        edit(folder, 2, json.dumps({**event, "file": file}) + "\n")
        with pytest.raises(InputError, match="not a file in the run"):
            read_run(folder)
