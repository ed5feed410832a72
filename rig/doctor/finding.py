"""What the doctor says: one line a check, with a verdict and, where something is wrong, what to do about it."""

from __future__ import annotations

import enum
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rig.errors import InputError, RigError

_SENTENCE_END = re.compile(r"(?<![ .])\. ")
"""Not the dots of a range."""


class Verdict(enum.Enum):
    """How a check ended."""

    PASS = "pass"
    WARN = "warn"
    """It will work, but worse or less safely than it could."""
    FAIL = "fail"
    """It will not work, or not safely."""
    NOT_TESTED = "not tested"
    """It rests on a check that failed."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One check.

    Attributes:
        subject: the device or the part of the computer, e.g. ``gantry``.
        what: was looked at, e.g. ``soft limits``.
        ok: the verdict.
        told: what was found, with values.
        remedy: what to do about it; empty where the check passed.
    """

    subject: str
    what: str
    ok: Verdict
    told: str
    remedy: str = ""


def passed(subject: str, what: str, told: str) -> Finding:
    """Nothing is wrong."""
    return Finding(subject, what, Verdict.PASS, told)


def warned(subject: str, what: str, told: str, remedy: str) -> Finding:
    """It works, but should be looked at."""
    return Finding(subject, what, Verdict.WARN, told, remedy)


def failed(subject: str, what: str, told: str, remedy: str) -> Finding:
    """It must be put right."""
    return Finding(subject, what, Verdict.FAIL, told, remedy)


def raised(subject: str, what: str, error: RigError) -> Finding:
    """A check that ended in an error: every error of ours tells first what is wrong, then the remedy."""
    if isinstance(error, InputError):
        where = f"{error.where}: " if error.where else ""
        return failed(subject, what, f"{where}{error.message}", error.remedy or "")
    told, remedy = in_two(str(error))
    return failed(subject, what, told, remedy)


def in_two(message: str) -> tuple[str, str]:
    """What is wrong, and what to do about it, of a message that tells them in this order."""
    told, *rest = _SENTENCE_END.split(message, maxsplit=1)
    return told, "".join(rest)


def not_tested(subject: str, whats: Iterable[str], on: str) -> list[Finding]:
    """Checks that rest on another one, named ``on``, that failed."""
    return [Finding(subject, what, Verdict.NOT_TESTED, f"rests on {on}, which failed") for what in whats]


def healthy(findings: Sequence[Finding]) -> bool:
    """No check failed; warnings are allowed."""
    return all(finding.ok is not Verdict.FAIL for finding in findings)
