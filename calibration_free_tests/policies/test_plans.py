"""Plans of several views: looking ahead, and sets of moves under a cost limit."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.policies.tables import FloatArray, IntArray, graded, tables, told
from recognition.policies.bounds import exact_views
from recognition.policies.information import bits_per_second
from recognition.policies.look_ahead import BEAM, plan_rate
from recognition.policies.move_sets import Worth, moves_within, pairs_told
from recognition.policies.outlook import Outlook, entropy_bits
from recognition.predict import information_bits

Table = tuple[IntArray, FloatArray]
GUARANTEE = (1.0 - 1.0 / np.e) / 2.0


# --- looking ahead --------------------------------------------------------------------------------------------------

# View 0 tells most at once (1.52 bits), but leaves two pairs; view 1 (1.37 bits) leaves three that view 0 tells apart.
TEMPTING = [[0, 1, 0, 2, 2], [0, 0, 1, 0, 2], [0, 1, 1, 1, 0]]


@pytest.mark.parametrize("steps", [2, 3])
def test_the_view_that_tells_most_at_once_is_passed_over_for_the_one_that_prepares_the_next(steps: int) -> None:
    outlook = told(TEMPTING)
    assert int(bits_per_second(outlook).argmax()) == 0
    rate = plan_rate(outlook, steps)
    assert int(rate.argmax()) == 1
    assert rate[1] == pytest.approx(np.log2(5) / exact_views(np.array(TEMPTING), np.ones(5)))


def test_a_plan_is_worth_its_bits_by_its_seconds() -> None:
    outlook = told([[0, 0, 1, 1], [0, 1, 0, 1]])
    slow = Outlook(outlook.weight, outlook.apart, np.array([3.0, 1.0]), outlook.place, outlook.object_of)
    # The later view costs the median of the two.
    assert plan_rate(slow, 2) == pytest.approx([2.0 / 5.0, 2.0 / 3.0])


def test_no_more_views_are_tried_than_the_beam_holds_and_the_best_at_once_is_among_them() -> None:
    rng = np.random.default_rng(0)
    outlook = Outlook.of_table(rng.integers(0, 3, size=(40, 30)), rng.dirichlet(np.ones(30)))
    for steps in (2, 3):
        rate = plan_rate(outlook, steps)
        assert np.isfinite(rate).sum() == BEAM
        assert np.isfinite(rate[bits_per_second(outlook).argmax()])
        # Drawn representatives may misjudge a plan, but not by much.
        assert 0.0 < rate.max() < 1.1 * np.log2(3)


def _bits(view: IntArray, weight: FloatArray) -> float:
    """What a view without error tells, in bits."""
    return float(entropy_bits(np.bincount(view, weight) / weight.sum()))


def best_rate_of_two(table: IntArray, weight: FloatArray) -> float:
    """The best rate of all plans of two views a second each, whose second may be left out after any outcome."""
    best = 0.0
    for first in table:
        branches = [first == outcome for outcome in np.unique(first)]
        seconds = [[(0.0, 0.0), *((_bits(view[left], weight[left]), 1.0) for view in table)] for left in branches]
        share = [weight[left].sum() / weight.sum() for left in branches]
        for plan in product(*seconds):
            bits = sum(p * option[0] for p, option in zip(share, plan, strict=True))
            longer_s = sum(p * option[1] for p, option in zip(share, plan, strict=True))
            best = max(best, (_bits(first, weight) + bits) / (1.0 + longer_s))
    return best


@given(tables())
@settings(max_examples=40, deadline=None)
def test_no_plan_of_two_views_is_said_to_be_better_than_the_best(table: Table) -> None:
    observation, weight = table
    outlook = Outlook.of_table(observation, weight)
    assert float(plan_rate(outlook, 2).max()) <= best_rate_of_two(observation, weight) + 1e-6


# --- sets of moves --------------------------------------------------------------------------------------------------


def best_set(outlook: Outlook, limit_s: float, worth: Worth) -> float:
    """The worth of the best set that the limit allows, by trying all."""
    many = range(len(outlook.cost_s))
    sets = [list(chosen) for size in range(len(many) + 1) for chosen in combinations(many, size)]
    within = [chosen for chosen in sets if outlook.cost_s[chosen].sum() <= limit_s]
    return max(float(worth(outlook.weight, outlook.apart[chosen].sum(axis=0))) for chosen in within)


@given(graded(), st.floats(0.0, 20.0))
@settings(max_examples=60, deadline=None)
def test_a_greedy_set_of_moves_has_its_guaranteed_share_of_the_best_set_s_worth(
    outlook: Outlook, limit_s: float
) -> None:
    chosen = list(moves_within(outlook, limit_s, pairs_told))
    assert outlook.cost_s[chosen].sum() <= limit_s + 1e-6
    got = float(pairs_told(outlook.weight, outlook.apart[chosen].sum(axis=0)))
    assert got >= GUARANTEE * best_set(outlook, limit_s, pairs_told) - 1e-9


@given(tables(views=5), st.lists(st.floats(0.1, 10.0), min_size=5, max_size=5), st.floats(0.0, 20.0))
@settings(max_examples=60, deadline=None)
def test_so_has_one_chosen_for_its_bits_where_observations_are_certain(
    table: Table, cost_s: list[float], limit_s: float
) -> None:
    outlook = Outlook.of_table(*table, cost_s=np.array(cost_s[: len(table[0])]))
    chosen = list(moves_within(outlook, limit_s))
    got = float(information_bits(outlook.weight, outlook.apart[chosen].sum(axis=0)))
    assert got >= GUARANTEE * best_set(outlook, limit_s, information_bits) - 1e-9


@given(graded(views=5))
@settings(max_examples=60, deadline=None)
def test_the_more_views_a_set_has_the_less_another_adds(outlook: Outlook) -> None:
    apart, weight = outlook.apart, outlook.weight
    few, many, another = apart[:1].sum(axis=0), apart[:-1].sum(axis=0), apart[-1]
    if len(apart) > 1:
        to_few = pairs_told(weight, few + another) - pairs_told(weight, few)
        to_many = pairs_told(weight, many + another) - pairs_told(weight, many)
        assert -1e-9 <= to_many <= to_few + 1e-9


def test_views_that_tell_the_same_are_not_taken_together() -> None:
    outlook = told([[0, 0, 1, 1], [5, 5, 6, 6], [0, 1, 0, 1]])
    assert set(moves_within(outlook, 3.0)) == {0, 2}


def test_nothing_is_chosen_that_the_limit_does_not_allow() -> None:
    assert moves_within(told([[0, 1]]), 0.5) == ()


def test_one_dear_view_that_tells_all_beats_many_cheap_ones_that_fit_as_well() -> None:
    outlook = told([[0, 0, 0, 0, 0, 0, 0, 1], [0, 1, 2, 3, 4, 5, 6, 7]])
    dear = Outlook(outlook.weight, outlook.apart, np.array([0.1, 4.0]), outlook.place, outlook.object_of)
    # By bits per second the cheap one comes first, and then the dear one no longer fits.
    assert moves_within(dear, 4.0) == (1,)
