"""The page of an evaluation: self-contained, and harmless whatever names a plan has."""

from __future__ import annotations

import re
from pathlib import Path

from calibration_free_tests.evaluate.sample import PLAN, small_plan
from calibration_free_tests.evaluate.test_figures import record
from rig.evaluate.figures import summary
from rig.evaluate.page import render
from rig.evaluate.plan import Plan


def page(plan: Plan, wrong: int = 1, errors: int = 0) -> str:
    records = {}
    for k, task in enumerate(plan.tasks):
        kind = "wrong" if k < wrong else "right"
        told = {
            "outcome": "recognised",
            "named": "mill",
            "true_object": "barn",
            "why": "it <b>fits</b>",
            "log": ["v 1"],
        }
        records[task.key] = {**record(task.number, kind, 0.999, **told), "row": task.row.key}
    for task in plan.tasks[wrong : wrong + errors]:
        records[task.key] = {"row": task.row.key, "number": task.number, "seed": task.seed, "error": "<i>no</i>"}
    return render(plan, records, summary(plan, records, [1.5] * len(plan.rows), "here"))


def test_the_page_needs_nothing_from_elsewhere(tmp_path: Path) -> None:
    text = page(small_plan(tmp_path))
    assert re.findall(r'(?:src|href)="(?!#)', text) == []
    assert "url(http" not in text
    assert text.count("<svg") == 6


def test_wrong_answers_are_listed_with_their_seeds(tmp_path: Path) -> None:
    text = page(small_plan(tmp_path), wrong=1)
    assert "seed 0, " in text
    assert "barn was there; recognised: mill" in text
    assert "Answers that were wrong" not in page(small_plan(tmp_path), wrong=0)


def test_trials_that_failed_are_listed(tmp_path: Path) -> None:
    text = page(small_plan(tmp_path), errors=2)
    assert text.count("&lt;i&gt;no&lt;/i&gt;") == 2
    assert "4 of 6 trials are done" in text


def test_names_from_plans_are_text(tmp_path: Path) -> None:
    plan = small_plan(tmp_path, PLAN.replace("name: clean", "name: '<script>x</script>'"))
    text = page(plan)
    assert "<script>" not in text
    assert "it &lt;b&gt;fits" in text


def test_without_any_trial_there_is_still_a_page(tmp_path: Path) -> None:
    plan = small_plan(tmp_path)
    text = render(plan, {}, summary(plan, {}, [None, None], "here"))
    assert "0 of 6 trials are done" in text
    assert "<svg" not in text


def test_equal_results_give_equal_pages(tmp_path: Path) -> None:
    plan = small_plan(tmp_path)
    assert page(plan) == page(plan)
