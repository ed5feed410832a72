"""How few views can do: the exact optimum, its lower bound, and how near the policies come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from benchmarks.bench_policies import SCORES, Score, as_paper, as_set, by_score, by_tree, draw
from calibration_free_tests.policies.tables import FloatArray, IntArray, tables, told
from recognition.policies.bounds import code_length, exact_views, expected_views, least_views
from recognition.policies.optimal import MOST_CANDIDATES, MOST_HYPOTHESES, views_of_each
from recognition.policies.strategy import Node, Planner
from rig.errors import InputError

Table = tuple[IntArray, FloatArray]


def every_tree(table: IntArray, weight: FloatArray, members: tuple[int, ...]) -> float:
    """The fewest expected views, by trying every view at every node, with no table of what is known."""
    tried = []
    for row in table:
        groups = [tuple(m for m in members if row[m] == shown) for shown in {int(row[m]) for m in members}]
        if len(groups) > 1:
            left = sum(weight[list(g)].sum() * every_tree(table, weight, g) for g in groups)
            tried.append(1.0 + left / weight[list(members)].sum())
    return min(tried, default=0.0)


@given(tables(most=5, views=4))
@settings(max_examples=60, deadline=None)
def test_dynamic_programming_finds_what_trying_all_trees_finds(table: Table) -> None:
    assert exact_views(*table) == pytest.approx(every_tree(*table, tuple(range(table[0].shape[1]))))


@pytest.mark.parametrize("score", SCORES.values(), ids=SCORES)
@given(table=tables())
@settings(max_examples=25, deadline=None)
def test_no_policy_needs_fewer_views_than_the_optimum(score: Score, table: Table) -> None:
    assert by_score(*table, score) >= exact_views(*table) - 1e-9


@given(tables())
@settings(max_examples=25, deadline=None)
def test_neither_do_trees_sets_and_the_paper(table: Table) -> None:
    assert min(by_tree(*table), as_set(*table), as_paper(*table)) >= exact_views(*table) - 1e-9


@given(tables())
@settings(max_examples=40, deadline=None)
def test_optimal_needs_as_few_views_as_there_can_be(table: Table) -> None:
    assert by_score(*table, SCORES["optimal"]) == pytest.approx(exact_views(*table))


@given(tables())
@settings(max_examples=40, deadline=None)
def test_huffman_bounds_the_optimum_from_below(table: Table) -> None:
    assert least_views(*table) <= exact_views(*table) + 1e-9


@given(tables())
@settings(max_examples=40, deadline=None)
def test_a_tree_of_bounded_depth_promises_no_more_views_than_it_takes(table: Table) -> None:
    observation, weight = table
    everything = tuple(range(len(weight)))
    shallow = Planner(observation, weight, depth=1).best(everything)
    assert shallow.views <= exact_views(*table) + 1e-9


def test_the_known_lengths_of_codes() -> None:
    assert code_length([1.0], 2) == 0.0
    assert code_length([1.0] * 8, 2) == pytest.approx(3.0)
    assert code_length([1.0] * 9, 3) == pytest.approx(2.0)
    # 0.5 at one, 0.25 at two, two of 0.125 at three letters.
    assert code_length([0.5, 0.25, 0.125, 0.125], 2) == pytest.approx(1.75)
    # Four words and three letters: only the last merging is of three.
    assert code_length([1.0] * 4, 3) == pytest.approx(1.5)


def test_hypotheses_that_no_view_separates_cost_no_views() -> None:
    outlook = told([[0, 0, 1, 1]])
    assert exact_views(np.array([[0, 0, 1, 1]]), outlook.weight) == 1.0
    assert least_views(np.array([[0, 0, 1, 1]]), outlook.weight) == 1.0
    assert exact_views(np.array([[0, 0]]), np.ones(2)) == 0.0


def test_a_policy_that_takes_a_useless_view_is_told_so() -> None:
    with pytest.raises(ValueError, match="view 0 separates none"):
        expected_views(np.array([[0, 0], [0, 1]]), np.ones(2), lambda members: 0)


def test_information_costs_a_few_hundredths_more_than_the_optimum_and_the_paper_more() -> None:
    """Design 5: 1.02 to 1.05, and 1.04 to 1.12."""
    rng = np.random.default_rng(1)
    instances = [draw(rng) for _ in range(60)]
    optimum = np.array([exact_views(*one) for one in instances])
    by = {
        "information": np.array([by_score(*one, SCORES["information"]) for one in instances]),
        "information2": np.array([by_score(*one, SCORES["information2"]) for one in instances]),
        "paper": np.array([as_paper(*one) for one in instances]),
    }
    ratio = {name: float((views / optimum).mean()) for name, views in by.items()}
    assert 1.0 < ratio["information2"] < ratio["information"] < 1.06 < ratio["paper"] < 1.14


def test_a_table_too_large_for_the_exact_optimum_is_refused_with_the_bound() -> None:
    many = MOST_HYPOTHESES + 1
    with pytest.raises(InputError, match=rf"{many} hypotheses are left to plan over, {MOST_HYPOTHESES} at most"):
        views_of_each(told([list(range(many))]))
    one_each = np.eye(MOST_HYPOTHESES, dtype=int)
    views = [one_each[k].tolist() for k in range(MOST_HYPOTHESES)] + [[0] * 6 + [1] * 6]
    with pytest.raises(InputError, match=rf"{MOST_CANDIDATES + 1} views that separate them.*Choose information"):
        views_of_each(told(views))


def test_what_looks_the_same_counts_once_against_the_bounds_of_the_optimum() -> None:
    same = [[m // 10 for m in range(30)]] * 20
    views = views_of_each(told(same))
    assert views[0] == pytest.approx(1.0)
    assert np.isinf(views[1:]).all(), "the others separate the same"


def test_of_views_that_begin_equally_good_strategies_the_quicker_is_first() -> None:
    best = Planner(np.array([[0, 0, 1, 1], [0, 1, 0, 1]]), np.ones(4)).best((0, 1, 2, 3))
    assert (best.candidate, best.views) == (0, 2.0)
    assert [branch.members for branch in best.branches] == [(0, 1), (2, 3)]
    assert best.branches[0].branches[0] == Node((0,), 0.0)
