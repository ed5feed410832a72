"""Reads files against a schema: strict YAML in, a checked value out, every error with file, line, column and remedy."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from rig.errors import InputError
from rig.schema_words import Location, Wording, describe, is_echo
from rig.schema_words import did_you_mean as did_you_mean
from rig.strictyaml import Mark, StrictReader
from rig.strictyaml import plain_scalar as plain_scalar

BENCH_MAX_BYTES = 256 * 1024
MODEL_BASE_MAX_BYTES = 64 * 1024 * 1024
MAX_PROBLEMS = 20

ModelT = TypeVar("ModelT", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing wrong in a document: where, what, and what to do about it."""

    where: str
    message: str
    remedy: str | None = None

    def __str__(self) -> str:
        text = f"{self.where}: {self.message}"
        return f"{text}. {self.remedy}" if self.remedy else text


@dataclass(frozen=True)
class Document:
    """What was read from a file, and the means to say where in the file a value stands.

    Attributes:
        source: the path as the user gave it, for messages.
        data: dictionaries, lists, strings, finite numbers, booleans and None.
        text: the file's text.
    """

    source: str
    data: Any = field(repr=False)
    text: str = field(repr=False)

    @cached_property
    def _marks(self) -> Mark:
        # Marks cost more memory than the data, and only errors need them: the text is read a second time then.
        return StrictReader(self.source, self.text).read(with_marks=True)[1]

    def where(self, location: Location, *, key: bool = False) -> str:
        """``file:line:column`` of the value (or the key) at a location, or of the innermost value around it."""
        mark = self._marks
        for name in location[:-1] if key else location:
            if name not in mark.children:
                break
            mark = mark.children[name]
        else:
            if key and location:
                mark = mark.keys.get(str(location[-1]), mark)
        return f"{self.source}:{mark.line}:{mark.column}"

    def problem(self, location: Location, message: str, remedy: str | None = None, *, key: bool = False) -> Problem:
        """A problem with the value (or the key) at a location; the message begins with ``path.to.key:``."""
        path = dotted(location)
        return Problem(self.where(location, key=key), f"{path}: {message}" if path else message, remedy)


def dotted(location: Location) -> str:
    """A location as people write it: ``objects[3].parts[2].corners_mm``."""
    text = ""
    for name in location:
        text += f"[{name}]" if isinstance(name, int) else f".{name}" if text else name
    return text


def raise_problems(problems: Sequence[Problem], error: type[InputError] = InputError) -> None:
    """Raise one error that tells all problems, one a line (at most ``MAX_PROBLEMS``); do nothing if there are none."""
    if not problems:
        return
    first = problems[0]
    if len(problems) == 1:
        raise error(first.message, where=first.where, remedy=first.remedy)
    lines = [str(problem) for problem in problems[:MAX_PROBLEMS]]
    if len(problems) > MAX_PROBLEMS:
        lines.append(f"... and {len(problems) - MAX_PROBLEMS} more problems")
    raise error("\n".join(lines).removeprefix(f"{first.where}: "), where=first.where)


def load_yaml(path: str | os.PathLike[str], *, max_bytes: int, error: type[InputError] = InputError) -> Document:
    """Read one YAML document strictly (see `rig.strictyaml`).

    Refused: tags, anchors, aliases, duplicate keys, directives, several documents, numbers that are not finite, scalars
    that YAML 1.1 reads as something else than they look (``010``, ``1:30``, ``off``), nesting deeper than
    `rig.strictyaml.MAX_DEPTH`, more than ``max_bytes`` bytes, other encodings than UTF-8, and empty files.

    Raises:
        InputError: (or the subclass ``error``) with file:line:column and a remedy.
    """
    source = os.fspath(path)
    return parse_yaml(_read_text(source, max_bytes, error), source, error=error)


def parse_yaml(text: str, source: str, *, error: type[InputError] = InputError) -> Document:
    """Like `load_yaml`, for text that has been read already; ``source`` names it in messages."""
    reader = StrictReader(source, text, error)
    data, _ = reader.read()
    raise_problems(
        [Problem(f"{source}:{p.mark.line}:{p.mark.column}", p.message, p.remedy) for p in reader.problems], error
    )
    return Document(source, data, text)


def validate(model: type[ModelT], document: Document, *, error: type[InputError] = InputError) -> ModelT:
    """Check a document against a pydantic model, strictly: a number in quotes is text, not a number.

    Raises:
        InputError: (or the subclass ``error``) listing every problem as ``file:line:column: path.to.key: message``.
    """
    value, problems = check(model, document)
    raise_problems(problems, error)
    if value is None:
        raise AssertionError("a validation error without details")
    return value


def check(
    model: type[ModelT], document: Document, *, at: Location = (), without: Sequence[str] = ()
) -> tuple[ModelT | None, list[Problem]]:
    """Like `validate`, for the part of a document at a location, some of its keys left out; problems are returned."""
    data = document.data
    for name in at:
        data = data[name]
    if without:
        data = {key: value for key, value in data.items() if key not in without}
    try:
        # As JSON, strict mode still takes lists for tuples and text for enumerations, which YAML cannot say otherwise.
        return model.model_validate_json(json.dumps(data), strict=True), []
    except ValidationError as failure:
        details = failure.errors(include_url=False)
    wordings: dict[Wording, None] = dict.fromkeys(describe(model, d, data) for d in details if not is_echo(d))
    return None, [document.problem((*at, *w.location), w.message, w.remedy, key=w.at_key) for w in wordings]


def load_model(
    path: str | os.PathLike[str], model: type[ModelT], max_bytes: int, *, error: type[InputError] = InputError
) -> ModelT:
    """`load_yaml`, then `validate`."""
    return validate(model, load_yaml(path, max_bytes=max_bytes, error=error), error=error)


def _read_text(source: str, max_bytes: int, error: type[InputError]) -> str:
    file = Path(source)
    try:
        if not file.exists():
            raise error("there is no such file", where=source, remedy="Check the path.")
        if not file.is_file():
            raise error("this is not a regular file", where=source, remedy="Give the path of a YAML file.")
        with file.open("rb") as stream:
            raw = stream.read(max_bytes + 1)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise error(f"cannot be read: {reason}", where=source, remedy="Check its name and permissions.") from failure
    if len(raw) > max_bytes:
        limit = f"{max_bytes / 1024:g} KiB"
        raise error(f"the file is larger than {limit}", where=source, remedy="Is it the file that you meant?")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        # A byte order mark is no character: offsets in a file with one are three bytes further on.
        before = failure.object[: failure.start].decode("utf-8", "replace")
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        byte = failure.object[failure.start]
        where = f"{source}:{line}:{column}"
        raise error(f"the byte 0x{byte:02x} is not UTF-8", where=where, remedy="Save the file as UTF-8.") from failure
