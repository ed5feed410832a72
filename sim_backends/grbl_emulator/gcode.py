"""Reads a line of g-code as GRBL does: words, modal groups, units, offsets; a wrong line is refused whole, by number.

Machine coordinates are in mm. Only what a gantry without spindle can meet is known: G0 G1 G4 G10 G20 G21 G28.1 G53
G54-G59 G80 G90 G91 G92 G92.1 G93 G94 and harmless M words; all else is error:20.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

Triple = tuple[float, float, float]
MM_PER_INCH = 25.4
_AXES = "XYZ"
_GROUPS = {
    0: "motion", 1: "motion", 80: "motion",
    4: "non-modal", 10: "non-modal", 53: "non-modal", 92: "non-modal", 28.1: "non-modal", 92.1: "non-modal",
    17: "plane", 18: "plane", 19: "plane", 90: "distance", 91: "distance", 93: "feed", 94: "feed",
    20: "units", 21: "units", 54: "system", 55: "system", 56: "system", 57: "system", 58: "system", 59: "system",
    40: "cutter", 49: "length", 61: "control",
}  # fmt: skip
_M_WORDS = {0, 1, 2, 3, 4, 5, 7, 8, 9, 30}


class LineError(Exception):
    """A line that is refused; ``code`` is the number that follows ``error:``."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error:{code}")
        self.code = code


@dataclass(frozen=True, slots=True)
class Modal:
    """What lines before have left behind; ``feed_mm_min`` is 0 until one was given."""

    motion: int = 0
    inches: bool = False
    relative: bool = False
    inverse_time: bool = False
    system: int = 0
    feed_mm_min: float = 0.0
    g92: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Move:
    """A straight move to a place in machine coordinates; no feed: as fast as the axes can."""

    target: Triple
    feed_mm_min: float | None


@dataclass(frozen=True, slots=True)
class Dwell:
    """Wait, once all motion is done."""

    seconds: float


@dataclass(frozen=True, slots=True)
class StoreOffset:
    """Write the offset of a coordinate system to the EEPROM; ``None``: write, change nothing we look at (G28.1)."""

    system: int
    offset: Triple | None


Action = Move | Dwell | StoreOffset | None


def read_number(text: str) -> tuple[float, str]:
    """A number as GRBL reads it (sign, digits, one point, no exponent), and what follows it.

    Raises:
        LineError: 2, there are no digits.
    """
    end = 1 if text[:1] in ("+", "-") and text else 0
    point = digits = 0
    while end < len(text) and (text[end].isdigit() or (text[end] == "." and not point)):
        point += text[end] == "."
        digits += text[end] != "."
        end += 1
    if not digits:
        raise LineError(2)
    return float(text[:end]), text[end:]


def words_of(line: str) -> list[tuple[str, float]]:
    """The words of a line that holds neither spaces nor comments.

    Raises:
        LineError: 1, a letter was expected; 2, a number.
    """
    words = []
    while line:
        letter, line = line[0], line[1:]
        if not ("A" <= letter <= "Z"):
            raise LineError(1)
        value, line = read_number(line)
        words.append((letter, value))
    return words


def interpret(line: str, modal: Modal, offsets: list[Triple], at: Triple, *, jog: bool = False) -> tuple[Modal, Action]:
    """What a line asks for.

    Args:
        line: upper case, without spaces and comments; of a jog what follows ``$J=``.
        modal: what holds before the line.
        offsets: of G54 to G59, mm.
        at: the place that the planner has been given last, machine coordinates.
        jog: the line is a jog: relative or absolute for itself, feed needed, modal state stays.

    Raises:
        LineError: the line is refused, as a whole.
    """
    codes, values = _sort(words_of(line))
    for group in codes:
        if jog and group not in ("units", "distance", "non-modal"):
            raise LineError(16)
    if jog and codes.get("non-modal", 53) != 53:
        raise LineError(16)
    changed = _with_codes(modal, codes)
    per_unit = MM_PER_INCH if changed.inches else 1.0
    axes = {axis: values[axis] * per_unit for axis in _AXES if axis in values}
    if "F" in values and changed.inverse_time:
        changed = replace(changed, feed_mm_min=0.0)
    elif "F" in values:
        changed = replace(changed, feed_mm_min=values["F"] * per_unit)
    special = codes.get("non-modal")
    if special in (4, 10, 92, 28.1, 92.1):
        return _special(special, values, axes, changed, offsets, at)
    if special == 53 and not jog and changed.motion not in (0, 1):
        raise LineError(30)
    if not axes:
        if jog:
            raise LineError(26)
        return changed, None
    target = _target(axes, changed, offsets, at, absolute=special == 53)
    if jog:
        if "F" not in values or changed.feed_mm_min <= 0:
            raise LineError(22)
        return modal, Move(target, changed.feed_mm_min)
    if changed.motion == 80:
        raise LineError(31)
    if changed.motion == 0:
        return changed, Move(target, None)
    feed = _feed(values, changed, target, at)
    return changed, Move(target, feed)


