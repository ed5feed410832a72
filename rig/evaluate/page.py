"""``report.html`` of an evaluation: one self-contained page with figures, plots, and each answer that was wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rig.evaluate import plots
from rig.evaluate.figures import bins, of_row
from rig.evaluate.plan import Plan
from rig.evaluate.store import Key, failed
from rig.evaluate.trial import RIGHT, UNDECIDED, WRONG
from rig.evaluate.work import Record

_MOST_LISTED = 200


def render(plan: Plan, records: Mapping[Key, Record], result: Mapping[str, Any]) -> str:
    """The page as text; ``result`` is the summary."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    # Names come from users' files and are never trusted to be harmless.
    environment = Environment(
        loader=PackageLoader("rig.evaluate", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    by_row = [of_row(row.key, count, records) for row, count in zip(plan.rows, plan.counts, strict=True)]
    every = [record for mine in by_row for record in mine]
    errors = [records[task.key] for task in plan.tasks if task.key in records and failed(records[task.key])]
    return environment.get_template("page.html").render(
        title=plan.title,
        result=result,
        lead=_lead(result),
        figures=_key_figures(every, result),
        charts=_charts(plan, by_row, result) if every else [],
        wrong=[record for record in every if record["kind"] == WRONG][:_MOST_LISTED],
        undecided=[record for record in every if record["kind"] == UNDECIDED][:_MOST_LISTED],
        errors=errors[:_MOST_LISTED],
        most=_MOST_LISTED,
    )


def _lead(result: Mapping[str, Any]) -> str:
    done, planned = result["done"], result["planned"]
    return f"{done:,} trials" if done == planned else f"{done:,} of {planned:,} trials are done"


def _key_figures(every: Sequence[Record], result: Mapping[str, Any]) -> list[tuple[str, str]]:
    if not every:
        return []
    kinds = [record["kind"] for record in every]
    shares = [(kind, 100.0 * kinds.count(kind) / len(kinds)) for kind in (RIGHT, WRONG, UNDECIDED)]
    mean = sum(record["views"] for record in every) / len(every)
    found = [(f"{share:.2f} %", f"{kind} ({kinds.count(kind):,})") for kind, share in shares]
    return [*found, (f"{mean:.2f}", "views, mean"), (f"{result['errors']}", "trials that failed")]


def _charts(plan: Plan, by_row: Sequence[Sequence[Record]], result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Titles, captions and drawings, in their order; those that have nothing to show are left out."""
    names = _short_names(result["rows"])
    series = [
        plots.Series(name, mine, row["bound_views"])
        for name, mine, row in zip(names, by_row, result["rows"], strict=True)
    ]
    every = [record for mine in by_row for record in mine]
    spread = "Thick: the middle half of the trials; thin: 10 to 90 %; bar: median; dot: mean."
    drawn = [
        ("Right, undecided, wrong", "Green, amber and red; in numbers: right and wrong, %.", plots.outcomes(series)),
        ("Views to the end", spread, plots.spreads(series, "views", "views")),
        ("Travel to the end", spread, plots.spreads(series, "travel_s", "seconds of travel")),
        (
            "Time for each view",
            spread + " Finding parts, updating the belief, choosing the next view.",
            plots.step_times(series),
        ),
        (
            "Are answers as sure as they say?",
            "Answers by the doubt that they tell. Above the dashed line they are surer than they ought to be. Lines "
            "are 95 % intervals; hollow marks: none was wrong.",
            plots.reliability(bins(every)),
        ),
        (
            "Views beside the lower bound",
            "The bound is of a perfect policy on perfect views (rig/evaluate/bound.py tells how it is made).",
            plots.gaps(series),
        ),
    ]
    return [{"title": title, "caption": caption, "svg": svg} for title, caption, svg in drawn if svg is not None]


def _short_names(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the rows by what tells them apart."""
    keys = [key for key in ("base", "policy", "noise") if len({row[key] for row in rows}) > 1] or ["base"]
    return [", ".join(row[key] for key in keys) for row in rows]
