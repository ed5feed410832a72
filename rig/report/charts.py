"""Two charts of a run: the posterior over objects per view, and the hypotheses left per view."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from recognition.steps import Step
from rig.report import svg

UNKNOWN = "unknown"
SHOWN_OBJECTS = 6
WIDTH, HEIGHT = 520.0, 250.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 44.0, 10.0, 12.0, 30.0


def posterior_chart(steps: Sequence[Step]) -> tuple[Markup, list[tuple[str, str]]]:
    """Stacked columns, one a view, and the legend as (css class, name) pairs, bottom of the stack first."""
    names = _shown(steps)
    body = [_grid(f"{value * 100:.0f} %", _height(value)) for value in (0.0, 0.25, 0.5, 0.75, 1.0)]
    places = _places(len(steps))
    width = min(46.0, 0.7 * (WIDTH - _LEFT - _RIGHT) / max(len(steps), 1))
    for x, step in zip(places, steps, strict=True):
        below = 0.0
        for css, name, share in _shares(step, names):
            title = f"view {step.index + 1}: {name} {100 * share:.1f} %"
            body.append(svg.rect(x - width / 2, _height(below + share), width, _height(0) - _height(share), css, title))
            below += share
        body.append(svg.text(x, HEIGHT - 10, str(step.index + 1), "tick", "middle"))
    legend = [(css, name) for css, name, _ in _shares(steps[-1], names)] if steps else []
    return svg.canvas(WIDTH, HEIGHT, body, "Posterior over objects after each view"), legend


def hypotheses_chart(steps: Sequence[Step]) -> Markup:
    """Hypotheses left after each view, on a logarithmic scale."""
    counts = [max(step.belief.hypotheses_left, 1) for step in steps]
    decades = max(1, math.ceil(math.log10(max(counts, default=1)) - 1e-9))

    def height(count: float) -> float:
        return _height(math.log10(count) / decades * 0.94)

    body = [_grid(f"{10**decade:,}", height(10**decade)) for decade in range(decades + 1)]
    places = _places(len(steps))
    heights = [height(count) for count in counts]
    if steps:
        body.append(svg.polyline(np.column_stack([places, heights]), "curve"))
    for x, y, step in zip(places, heights, steps, strict=True):
        left = step.belief.hypotheses_left
        title = f"view {step.index + 1}: {left:,} left, {step.belief.entropy_bits:.2f} bits"
        body.append(svg.circle(x, y, 4.5, "point", title))
        body.append(svg.text(x, y - 10, f"{left:,}", "value", "middle"))
        body.append(svg.text(x, HEIGHT - 10, str(step.index + 1), "tick", "middle"))
    return svg.canvas(WIDTH, HEIGHT, body, "Hypotheses left after each view, logarithmic")


def _shown(steps: Sequence[Step]) -> list[str]:
    """Objects worth a colour of their own: those that ever had most of the probability, the last leader first."""
    peak: dict[str, float] = {}
    for step in steps:
        for name, value in step.belief.posterior.items():
            peak[name] = max(value, peak.get(name, 0.0))
    last = steps[-1].belief.posterior if steps else {}
    names = [name for name in peak if name != UNKNOWN]
    names.sort(key=lambda name: (last.get(name, 0.0), peak[name]), reverse=True)
    if len(names) > SHOWN_OBJECTS:
        strongest = sorted(names, key=lambda name: peak[name], reverse=True)[: SHOWN_OBJECTS - 1]
        names = [names[0], *(name for name in names[1:] if name in strongest)][:SHOWN_OBJECTS]
    return names


def _shares(step: Step, names: Sequence[str]) -> list[tuple[str, str, float]]:
    posterior = step.belief.posterior
    shares = [(f"c{k}", name, posterior.get(name, 0.0)) for k, name in enumerate(names)]
    rest = sum(value for name, value in posterior.items() if name not in names and name != UNKNOWN)
    if len(posterior) - (UNKNOWN in posterior) > len(names):
        shares.append(("crest", "all other objects", rest))
    if UNKNOWN in posterior:
        shares.append(("cnone", "none of these objects", posterior[UNKNOWN]))
    return shares


def _places(count: int) -> list[float]:
    pitch = (WIDTH - _LEFT - _RIGHT) / max(count, 1)
    return [_LEFT + pitch * (k + 0.5) for k in range(count)]


def _height(share: float) -> float:
    return _TOP + (1.0 - share) * (HEIGHT - _TOP - _BOTTOM)


def _grid(label: str, y: float) -> Markup:
    return svg.line(_LEFT, y, WIDTH - _RIGHT, y, "grid") + svg.text(_LEFT - 8, y + 4, label, "tick", "end")
