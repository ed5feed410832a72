"""What the benchmarks call right, wrong and undecided, and that they count every trial once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.trials import keep, kept_trials, table
from recognition.geometry import CameraPose
from recognition.steps import Answer, BeliefSummary, Outcome, Step, StepSeconds
from rig.evaluate.trial import RIGHT, UNDECIDED, WRONG, Trial, scored
from rig.hal import Frame, RigPose

TRUE = CameraPose(179.5, 100.0, -50.0, 2000.0)
SURE = {"theta_deg": 0.1, "x_mm": 5.0, "y_mm": 7.0, "z_mm": 6.0}


def step(index: int = 0) -> Step:
    pose = RigPose(0.0, 0.0, 0.0, 0.0)
    frame = Frame(np.zeros((1, 1), dtype=np.uint8), pose, pose, "a.jpg", index)
    belief = BeliefSummary({"castle": 0.9, "unknown": 0.1}, 7 - index, 1.5, ())
    return Step(index, frame, (), belief, None, StepSeconds(0.1, 0.2, 0.3))


def answer(outcome: Outcome, thing: str | None, pose: CameraPose | None) -> Answer:
    return Answer(outcome, thing, (), {}, pose, SURE if pose else {}, (), "because", 0.0, 0.0)


def score(outcome: Outcome, thing: str | None, pose: CameraPose | None, placed: bool = False) -> Trial:
    return scored("a", answer(outcome, thing, pose), [step(), step(1)], "castle", TRUE, 300.0, 2.0, placed)


@pytest.mark.parametrize(
    ("pose", "kind"),
    [
        (TRUE, RIGHT),
        (replace(TRUE, x_mm=399.0), RIGHT),
        (replace(TRUE, x_mm=401.0), WRONG),
        (replace(TRUE, x_mm=300.0, y_mm=150.0, z_mm=2200.0), WRONG),  # 346 mm off, though no axis is more than 200
        (replace(TRUE, theta_deg=-179.0), RIGHT),  # 1.5 degrees the short way round
        (replace(TRUE, theta_deg=-178.0), WRONG),
    ],
)
def test_right_needs_position_and_pan_within_the_tolerance(pose: CameraPose, kind: str) -> None:
    assert score(Outcome.RECOGNISED, "castle", pose).kind == kind


def test_a_look_alike_is_wrong_wherever_the_camera_is() -> None:
    assert score(Outcome.RECOGNISED, "castle_mirrored", TRUE).kind == WRONG
    assert score(Outcome.RECOGNISED, "castle_mirrored", TRUE, placed=True).kind == WRONG


@pytest.mark.parametrize("outcome", [outcome for outcome in Outcome if outcome is not Outcome.RECOGNISED])
def test_whatever_is_not_recognised_is_undecided(outcome: Outcome) -> None:
    assert score(outcome, None, TRUE).kind == UNDECIDED
    assert score(outcome, None, None).kind == UNDECIDED


def test_a_place_known_to_be_right_counts_but_is_not_called_near() -> None:
    trial = score(Outcome.RECOGNISED, "castle", replace(TRUE, z_mm=2900.0), placed=True)
    assert (trial.kind, trial.near, trial.error_mm) == (RIGHT, False, 900.0)


def test_the_least_sure_axis_is_told() -> None:
    trial = score(Outcome.RECOGNISED, "castle", TRUE)
    assert (trial.sd_mm, trial.sd_deg, trial.views, trial.first_left) == (7.0, 0.1, 2, 7)


def test_trials_that_were_kept_come_back_the_same(tmp_path: Path) -> None:
    path = tmp_path / "kept.jsonl"
    trials = [
        replace(score(Outcome.RECOGNISED, "castle", TRUE), name="a"),
        replace(score(Outcome.NOT_FOUND, None, None), name="b"),
    ]
    assert kept_trials(path) == {}
    for trial in trials:
        keep(path, trial)
    assert kept_trials(path) == {trial.name: trial for trial in trials}


def test_the_table_counts_all_trials_and_takes_errors_of_the_right_ones() -> None:
    right = score(Outcome.RECOGNISED, "castle", replace(TRUE, x_mm=110.0))
    wrong = score(Outcome.RECOGNISED, "castle", replace(TRUE, x_mm=9100.0))
    lines = table("all", [right, right, right, wrong]).splitlines()
    assert lines[0] == "all: 4 runs: right 3 (75.0%), wrong 1 (25.0%), undecided 0 (0.0%)"
    assert any("pose error, mm" in line and "most 10.0" in line for line in lines)
    assert any("step, s" in line and "median 0.600" in line for line in lines)
    assert table("none", []) == "none: no trials"
