"""Draws a model base: the façades of each object unfolded side by side, its parts coloured by class, to one scale."""

from __future__ import annotations

import math
import os
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from recognition.modelbase import Face, ModelBase, ObjectModel, Part
from rig.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]

_FORMATS = (".png", ".svg", ".pdf")
_PAGE_WIDTH_IN = 16.0
_BORDER_IN, _HEAD_IN = 0.4, 0.7
_SMALLEST_PART_IN = 0.12
_GAP = 0.012
"""Between façades, as a share of the widest strip."""
_NO_FACE = "(no face)"
_COLOURS = ("#4c78a8", "#e45756", "#f2a93b", "#72b7b2", "#54a24b", "#b279a2", "#9d755d", "#ff9da6", "#7f7f7f")
_WALL, _WALL_EDGE, _INK = "#f3efe6", "#b8ae99", "#333333"


@dataclass(frozen=True, slots=True)
class FlatFace:
    """A façade laid flat, seen from outside: x to the right, y down, mm; the top left corner is (0, top_mm).

    Attributes:
        name: of the face.
        left_mm, right_mm, top_mm, bottom_mm: the wall's, or the outermost parts' with a border where no wall is known.
        polygons: each part with its ``(n, 2)`` corners.
    """

    name: str
    left_mm: float
    right_mm: float
    top_mm: float
    bottom_mm: float
    polygons: tuple[tuple[Part, FloatArray], ...] = field(repr=False)

    @property
    def width_mm(self) -> float:
        """Left to right."""
        return self.right_mm - self.left_mm


def unfold(thing: ObjectModel) -> tuple[FlatFace, ...]:
    """Lay each face of an object flat, in the order of the file.

    A face that is only a name is the vertical plane through its parts, turned so that they face the viewer.
    """
    on_face: dict[str, list[Part]] = {face.id: [] for face in thing.faces}
    for part in thing.parts:
        on_face.setdefault(part.face or _NO_FACE, []).append(part)
    known = {face.id: face for face in thing.faces}
    return tuple(_flatten(name, parts, known.get(name)) for name, parts in on_face.items() if parts or name in known)


def _flatten(name: str, parts: list[Part], face: Face | None) -> FlatFace:
    right = _rightward(parts, face)
    polygons = [(part, np.column_stack([part.corners_mm @ right, part.corners_mm[:, 1]])) for part in parts]
    if face is not None:
        outline = np.column_stack([face.corners_mm @ right, face.corners_mm[:, 1]])
        border = 0.0
    else:
        outline = np.concatenate([corners for _, corners in polygons])
        border = 0.4 * float(np.median([np.ptp(corners, axis=0).max() for _, corners in polygons]))
    (left, top), (end, bottom) = outline.min(axis=0) - border, outline.max(axis=0) + border
    return FlatFace(name, float(left), float(end), float(top), float(bottom), tuple(polygons))


def _rightward(parts: list[Part], face: Face | None) -> FloatArray:
    """``(3,)`` horizontal unit vector that points right for who looks at the face: down x into the wall."""
    if face is not None:
        along = face.corners_mm[1] - face.corners_mm[0]
    else:
        along = np.cross([0.0, 1.0, 0.0], -np.sum([part.normal for part in parts], axis=0))
    along = np.array([along[0], 0.0, along[2]])
    length = float(np.linalg.norm(along))
    # A floor or a roof has no horizontal direction of its own; any will do.
    return along / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])


def draw(model_base: ModelBase, path: str | os.PathLike[str]) -> Path:
    """Write the picture to a .png, .svg or .pdf file and return its path.

    Raises:
        InputError: the suffix is another one, or the file cannot be written.
    """
    file = Path(path)
    if file.suffix.lower() not in _FORMATS:
        remedy = f"Use one of {', '.join(_FORMATS)}."
        raise InputError(f"cannot draw into a file of the kind '{file.suffix}'", where=str(file), remedy=remedy)
    from matplotlib.figure import Figure  # late: it is slow to import, and few commands draw

    strips = _strips(model_base)
    gap = _GAP * max(sum(face.width_mm for face in strip.faces) for strip in strips)
    widest = max(sum(face.width_mm + gap for face in strip.faces) for strip in strips)
    inch_per_mm = (_PAGE_WIDTH_IN - 2 * _BORDER_IN) / widest
    page_height = sum(strip.height_in(inch_per_mm) for strip in strips) + _HEAD_IN + 0.1
    figure = Figure(figsize=(_PAGE_WIDTH_IN, page_height), dpi=150)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(-_BORDER_IN / inch_per_mm, (_PAGE_WIDTH_IN - _BORDER_IN) / inch_per_mm)
    axes.set_ylim(page_height / inch_per_mm, 0)
    axes.axis("off")
    colours = {known.name: _COLOURS[i % len(_COLOURS)] for i, known in enumerate(model_base.classes)}
    top = _HEAD_IN / inch_per_mm
    for strip in strips:
        _draw_strip(axes, strip, (top + strip.head_in / inch_per_mm, gap), colours)
        top += strip.height_in(inch_per_mm) / inch_per_mm
    _legend(figure, model_base, colours)
    _scale_bar(figure, inch_per_mm, page_height)
    try:
        figure.savefig(file)
    except OSError as failure:
        raise InputError(
            f"cannot be written: {failure.strerror}", where=str(file), remedy="Check the folder."
        ) from failure
    return file


