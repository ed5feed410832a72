"""Prints how many views every policy needs on random small tables, beside the fewest that any can need.

A table tells what each hypothesis shows from each candidate, without error; views are counted until all hypotheses left
are such as no view separates. ``pose_volume`` and ``reveal`` look at poses and parts, which a table has not.

Run: python -m benchmarks.bench_policies [--instances 300] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from recognition.policies.bounds import exact_views, expected_views, least_views
from recognition.policies.dempster_shafer import ambiguity_bits
from recognition.policies.ec2 import cut_weight
from recognition.policies.entropy import entropy_loss_bits
from recognition.policies.information import bits_per_second
from recognition.policies.look_ahead import plan_rate
from recognition.policies.move_sets import LIMIT_VIEWS, moves_within
from recognition.policies.offline_tree import strategy
from recognition.policies.optimal import views_of_each
from recognition.policies.outlook import Outlook
from recognition.policies.paper import MAXLEVELS, Forest, most_probable
from recognition.policies.strategy import Node
from recognition.policies.transinformation import transinformation_bits

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Score = Callable[[Outlook], FloatArray]

SCORES: dict[str, Score] = {
    "optimal": lambda outlook: -views_of_each(outlook),
    "information": bits_per_second,
    "information2": lambda outlook: plan_rate(outlook, 2),
    "information3": lambda outlook: plan_rate(outlook, 3),
    "transinformation": transinformation_bits,
    "entropy": entropy_loss_bits,
    "dempster_shafer": lambda outlook: -ambiguity_bits(outlook),
    "ec2": cut_weight,
}


def draw(rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """A table ``(K, M)`` of 5 to 12 views of 6 to 12 hypotheses, each with 2 to 4 outcomes, and uneven weights."""
    many, views = int(rng.integers(6, 13)), int(rng.integers(5, 13))
    outcomes = rng.integers(2, 5, size=(views, 1))
    return rng.integers(0, outcomes, size=(views, many)), rng.dirichlet(np.full(many, 1.0))


def by_score(table: IntArray, weight: FloatArray, score: Score) -> float:
    """Expected views of who always takes the view that scores best."""
    outlook = Outlook.of_table(table, weight)
    return expected_views(table, weight, lambda members: int(np.round(score(outlook.among(members)), 9).argmax()))


def as_set(table: IntArray, weight: FloatArray) -> float:
    """Expected views of who takes, of the best set within the limit, the view that tells most."""
    outlook = Outlook.of_table(table, weight)

    def decide(members: tuple[int, ...]) -> int:
        left = outlook.among(members)
        return max(moves_within(left, LIMIT_VIEWS), key=lambda k: left.bits[k])

    return expected_views(table, weight, decide)


def by_tree(table: IntArray, weight: FloatArray) -> float:
    """Expected views of who follows a tree of bounded depth, and plans another where it ends."""
    outlook = Outlook.of_table(table, weight)
    planned: dict[tuple[int, ...], int] = {}

    def keep(node: Node, members: tuple[int, ...], cheap: IntArray) -> None:
        if node.candidate >= 0:
            planned[tuple(members[m] for m in node.members)] = int(cheap[node.candidate])
        for branch in node.branches:
            keep(branch, members, cheap)

    def decide(members: tuple[int, ...]) -> int:
        if members not in planned:
            keep(*strategy_among(outlook, members))
        return planned[members]

    return expected_views(table, weight, decide)


def strategy_among(outlook: Outlook, members: tuple[int, ...]) -> tuple[Node, tuple[int, ...], IntArray]:
    root, cheap = strategy(outlook.among(members))
    return root, members, cheap


def as_paper(table: IntArray, weight: FloatArray) -> float:
    """Expected views of the paper's three filters; rotations are all nought here."""

    def decide(members: tuple[int, ...]) -> int:
        shown, each = table[:, list(members)], np.arange(len(members))
        tops = most_probable(weight[list(members)], each)
        forest = Forest(
            pans_deg=np.zeros(len(table)),
            here_deg=0.0,
            tops=tops,
            agree={int(t): shown == shown[:, t : t + 1] for t in tops},
            shows={int(t): np.ones(len(table), dtype=bool) for t in tops},
            start=each,
            name={int(t): str(t) for t in tops},
        )
        leaf = forest.best(MAXLEVELS)
        # Where its favourite is already told from all others, the paper ends; here the others go on being told.
        if leaf is None or len({shown[leaf.path[0], m] for m in each}) < 2:
            return int(Outlook.of_table(shown, weight[list(members)]).bits.argmax())
        return leaf.path[0]

    return expected_views(table, weight, decide)


def at_random(table: IntArray, weight: FloatArray, rng: np.random.Generator) -> float:
    """Expected views of who draws any view not taken yet, useless ones included; one drawn tree of many."""
    _, same = np.unique(table.T, axis=0, return_inverse=True)

    def views(members: IntArray, left: IntArray) -> float:
        if len(set(same.reshape(-1)[members].tolist())) < 2:
            return 0.0
        taken, rest = left[0], left[1:]
        shown = table[taken, members]
        groups = [members[shown == one] for one in np.unique(shown)]
        after = sum(weight[g].sum() * views(g, rng.permutation(rest)) for g in groups)
        return 1.0 + float(after) / float(weight[members].sum())

    return views(np.arange(table.shape[1]), rng.permutation(len(table)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instances", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    policies: dict[str, Callable[[IntArray, FloatArray], float]] = {
        name: lambda table, weight, score=score: by_score(table, weight, score) for name, score in SCORES.items()
    }
    policies |= {
        "information_set": as_set,
        "offline_tree": by_tree,
        "paper": as_paper,
        "random": lambda table, weight: at_random(table, weight, rng),
    }
    instances = [draw(rng) for _ in range(given.instances)]
    optimum = np.array([exact_views(*one) for one in instances])
    bound = np.array([least_views(*one) for one in instances])
    print(
        f"{given.instances} tables; the optimum is {optimum.mean():.3f} views, {(optimum / bound).mean():.3f} x Huffman"
    )
    print(f"{'policy':18s} {'views':>6s} {'x optimum':>10s} {'worst':>6s} {'optimal on':>11s} {'ms a table':>11s}")
    for name, play in policies.items():
        began = time.process_time()
        views = np.array([play(*one) for one in instances])
        took = 1e3 * (time.process_time() - began) / len(instances)
        ratio = views / optimum
        equal = f"{100 * (ratio < 1 + 1e-9).mean():.0f} %"
        print(f"{name:18s} {views.mean():6.3f} {ratio.mean():10.4f} {ratio.max():6.3f} {equal:>11s} {took:11.1f}")


if __name__ == "__main__":
    main()
