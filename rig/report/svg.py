"""Small pieces of SVG. Everything goes through ``Markup.format``, which escapes labels: they come from users' files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup, escape

from recognition.geometry import FloatArray


def canvas(width: float, height: float, body: Iterable[Markup], label: str, css: str = "chart") -> Markup:
    """A picture of that size in user units, which scales with the page; ``label`` is for those who cannot see it."""
    return Markup('<svg class="{}" viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        css, number(width), number(height), label, Markup("").join(body)
    )


def line(x1: float, y1: float, x2: float, y2: float, css: str) -> Markup:
    """A straight line."""
    return Markup('<line class="{}" x1="{}" y1="{}" x2="{}" y2="{}"/>').format(css, *map(number, (x1, y1, x2, y2)))


def text(x: float, y: float, content: str, css: str, anchor: str = "start") -> Markup:
    """A line of text; ``anchor`` is start, middle or end."""
    return Markup('<text class="{}" x="{}" y="{}" text-anchor="{}">{}</text>').format(
        css, number(x), number(y), anchor, content
    )


def rect(x: float, y: float, width: float, height: float, css: str, title: str = "") -> Markup:
    """A rectangle with a tooltip."""
    return Markup('<rect class="{}" x="{}" y="{}" width="{}" height="{}">{}</rect>').format(
        css, *map(number, (x, y, width, height)), _title(title)
    )


def circle(x: float, y: float, radius: float, css: str, title: str = "") -> Markup:
    """A disc with a tooltip."""
    return Markup('<circle class="{}" cx="{}" cy="{}" r="{}">{}</circle>').format(
        css, *map(number, (x, y, radius)), _title(title)
    )


def polygon(points: FloatArray, css: str, title: str = "") -> Markup:
    """A closed outline through ``(n, 2)`` points; nothing if a point is not finite."""
    if not np.isfinite(points).all():
        return Markup("")
    return Markup('<polygon class="{}" points="{}">{}</polygon>').format(css, _points(points), _title(title))


def polyline(points: FloatArray, css: str) -> Markup:
    """An open line through ``(n, 2)`` points."""
    return Markup('<polyline class="{}" points="{}"/>').format(css, _points(points))


def number(value: float) -> str:
    """Two digits after the point are finer than any screen."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


def nice_length(longest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above ``longest``."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest)


def millimetres(value_mm: float) -> str:
    """``350 mm`` or ``12.5 m``: a length as a person would say it."""
    return f"{value_mm:g} mm" if abs(value_mm) < 1000 else f"{value_mm / 1000:g} m"


def _title(title: str) -> Markup:
    return Markup("<title>{}</title>").format(title) if title else Markup("")


def _points(points: FloatArray) -> Markup:
    pairs: Sequence[str] = [f"{number(float(x))},{number(float(y))}" for x, y in points]
    return escape(" ".join(pairs))
