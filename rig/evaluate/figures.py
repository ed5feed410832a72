"""The figures of an evaluation: a row for each model base, policy and conditions, from the records of its trials."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rig.evaluate.plan import Plan
from rig.evaluate.store import Key, failed
from rig.evaluate.trial import RIGHT, UNDECIDED, WRONG
from rig.evaluate.work import Record

CONFIDENCE_EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9999, 1.0)
"""Bins of what answers say of themselves: fine where they nearly all are."""


@dataclass(frozen=True)
class Figures:
    """What the trials of a row say together; ``None`` where there is nothing to say it of.

    Attributes:
        base: the model base; policy: how views were chosen; noise: name of the conditions.
        trials: that came to an answer; right, wrong, undecided: how many of them.
        ece: expected calibration error of the answers that name an object, or none of them, 0..1.
        views_mean: views to the end; views_p90: their 90th percentile.
        travel_s_mean: seconds of travel to the end.
        bound_views: fewer views than this no policy needs on average, where that can be told.
        step_ms_median: time that a view took to be understood and the next to be chosen.
    """

    base: str
    policy: str
    noise: str
    trials: int
    right: int
    wrong: int
    undecided: int
    ece: float | None
    views_mean: float | None
    views_p90: float | None
    travel_s_mean: float | None
    bound_views: float | None
    step_ms_median: float | None


@dataclass(frozen=True)
class Bin:
    """Answers that are about as sure: their number, what they say on average, and how many are right."""

    lower: float
    upper: float
    answers: int
    confidence: float
    right: int


def figures(plan: Plan, records: Mapping[Key, Record], bounds: Sequence[float | None]) -> list[Figures]:
    """The figures of each row of a plan; ``bounds`` are its rows' least views."""
    return [
        _figures(row.base, row.policy, row.conditions.name, of_row(row.key, count, records), bound)
        for row, count, bound in zip(plan.rows, plan.counts, bounds, strict=True)
    ]


def of_row(key: str, count: int, records: Mapping[Key, Record]) -> list[Record]:
    """The records of a row's first trials that came to an answer, by number."""
    found = (records.get((key, number)) for number in range(count))
    return [record for record in found if record is not None and not failed(record)]


def bins(records: Iterable[Record], edges: Sequence[float] = CONFIDENCE_EDGES) -> list[Bin]:
    """Answers by how sure they say they are; a bin holds its upper edge. Empty bins are left out."""
    answers = [record for record in records if record["confidence"] is not None]
    told = np.array([record["confidence"] for record in answers], dtype=float)
    true = np.array([record["kind"] == RIGHT for record in answers], dtype=bool)
    at = np.clip(np.searchsorted(edges, told, side="left") - 1, 0, len(edges) - 2)
    return [
        Bin(edges[k], edges[k + 1], int(mine.sum()), float(told[mine].mean()), int(true[mine].sum()))
        for k in range(len(edges) - 1)
        if (mine := at == k).any()
    ]


def confidence_error(found: Sequence[Bin]) -> float | None:
    """Expected calibration error: how far sureness and share of right answers lie apart, weighted by answers."""
    total = sum(one.answers for one in found)
    if total == 0:
        return None
    return sum(abs(one.right - one.answers * one.confidence) for one in found) / total


def summary(plan: Plan, records: Mapping[Key, Record], bounds: Sequence[float | None], folder: str) -> dict[str, Any]:
    """What ``--json`` prints and ``summary.json`` keeps."""
    counted = {task.key for task in plan.tasks}
    mine = [record for key, record in records.items() if key in counted]
    return {
        "plan": plan.name,
        "title": plan.title,
        "seed": plan.seed,
        "folder": folder,
        "planned": plan.trials,
        "done": sum(not failed(record) for record in mine),
        "errors": sum(map(failed, mine)),
        "rows": [asdict(row) for row in figures(plan, records, bounds)],
    }


def _figures(base: str, policy: str, noise: str, mine: Sequence[Record], bound: float | None) -> Figures:
    kinds = [record["kind"] for record in mine]
    views = [record["views"] for record in mine]
    steps_s = [sum(step) for record in mine for step in record["seconds"]]
    return Figures(
        base=base,
        policy=policy,
        noise=noise,
        trials=len(mine),
        right=kinds.count(RIGHT),
        wrong=kinds.count(WRONG),
        undecided=kinds.count(UNDECIDED),
        ece=confidence_error(bins(mine)),
        views_mean=float(np.mean(views)) if mine else None,
        views_p90=float(np.quantile(views, 0.9)) if mine else None,
        travel_s_mean=float(np.mean([record["travel_s"] for record in mine])) if mine else None,
        bound_views=bound,
        step_ms_median=1000.0 * float(np.median(steps_s)) if steps_s else None,
    )