@dataclass(frozen=True, slots=True)
class _Strip:
    """Façades that are drawn side by side; the first of an object carries its title."""

    faces: list[FlatFace]
    title: str

    @property
    def head_in(self) -> float:
        return 0.42 if self.title else 0.08

    @property
    def walls_mm(self) -> float:
        return max(face.bottom_mm for face in self.faces) - min(face.top_mm for face in self.faces)

    def height_in(self, inch_per_mm: float) -> float:
        return self.head_in + self.walls_mm * inch_per_mm + 0.3


def _strips(model_base: ModelBase) -> list[_Strip]:
    """One strip an object, or as many as it takes to keep parts from being too small to tell."""
    flat = {thing.id: unfold(thing) for thing in model_base.objects}
    sizes = [float(np.ptp(p, axis=0).max()) for faces in flat.values() for face in faces for _, p in face.polygons]
    most_mm = _PAGE_WIDTH_IN * float(np.median(sizes)) / _SMALLEST_PART_IN
    strips = []
    for thing in model_base.objects:
        title = f"{thing.id}: {len(thing.parts)} parts on {len(flat[thing.id])} faces"
        for row in _rows(flat[thing.id], most_mm):
            strips.append(_Strip(row, title))
            title = ""
    return strips


def _rows(faces: tuple[FlatFace, ...], most_mm: float) -> list[list[FlatFace]]:
    """Break the façades into rows of about the same width, none (of several faces) wider than given."""
    total = sum(face.width_mm for face in faces)
    width = total / math.ceil(total / most_mm)
    rows: list[list[FlatFace]] = []
    done = 0.0
    for face in faces:
        # A face goes to the row in which its middle falls.
        row = int((done + face.width_mm / 2) / width)
        if row >= len(rows) or not rows:
            rows.append([])
        rows[-1].append(face)
        done += face.width_mm
    return rows


def _draw_strip(axes: Axes, strip: _Strip, place: tuple[float, float], colours: dict[str, str]) -> None:
    """Draw façades side by side, feet on one line; ``place`` is the strip's top and the gap between façades, mm."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Rectangle

    top, gap = place
    down = top - min(face.top_mm for face in strip.faces)
    foot = top + strip.walls_mm
    by_class: dict[str, list[FloatArray]] = defaultdict(list)
    x, taken = 0.0, -math.inf
    letter_mm = 0.06 * (axes.get_xlim()[1] - axes.get_xlim()[0]) / _PAGE_WIDTH_IN
    for face in strip.faces:
        corner, height = (x, face.top_mm + down), face.bottom_mm - face.top_mm
        axes.add_patch(Rectangle(corner, face.width_mm, height, facecolor=_WALL, edgecolor=_WALL_EDGE, linewidth=0.8))
        for part, corners in face.polygons:
            by_class[part.part_class].append(corners + np.array([x - face.left_mm, down]))
        label, middle = f"{face.name}: {len(face.polygons)}", (x + face.width_mm / 2, foot)
        style: dict[str, Any] = {"va": "top", "ha": "center", "fontsize": 6.5, "color": _INK}
        # A label that would run into the one before goes a line lower.
        reach = len(label) * letter_mm / 2
        lower = middle[0] - reach < taken
        taken = taken if lower else middle[0] + reach
        axes.annotate(label, middle, (0, -11 if lower else -3), textcoords="offset points", **style)
        x += face.width_mm + gap
    for name, polygons in by_class.items():
        axes.add_collection(PolyCollection(polygons, facecolors=colours[name], edgecolors=_INK, linewidths=0.3))
    axes.annotate(strip.title, (0, top), (0, 5), textcoords="offset points", fontsize=10, weight="bold", color=_INK)


def _legend(figure: Any, model_base: ModelBase, colours: dict[str, str]) -> None:
    from matplotlib.patches import Patch

    counts = Counter(part.part_class for thing in model_base.objects for part in thing.parts)
    handles = [Patch(facecolor=c, edgecolor=_INK, label=f"{name}  {counts[name]}") for name, c in colours.items()]
    title = f"{model_base.name}: {len(model_base.objects)} objects, {counts.total()} parts"
    place = (0.4 / _PAGE_WIDTH_IN, 1 - 0.06 / figure.get_figheight())
    legend = figure.legend(handles=handles, loc="upper left", bbox_to_anchor=place, ncols=len(handles), fontsize=9,
                           frameon=False, title=title, alignment="left", borderpad=0, title_fontsize=13)  # fmt: skip
    legend.get_title().set_fontweight("bold")


def _scale_bar(figure: Any, inch_per_mm: float, page_height: float) -> None:
    from matplotlib.lines import Line2D

    length = _round_length(1.5 / inch_per_mm)
    right, y = 1 - 0.4 / _PAGE_WIDTH_IN, 1 - 0.5 / page_height
    left = right - length * inch_per_mm / _PAGE_WIDTH_IN
    figure.add_artist(Line2D([left, right], [y, y], color=_INK, linewidth=2, solid_capstyle="butt"))
    label = f"{length / 1000:g} m" if length >= 1000 else f"{length:g} mm"
    figure.text((left + right) / 2, y - 0.05 / page_height, label, ha="center", va="top", fontsize=9, color=_INK)


def _round_length(length: float) -> float:
    """The longest of 1, 2, 5 times a power of ten that is not longer than given."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length))
