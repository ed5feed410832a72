"""Writes a model base as YAML, a part a line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from recognition.modelbase import Face, ModelBase, Part, PartClass
from rig.schema import plain_scalar

FloatArray = npt.NDArray[np.float64]
_PLAIN_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")


def model_base_to_yaml(model_base: ModelBase, comment: str = "") -> str:
    """The text of a model base file; ``comment`` goes on top. Lengths are rounded to 0.001 mm.

    All classes are written out, so that the text means the same whatever classes are built in.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += ["version: 1", f"name: {_word(model_base.name)}"] if model_base.name else ["version: 1"]
    lines += ["classes:", *map(_class_line, model_base.classes)] if model_base.classes else []
    lines.append("objects:")
    for thing in model_base.objects:
        lines.append(f"- id: {_word(thing.id)}")
        if thing.faces:
            lines += ["  faces:", *map(_face_line, thing.faces)]
        lines += ["  parts:", *map(_part_line, thing.parts)]
    return "\n".join(lines) + "\n"


def _class_line(part_class: PartClass) -> str:
    entries = [f"name: {_word(part_class.name)}", f"bright: {json.dumps(part_class.bright)}"]
    if part_class.canonical is not None:
        entries.append(f"corners: {_points(part_class.canonical)}")
    return f"- {{{', '.join(entries)}}}"


def _face_line(face: Face) -> str:
    return f"  - {{id: {_word(face.id)}, corners_mm: {_points(face.corners_mm)}}}"


def _part_line(part: Part) -> str:
    entries = [f"id: {_word(part.id)}", f"class: {_word(part.part_class)}"]
    entries += [f"face: {_word(part.face)}"] if part.face is not None else []
    entries += [f"look: {_word(part.look)}"] if part.look is not None else []
    entries += [f"recess_mm: {_number(part.recess_mm)}"] if part.recess_mm else []
    return f"  - {{{', '.join(entries)}, corners_mm: {_points(part.corners_mm)}}}"


def _points(points: FloatArray) -> str:
    return f"[{', '.join(f'[{_row(point)}]' for point in points)}]"


def _row(values: Iterable[float]) -> str:
    return ", ".join(_number(value) for value in values)


def _number(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _word(text: str) -> str:
    """The text as a YAML scalar: plain where nobody can mistake it, else in double quotes."""
    if _PLAIN_WORD.fullmatch(text) and plain_scalar(text) == (text, None):
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in quoted)