def _feed(values: dict[str, float], modal: Modal, target: Triple, at: Triple) -> float:
    if modal.inverse_time:
        if "F" not in values or values["F"] <= 0:
            raise LineError(22)
        return max(math.dist(target, at), 1e-6) * values["F"]
    if modal.feed_mm_min <= 0:
        raise LineError(22)
    return modal.feed_mm_min


def _sort(words: list[tuple[str, float]]) -> tuple[dict[str, float], dict[str, float]]:
    """G words by modal group, and the other words."""
    codes: dict[str, float] = {}
    values: dict[str, float] = {}
    for letter, value in words:
        if letter == "G":
            group = _GROUPS.get(value)
            if group is None:
                raise LineError(20)
            if group in codes:
                raise LineError(21)
            codes[group] = value
        elif letter == "M":
            if value not in _M_WORDS:
                raise LineError(20)
        elif letter in "XYZFPLSTN":
            if letter in values:
                raise LineError(25)
            if letter in "FPSN" and value < 0:
                raise LineError(4)
            values[letter] = value
        else:
            raise LineError(20)
    return codes, values


def _with_codes(modal: Modal, codes: dict[str, float]) -> Modal:
    if "units" in codes:
        modal = replace(modal, inches=codes["units"] == 20)
    if "distance" in codes:
        modal = replace(modal, relative=codes["distance"] == 91)
    if "feed" in codes:
        modal = replace(modal, inverse_time=codes["feed"] == 93, feed_mm_min=0.0)
    if "system" in codes:
        modal = replace(modal, system=int(codes["system"]) - 54)
    if "motion" in codes:
        modal = replace(modal, motion=int(codes["motion"]))
    return modal


def _special(
    code: float, values: dict[str, float], axes: dict[str, float], modal: Modal, offsets: list[Triple], at: Triple
) -> tuple[Modal, Action]:
    system = offsets[modal.system]
    if code == 4:
        if "P" not in values:
            raise LineError(28)
        return modal, Dwell(values["P"])
    if code == 92.1:
        return replace(modal, g92=(0.0, 0.0, 0.0)), None
    if code == 28.1:
        return modal, StoreOffset(modal.system, None)
    if not axes:
        raise LineError(26)
    if code == 92:
        shift = [at[i] - system[i] - axes[a] if a in axes else modal.g92[i] for i, a in enumerate(_AXES)]
        return replace(modal, g92=(shift[0], shift[1], shift[2])), None
    if values.get("L") not in (2, 20):
        raise LineError(20 if "L" in values else 28)
    number = int(values.get("P", 0)) - 1
    number = modal.system if number < 0 else number
    if number >= len(offsets):
        raise LineError(29)
    old = offsets[number]
    new = [
        old[i] if a not in axes else axes[a] if values["L"] == 2 else at[i] - modal.g92[i] - axes[a]
        for i, a in enumerate(_AXES)
    ]
    return modal, StoreOffset(number, (new[0], new[1], new[2]))


def work_offset(modal: Modal, offsets: list[Triple]) -> Triple:
    """Machine minus work coordinates: the ``WCO`` of status reports."""
    system = offsets[modal.system]
    return (system[0] + modal.g92[0], system[1] + modal.g92[1], system[2] + modal.g92[2])


def _target(axes: dict[str, float], modal: Modal, offsets: list[Triple], at: Triple, *, absolute: bool) -> Triple:
    offset = work_offset(modal, offsets)
    found = []
    for index, axis in enumerate(_AXES):
        if axis not in axes:
            found.append(at[index])
        elif absolute:
            found.append(axes[axis])
        elif modal.relative:
            found.append(at[index] + axes[axis])
        else:
            found.append(axes[axis] + offset[index])
    return (found[0], found[1], found[2])
