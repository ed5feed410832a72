"""What a person is told of each view, live and in a replay."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path

import pytest

from calibration_free_tests.scripted_run import scripted_models, scripted_steps
from rig.hal import RigPose
from rig.run import RunRecorder, RunStart, Steps, replay, watch
from rig.table import LiveTable, describe_move, row_of, summary


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def shown(steps: Steps, stream: io.StringIO) -> str:
    with LiveTable(stream) as table:
        answer = watch(steps, table.show)
    return stream.getvalue() + summary(answer)


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_replay_shows_what_was_shown_live(tmp_path: Path, stream: type[io.StringIO]) -> None:
    keeper = RunRecorder(tmp_path / "run", RunStart("three", "scripted"), scripted_models())
    live = shown(keeper.record(scripted_steps()), stream())
    for path in (tmp_path / "run" / "views").iterdir():
        path.unlink()
    assert shown(replay(tmp_path / "run"), stream()) == live
    assert "374" in live


def test_stream_that_is_no_terminal_gets_plain_lines() -> None:
    text = shown(scripted_steps(), io.StringIO())
    assert "\x1b" not in text
    assert len(text.splitlines()) == 1 + 4 + 3


def test_row_tells_parts_hypotheses_entropy_leader_and_move() -> None:
    row = row_of(next(scripted_steps()))
    assert (row.view, row.parts, row.left, row.bits, row.leading) == ("1", "13", "374", "8.10", "tower 36.0 %")
    assert row.move.startswith("X +190 mm: Half a metre to the right")


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_escape_sequences_in_names_do_not_reach_the_terminal(stream: type[io.StringIO]) -> None:
    text = shown(scripted_steps(labels="\x1b]0;owned\x07[red]x[/red]"), stream())
    assert "\x1b]0" not in text
    assert "\x07" not in text
    assert "[red]" in text.replace("\n", "")


def test_move_names_only_the_axes_that_change() -> None:
    start = RigPose(0, 0, 0, 0, 0.25)
    assert (
        describe_move(start, RigPose(-1200, 0, 2.5, 7.5, 1.0)) == "X -1200 mm, Z +2.5 mm, pan +7.5°, zoom 0.25 to 1.00"
    )
    assert describe_move(start, start) == "stay"
    assert describe_move(RigPose(0, 0, 0, 170, 0), RigPose(0, 0, 0, -170, 0)) == "pan +20.0°"


def test_summary_names_what_is_left_of_an_undecided_run(tmp_path: Path) -> None:
    keeper = RunRecorder(None, RunStart("three", "scripted"))
    text = summary(watch(keeper.record(scripted_steps(1, failure=KeyboardInterrupt())), lambda _: None))
    assert "aborted" in text
    assert "tower at front 2.3, lean-to at front 1.1" in text
    assert "± ? mm" in text


def test_a_pose_less_sure_than_asked_is_said_beside_the_object() -> None:
    answer = watch(scripted_steps(), lambda _: None)
    assert summary(answer).splitlines()[0] == "recognised: tower"
    told = summary(replace(answer, pose_sure=False)).splitlines()[0]
    assert told == "recognised: tower, its pose less sure than asked"


def test_unbounded_deviation_is_said() -> None:
    answer = watch(scripted_steps(), lambda _: None)
    text = summary(replace(answer, pose_sd={"theta_deg": math.inf}, unobservable=("tx against u0",)))
    assert "not determined by these views: tx against u0" in text
    assert "± inf °" in text
