"""What a GRBL-family controller writes, line by line, as values; what is not a whole, valid line is `Garbage`.

Lines carry no checksum, so that the forms are held to strictly: a status report with a digit or a bracket missing is
dropped, not guessed at. Positions are in mm once `StatusReport.in_mm` has been told of ``$13``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

Triple = tuple[float, float, float]
MM_PER_INCH = 25.4

STATES = frozenset({"Idle", "Run", "Hold", "Jog", "Alarm", "Door", "Check", "Home", "Sleep", "Tool"})
_STATUS = re.compile(r"<([A-Z][a-z]+)(?::(\d{1,2}))?\|([^<>]*)>")
_COORDINATES = re.compile(r"-?\d{1,6}\.\d{3,4}(?:,-?\d{1,6}\.\d{3,4}){2,5}")
_BANNER = re.compile(r"(?:Grbl \d|GrblHAL )[^<>]*\[.*help\]")
_SETTING = re.compile(r"\$(\d{1,4})=(-?\d{1,9}(?:\.\d{1,6})?)(?: .*)?")


@dataclass(frozen=True, slots=True)
class Ok:
    """``ok``: the line was buffered."""


@dataclass(frozen=True, slots=True)
class Refused:
    """``error:n``."""

    number: int


@dataclass(frozen=True, slots=True)
class AlarmLine:
    """``ALARM:n``."""

    number: int


@dataclass(frozen=True, slots=True)
class Banner:
    """A start-up banner: the controller has restarted."""

    text: str


@dataclass(frozen=True, slots=True)
class Setting:
    """``$n=value``."""

    number: int
    value: float


@dataclass(frozen=True, slots=True)
class Message:
    """``[…]``."""

    text: str


@dataclass(frozen=True, slots=True)
class Garbage:
    """A line that is none of the others."""

    text: str


@dataclass(frozen=True, slots=True)
class StatusReport:
    """``<…>``.

    Attributes:
        state: one of `STATES`.
        substate: the number behind the state, e.g. 0 in ``Hold:0``.
        machine, work: the position, whichever of the two the report carries.
        offset: machine minus work; only some reports carry it.
        homed: grblHAL's ``H:``, where it is sent.
    """

    state: str
    substate: int | None
    machine: Triple | None
    work: Triple | None
    offset: Triple | None
    homed: bool | None = None

    def in_mm(self) -> StatusReport:
        """The same report, of a controller that reports inches."""
        return replace(self, machine=_to_mm(self.machine), work=_to_mm(self.work), offset=_to_mm(self.offset))

    def position(self, offset: Triple | None) -> Triple | None:
        """Machine coordinates; a report of work coordinates needs the offset that was told last."""
        if self.machine is not None:
            return self.machine
        shift = self.offset or offset
        if self.work is None or shift is None:
            return None
        return (self.work[0] + shift[0], self.work[1] + shift[1], self.work[2] + shift[2])


Reply = Ok | Refused | AlarmLine | Banner | Setting | Message | StatusReport | Garbage


def parse_reply(line: str) -> Reply:
    """Read one line; never raises."""
    if line == "ok":
        return Ok()
    if match := re.fullmatch(r"error:(\d{1,3})", line):
        return Refused(int(match[1]))
    if match := re.fullmatch(r"ALARM:(\d{1,3})", line):
        return AlarmLine(int(match[1]))
    if line.startswith("<"):
        return _status(line) or Garbage(line)
    if _BANNER.fullmatch(line):
        return Banner(line)
    if match := _SETTING.fullmatch(line):
        return Setting(int(match[1]), float(match[2]))
    if re.fullmatch(r"\[[\x20-\x7e]*\]", line):
        return Message(line[1:-1])
    return Garbage(line)


def _status(line: str) -> StatusReport | None:
    match = _STATUS.fullmatch(line)
    if match is None or match[1] not in STATES:
        return None
    found: dict[str, Triple] = {}
    homed = None
    for text in match[3].split("|"):
        name, colon, value = text.partition(":")
        if name in ("MPos", "WPos", "WCO"):
            if name in found or not _COORDINATES.fullmatch(value):
                return None
            numbers = [float(number) for number in value.split(",")]
            found[name] = (numbers[0], numbers[1], numbers[2])
        elif name == "H" and value[:1] in ("0", "1"):
            homed = value[0] == "1"
        elif not colon or not name.isalpha():
            return None
    if ("MPos" in found) == ("WPos" in found):
        return None
    substate = int(match[2]) if match[2] else None
    return StatusReport(match[1], substate, found.get("MPos"), found.get("WPos"), found.get("WCO"), homed)


def _to_mm(value: Triple | None) -> Triple | None:
    return None if value is None else (value[0] * MM_PER_INCH, value[1] * MM_PER_INCH, value[2] * MM_PER_INCH)
