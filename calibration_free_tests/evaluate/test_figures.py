"""The figures of a row against numbers worked out by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.evaluate.sample import small_plan
from rig.evaluate.bound import code_length
from rig.evaluate.figures import bins, confidence_error, summary
from rig.evaluate.plots import wilson


def record(number: int, kind: str = "right", confidence: float | None = 0.995, **more: Any) -> dict[str, Any]:
    return {
        "row": "three",
        "number": number,
        "seed": number,
        "kind": kind,
        "confidence": confidence,
        "views": 3,
        "travel_s": 10.0,
        "seconds": [[0.01, 0.02, 0.03]],
        **more,
    }


def test_confidence_error_is_the_gap_between_sureness_and_truth_weighted_by_answers() -> None:
    # 0.9 .. 0.95: four answers that say 0.94, three right: 0.19 apart; above: four that say 0.996, all right: 0.004.
    low = [record(k, "right" if k else "wrong", 0.94) for k in range(4)]
    high = [record(k, "right", 0.996) for k in range(4)]
    assert confidence_error(bins(low + high)) == pytest.approx((4 * 0.19 + 4 * 0.004) / 8)


def test_answers_that_cancel_out_in_one_bin_are_calibrated() -> None:
    said_90 = [record(k, "right" if k else "wrong", 0.9) for k in range(10)]
    assert confidence_error(bins(said_90)) == pytest.approx(0.0)


def test_trials_without_an_answer_do_not_count_in_calibration() -> None:
    found = bins([record(0, "undecided", None), record(1, "right", 1.0)])
    assert [(one.answers, one.right) for one in found] == [(1, 1)]
    assert confidence_error(bins([record(0, "undecided", None)])) is None


@pytest.mark.parametrize(
    ("told", "edges"), [(0.99, (0.98, 0.99)), (0.9901, (0.99, 0.995)), (1.0, (0.9999, 1.0)), (0.0, (0.0, 0.5))]
)
def test_a_bin_holds_its_upper_edge(told: float, edges: tuple[float, float]) -> None:
    (found,) = bins([record(0, "right", told)])
    assert (found.lower, found.upper) == edges


def test_a_row_has_the_figures_that_were_asked_for_and_no_others(tmp_path: Path) -> None:
    plan = small_plan(tmp_path).of(trials=10)
    clean = plan.rows[0].key
    records = {
        (clean, 0): record(0, "right", 0.995, views=2),
        (clean, 1): record(1, "wrong", 0.995, views=4, travel_s=30.0, seconds=[[0.1, 0.1, 0.1], [0.1, 0.1, 0.1]]),
        (clean, 2): record(2, "undecided", None, views=6),
        (clean, 3): {"row": clean, "number": 3, "seed": 3, "error": "it failed"},
        (clean, 7): record(7, "wrong"),  # of an earlier call with more trials
    }
    result = summary(plan, records, [1.5, None], "here")
    first, second = result["rows"]
    assert list(first) == [
        *("base", "policy", "noise", "trials", "right", "wrong", "undecided", "ece"),
        *("views_mean", "views_p90", "travel_s_mean", "bound_views", "step_ms_median"),
    ]
    assert (first["base"], first["policy"], first["noise"]) == ("three", "information", "clean")
    assert [first[key] for key in ("trials", "right", "wrong", "undecided")] == [3, 1, 1, 1]
    assert first["ece"] == pytest.approx(0.495)
    assert (first["views_mean"], first["views_p90"]) == (4.0, pytest.approx(5.6))
    assert first["travel_s_mean"] == pytest.approx(50 / 3)
    assert first["bound_views"] == 1.5
    assert first["step_ms_median"] == pytest.approx(180.0)  # 60, 300, 300 and 60 ms
    assert second["trials"] == 0
    assert {second[key] for key in ("ece", "views_mean", "views_p90", "travel_s_mean", "step_ms_median")} == {None}
    assert (result["planned"], result["done"], result["errors"]) == (10, 3, 1)


@pytest.mark.parametrize(
    ("weights", "letters", "length"),
    [
        ([1.0], 2, 0.0),
        ([1.0, 1.0], 2, 1.0),
        ([0.5, 0.25, 0.125, 0.125], 2, 1.75),
        ([1, 1, 1, 1, 1], 2, 2.4),  # 3 words of 2 letters and 2 of 3
        ([1, 1, 1, 1, 1], 5, 1.0),
        ([1, 1, 1, 1], 3, 1.5),  # 2 words of 1 letter and 2 of 2
        ([1] * 9, 3, 2.0),
        ([0.4, 0.3, 0.2, 0.1], 100, 1.0),
    ],
)
def test_a_code_is_as_long_as_huffman_says(weights: list[float], letters: int, length: float) -> None:
    assert code_length(weights, letters) == pytest.approx(length)


def test_an_interval_of_a_share_is_wilsons() -> None:
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
