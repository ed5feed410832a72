"""The paper's three filters on small trees, and its policy in the graded mode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration_free_tests.paper.perfect import SETTINGS, TrueDetector, architecture, blank_rig
from calibration_free_tests.paper.test_paper_mode import run
from recognition.policies import load_policy
from recognition.policies.paper import Forest, PaperPolicy
from recognition.recogniser import recognise
from recognition.steps import Outcome


def forest(agree: list[list[int]], pans_deg: list[float], shows: list[int] | None = None) -> Forest:
    """Trees of interpretation 0; ``agree[k][i]``: view k does not tell i from it."""
    table = np.array(agree, dtype=bool)
    usable = np.ones(len(agree), dtype=bool) if shows is None else np.array(shows, dtype=bool)
    return Forest(
        pans_deg=np.array(pans_deg),
        here_deg=0.0,
        tops=np.array([0]),
        agree={0: table},
        shows={0: usable},
        start=np.arange(table.shape[1]),
        name={0: "A"},
    )


def test_the_view_that_tells_all_apart_is_the_best_leaf() -> None:
    leaf = forest([[1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 0, 0]], [0, 30, 0]).best_leaf(0, 3)
    assert leaf is not None
    assert (leaf.path, leaf.left, leaf.weight) == ((1,), (1,), 1.0)


def test_path_weight_is_the_sum_of_s_to_the_level() -> None:
    # By view 0: 3 + 2^2 + 1 = 8. By views 1 and 2: 6 + 1 = 7, though 3 + 2 + 1 < 6 + 1.
    kept = [{0, 1, 2}, {0, 2, 3, 4, 5, 6}, {0, 1, 7, 8, 9, 10, 11}]
    leaf = forest([[int(i in view) for i in range(12)] for view in kept], [0, 0, 0]).best_leaf(0, 3)
    assert leaf is not None
    assert leaf.path == (1, 2)
    assert (leaf.left, leaf.weight) == ((6, 1), 7.0)


def test_a_slow_start_costs_more_the_deeper_it_goes() -> None:
    # Views 0 and 1 settle it in 4 + 1, views 2 and 3 in 2 + 1.
    agree = [[1, 1, 1, 1, 0, 0], [1, 0, 0, 0, 1, 1], [1, 1, 0, 0, 0, 0], [1, 0, 1, 1, 1, 1]]
    leaf = forest(agree, [0, 0, 0, 0]).best_leaf(0, 3)
    assert leaf is not None
    assert leaf.path[0] == 2
    assert leaf.weight == 3.0


def test_of_equal_weights_the_least_rotation_wins() -> None:
    leaf = forest([[1, 0, 0], [1, 0, 0], [1, 0, 0]], [40, -10, 25]).best_leaf(0, 3)
    assert leaf is not None
    assert leaf.path == (1,)
    assert leaf.rotation_deg == 10.0


def test_leaves_lie_no_deeper_than_the_levels_allowed() -> None:
    agree = 1 - np.eye(6, dtype=int)[1:]
    agree[:, 0] = 1
    for levels in (1, 2, 3):
        leaf = forest(agree.tolist(), [0] * 5).best_leaf(0, levels)
        assert leaf is not None
        assert len(leaf.path) == levels


def test_a_view_that_shows_no_expected_part_near_its_centre_is_no_node() -> None:
    leaf = forest([[1, 0, 0], [1, 1, 0]], [0, 0], shows=[0, 1]).best_leaf(0, 3)
    assert leaf is not None
    assert leaf.path == (1,)
    assert forest([[1, 0]], [0], shows=[0]).best_leaf(0, 3) is None


def test_the_policy_also_serves_the_graded_mode() -> None:
    assert isinstance(load_policy("paper"), PaperPolicy)
    base = architecture()
    rig = blank_rig(base, "GH", 5)
    steps, answer = run(
        recognise(rig, base, replace(SETTINGS, mode="graded", threshold=0.99), detector=TrueDetector(rig))
    )
    assert answer.outcome is Outcome.RECOGNISED
    assert answer.object_id == "GH"
    assert all("path weight" in step.move.why for step in steps if step.move)
