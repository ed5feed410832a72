"""Plans are read strictly, spread their trials evenly, and name what their results depend on."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibration_free_tests.evaluate.sample import PLAN, plan_file, small_plan
from rig.errors import InputError
from rig.evaluate.plan import load_plan, shipped_plans


@pytest.mark.parametrize(
    ("good", "bad", "place", "said"),
    [
        ("trials: 6", "trials: 0", "3:9", "greater than or equal to 1"),
        ("trials: 6", 'trials: "6"', "3:9", "Remove the quotes"),
        ("missed: 0.3", "mised: 0.3", "11:13", "Did you mean 'missed'?"),
        ("missed: 0.3", "missed: 1.3", "11:21", "less than or equal to 1"),
        ("name: dirty", "name: clean", "8:11", "there is a row for 'three | information | clean' already"),
        ("models: [three.yaml]\n    rec", "models: [tree.yaml]\n    rec", "6:14", "there is no model base 'tree.yaml'"),
        ("  - name: clean", "  - name: clean\n    policies: [informaton]", "6:16", "Did you mean 'information'?"),
        ("  - name: clean", "  - name: clean\n    policies: none", "6:15", "should be"),
        ("    noise:", "    views: rendered\n    noise:", "8:5", "give `noise` to corner views only"),
        ("  - name: clean", "  - name: clean\n    clutter: true", "5:5", "clutter and experiments need pictures"),
        ("  - name: clean", "  - name: clean\n    without: [random]", "5:5", "leaves policies out of `policies: all`"),
        ("  - name: clean", "  - name: clean\n    bench: one_axes", "6:12", "Did you mean 'one_axis'?"),
    ],
)
def test_a_wrong_plan_is_told_with_its_place(tmp_path: Path, good: str, bad: str, place: str, said: str) -> None:
    file = plan_file(tmp_path, PLAN.replace(good, bad, 1))
    with pytest.raises(InputError) as refused:
        load_plan(str(file))
    assert f"{file}:{place}:" in str(refused.value)
    assert said in str(refused.value)


def test_an_unknown_plan_is_told_with_those_that_ship() -> None:
    with pytest.raises(InputError, match="Did you mean 'field'"):
        load_plan("feild")


@pytest.mark.parametrize("name", shipped_plans())
def test_a_shipped_plan_loads(name: str) -> None:
    plan = load_plan(name)
    assert sum(plan.counts) == plan.trials == len(plan.tasks)
    assert plan.title


def test_the_plans_of_the_issue_ship() -> None:
    assert set(shipped_plans()) >= {"field", "harsh", "rendered", "open_set", "paper", "policies"}
    assert [load_plan(name).trials for name in ("field", "harsh", "rendered", "open_set")] == [
        10_000,
        10_000,
        1000,
        1000,
    ]


def test_all_policies_get_the_same_seeds() -> None:
    plan = load_plan("policies").of(trials=12 * len(load_plan("policies").rows))
    seeds = [[task.seed for task in plan.tasks if task.row == row] for row in plan.rows]
    assert len({row.policy for row in plan.rows}) >= 3
    assert seeds == [list(range(12))] * len(plan.rows)


def test_trials_are_spread_evenly_whatever_their_number(tmp_path: Path) -> None:
    plan = small_plan(tmp_path)
    assert plan.counts == (3, 3)
    assert plan.of(trials=7).counts == (4, 3)
    assert plan.of(trials=1).counts == (1, 0)
    assert len(plan.of(trials=7).tasks) == 7
    assert {task.seed for task in plan.of(seed=40).tasks} == {40, 41, 42}


def test_the_digest_is_of_all_that_results_depend_on_and_of_nothing_else(tmp_path: Path) -> None:
    plan = small_plan(tmp_path)
    assert plan.sha256 == plan.of(trials=99).sha256 == small_plan(tmp_path).sha256
    assert plan.of(seed=1).sha256 != plan.sha256
    assert small_plan(tmp_path, PLAN.replace("0.3", "0.4")).sha256 != plan.sha256
    assert small_plan(tmp_path, PLAN.replace("trials: 6", "trials: 8")).sha256 == plan.sha256
    before = plan.sha256
    models = tmp_path / "three.yaml"
    models.write_text(models.read_text() + "# another version\n")
    assert load_plan(str(tmp_path / "plan.yaml")).sha256 != before
