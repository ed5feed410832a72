"""The plots of an evaluation, as SVG that follows the page's colours."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from rig.evaluate.figures import Bin
from rig.evaluate.trial import RIGHT, UNDECIDED, WRONG
from rig.evaluate.work import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]

_COLOURS = {
    # Placeholders that matplotlib can draw with, and what stands in the page instead of them.
    "#010101": "var(--ink)",
    "#020202": "var(--soft)",
    "#030303": "var(--rule)",
    "#040404": "var(--accent)",
    "#050505": "var(--good)",
    "#060606": "var(--warn)",
    "#070707": "var(--bad)",
    "#080808": "var(--card)",
}
_INK, _SOFT, _RULE, _ACCENT, _GOOD, _WARN, _BAD, _CARD = _COLOURS
_WIDTH_IN, _ROW_IN, _EDGE_IN = 5.8, 0.38, 0.7
_LEAST_DOUBT = 1e-5


@dataclass(frozen=True)
class Series:
    """A row of results to be drawn: its name, its records, and the least number of views."""

    name: str
    records: Sequence[Record]
    bound: float | None


def outcomes(series: Sequence[Series]) -> Markup:
    """Shares of right, undecided and wrong answers, one bar a row."""
    figure, axes = _rows(series)
    for place, one in enumerate(series):
        kinds = [record["kind"] for record in one.records]
        left = 0.0
        for kind, colour in ((RIGHT, _GOOD), (UNDECIDED, _WARN), (WRONG, _BAD)):
            share = 100.0 * kinds.count(kind) / max(1, len(kinds))
            axes.barh(place, share, left=left, height=0.56, color=colour)
            left += share
        if kinds:
            told = f"{100.0 * kinds.count(RIGHT) / len(kinds):.1f} | {100.0 * kinds.count(WRONG) / len(kinds):.2f}"
            axes.annotate(told, (100, place), (8, 0), textcoords="offset points", va="center", color=_INK, fontsize=8.5)
    axes.set_xlim(0, 122)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("% of trials")
    return _svg(figure)


def spreads(series: Sequence[Series], key: str, label: str) -> Markup:
    """How a number of each trial is distributed, a row each: 10 to 90 %, the middle half, median and mean."""
    return _spreads(series, [[float(record[key]) for record in one.records] for one in series], label)


def step_times(series: Sequence[Series]) -> Markup:
    """How long a view took to be understood and the next to be chosen, ms."""
    values = [[1000.0 * sum(step) for record in one.records for step in record["seconds"]] for one in series]
    return _spreads(series, values, "ms a view", logarithmic=True)


def gaps(series: Sequence[Series]) -> Markup | None:
    """Mean views beside the fewest that any policy could do with; ``None`` where no row has a bound."""
    known = [one for one in series if one.bound is not None and one.records]
    if not known:
        return None
    figure, axes = _rows(known)
    for place, one in enumerate(known):
        assert one.bound is not None
        mean = float(np.mean([record["views"] for record in one.records]))
        axes.plot([one.bound, mean], [place, place], color=_RULE, linewidth=3, solid_capstyle="butt", zorder=1)
        axes.plot(one.bound, place, marker="|", markersize=13, markeredgewidth=2, color=_INK, zorder=2)
        axes.plot(mean, place, marker="o", markersize=7, color=_ACCENT, zorder=2)
        axes.annotate(
            f"{mean:.2f}", (mean, place), (8, 0), textcoords="offset points", va="center", color=_INK, fontsize=9
        )
    axes.set_xlim(0, None)
    axes.margins(x=0.12)
    axes.set_xlabel("views: the bound (bar) and the mean (dot)")
    return _svg(figure)


def reliability(found: Sequence[Bin]) -> Markup | None:
    """How often answers are wrong beside how often they say they may be, both logarithmic; ``None`` without answers.

    Bars are 95 % intervals (Wilson). Where none was wrong, only the interval's upper end can be drawn.
    """
    if not found:
        return None
    figure, axes = _plain(5.6, 4.4)
    line = np.array([_LEAST_DOUBT / 3, 1.0])
    axes.plot(line, line, color=_SOFT, linewidth=1, linestyle=(0, (4, 3)))
    for k, one in enumerate(found):
        doubt = max(1.0 - one.confidence, _LEAST_DOUBT)
        wrong = one.answers - one.right
        low, high = wilson(wrong, one.answers)
        foot = max(low, _LEAST_DOUBT / 3)
        axes.plot([doubt, doubt], [foot, high], color=_ACCENT, linewidth=2, alpha=0.5, solid_capstyle="butt")
        if wrong:
            axes.plot(doubt, wrong / one.answers, marker="o", markersize=7, color=_ACCENT)
        else:
            axes.plot(doubt, high, marker="v", markersize=7, markerfacecolor=_CARD, markeredgecolor=_ACCENT)
        axes.annotate(
            f"{wrong} of {one.answers:,}",
            (doubt, high),
            (0, 8 if k % 2 else 19),
            textcoords="offset points",
            ha="center",
            color=_SOFT,
            fontsize=8,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(1.4, _LEAST_DOUBT / 2)
    axes.set_ylim(_LEAST_DOUBT / 3, 2.6)
    axes.set_xlabel("told doubt: 1 - posterior of the answer")
    axes.set_ylabel("share of wrong answers")
    axes.grid(color=_RULE, linewidth=0.8)
    return _svg(figure)


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    z = 1.959964
    share = hits / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2)) / (1 + z * z / trials)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def _spreads(
    series: Sequence[Series], values: Sequence[Sequence[float]], label: str, *, logarithmic: bool = False
) -> Markup:
    figure, axes = _rows(series)
    for place, numbers in enumerate(values):
        if not numbers:
            continue
        p10, p25, p50, p75, p90 = np.quantile(numbers, [0.1, 0.25, 0.5, 0.75, 0.9])
        axes.plot([p10, p90], [place, place], color=_ACCENT, linewidth=2, solid_capstyle="butt", alpha=0.45)
        axes.plot([p25, p75], [place, place], color=_ACCENT, linewidth=9, solid_capstyle="butt", alpha=0.45)
        axes.plot(p50, place, marker="|", markersize=15, markeredgewidth=2, color=_ACCENT)
        axes.plot(np.mean(numbers), place, marker="o", markersize=6, color=_INK)
    if logarithmic:
        from matplotlib.ticker import LogLocator, NullLocator

        axes.set_xscale("log")
        # Times of one kind often lie within a decade.
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter("{x:g}")
    else:
        axes.set_xlim(0, None)
    axes.set_xlabel(label)
    return _svg(figure)


def _rows(series: Sequence[Series]) -> tuple[Figure, Axes]:
    """An empty plot with a line for each row, the first on top."""
    figure, axes = _plain(_WIDTH_IN, _EDGE_IN + _ROW_IN * max(1, len(series)))
    axes.set_yticks(range(len(series)), [one.name for one in series])
    axes.set_ylim(len(series) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color=_RULE, linewidth=0.8)
    return figure, axes


def _plain(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    # Not pyplot: it keeps figures, and looks for a screen.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    figure.patch.set_alpha(0.0)
    axes = figure.add_subplot()
    axes.patch.set_alpha(0.0)
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(_RULE)
    axes.tick_params(colors=_SOFT, labelsize=9)
    axes.tick_params(which="minor", length=0)
    axes.xaxis.label.set_color(_SOFT)
    axes.yaxis.label.set_color(_SOFT)
    axes.xaxis.label.set_fontsize(9)
    axes.yaxis.label.set_fontsize(9)
    return figure, axes


def _svg(figure: Figure) -> Markup:
    from matplotlib import rc_context

    stream = io.StringIO()
    # Text stays text, and equal plots give equal files.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "rig evaluate", "font.family": "sans-serif"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    for placeholder, colour in _COLOURS.items():
        text = text.replace(placeholder, colour)
    # Names come from users' plans; matplotlib escapes them.
    return Markup(text)
