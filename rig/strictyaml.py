"""Turns YAML text into plain data, refusing everything that readers of YAML disagree about."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

from rig.errors import InputError

MAX_DEPTH = 32

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(?P<real>(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?)")
_NOT_FINITE = re.compile(r"[-+]?\.?(?:inf|infinity|nan)", re.IGNORECASE)
_SEXAGESIMAL = re.compile(r"[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?")
_OTHER_NUMBER = re.compile(
    r"[-+]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?|[-+]?0(?:[xX][0-9a-fA-F_]+|[oO][0-7_]+|[bB][01_]+)"
)
_DATE = re.compile(r"[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}(?:[Tt\s].*)?")
_BOOLEANS = {"yes": "true", "on": "true", "true": "true", "no": "false", "off": "false", "false": "false"}
_LONGEST_NUMBER = 40


@dataclass(frozen=True, slots=True)
class Mark:
    """Where a value stands (1-based), where its keys stand, and the same of what it contains."""

    line: int
    column: int
    keys: dict[str, Mark] = field(default_factory=dict)
    children: dict[str | int, Mark] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ScalarProblem:
    """A value that could be read in more than one way, and what to write instead."""

    mark: Mark
    message: str
    remedy: str


@dataclass(slots=True)
class _Open:
    """A list or mapping that is being filled; ``key`` is a mapping's key whose value comes next."""

    container: list[Any] | dict[str, Any]
    mark: Mark
    key: str | None = None


class StrictReader:
    """Builds data from the parser's events with a stack of its own, so that depth costs no recursion.

    Args:
        source: names the text in messages.
        text: the YAML text.
        error: what to raise, with ``file:line:column`` and a remedy.
    """

    def __init__(self, source: str, text: str, error: type[InputError] = InputError) -> None:
        self.source, self.text, self.error = source, text, error
        self.problems: list[ScalarProblem] = []
        self._with_marks = False

    def read(self, *, with_marks: bool = False) -> tuple[Any, Mark]:
        """Return the data, and the marks if they are asked for (they cost more memory than the data).

        Ambiguous scalars do not stop the reading; they are gathered in ``problems``.

        Raises:
            InputError: (or the subclass given) for everything else that is refused.
        """
        self.problems.clear()
        self._with_marks = with_marks
        try:
            return self._build()
        except yaml.reader.ReaderError as failure:
            character, place = failure.character, failure.position
            line, column = self.text.count("\n", 0, place) + 1, place - self.text.rfind("\n", 0, place)
            shown = ascii(chr(character) if isinstance(character, int) else character)
            raise self._refusal(f"the character {shown} is not allowed", Mark(line, column), "Remove it.") from failure
        except yaml.MarkedYAMLError as failure:
            found = failure.problem_mark or failure.context_mark
            mark = Mark(found.line + 1, found.column + 1) if found else Mark(1, 1)
            remedy = "Check brackets, quotes, colons and the indentation (spaces, no tabs)."
            problem = f"this is not YAML: {failure.problem or failure.context}"
            raise self._refusal(problem, mark, remedy) from failure

    def _refusal(self, message: str, mark: Mark, remedy: str) -> InputError:
        return self.error(message, where=f"{self.source}:{mark.line}:{mark.column}", remedy=remedy)

    def _events(self) -> Iterator[Any]:
        """The events of nodes in the one document, having refused what is banned everywhere."""
        documents = 0
        for event in yaml.parse(self.text, Loader=_Loader):
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._refusal("a second document begins here", _mark(event), "Keep one document a file.")
                if event.version or event.tags:
                    raise self._refusal("directives are not used here", _mark(event), "Remove the line with '%'.")
            elif isinstance(event, yaml.NodeEvent | yaml.CollectionEndEvent):
                self._refuse_references(event)
                yield event

    def _refuse_references(self, event: Any) -> None:
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            message = "anchors (&) and aliases (*) are not used here"
            raise self._refusal(message, _mark(event), "Write the values out in each place, or quote the text.")
        if getattr(event, "tag", None):
            message = f"tags such as {event.tag} are not used here"
            raise self._refusal(message, _mark(event), "Remove it, or quote text that begins with '!'.")

    def _build(self) -> tuple[Any, Mark]:
        documents: list[Any] = []
        root = _Open(documents, Mark(1, 1))
        stack = [root]
        for event in self._events():
            here = stack[-1]
            if isinstance(event, yaml.CollectionEndEvent):
                stack.pop()
            elif isinstance(here.container, dict) and here.key is None:
                here.key = self._new_key(event, here)
            else:
                opened = self._new_value(event, here)
                if opened is not None:
                    stack.append(opened)
                    if len(stack) - 1 > MAX_DEPTH:
                        message = f"more than {MAX_DEPTH} levels of nesting"
                        raise self._refusal(message, _mark(event), "Is a closing bracket missing?")
        if not documents:
            raise self._refusal("the file is empty", root.mark, "Is it the file that you meant?")
        return documents[0], root.mark.children.get(0, root.mark)

    def _new_key(self, event: Any, here: _Open) -> str:
        mark = _mark(event)
        if not isinstance(event, yaml.ScalarEvent):
            raise self._refusal("a key must be a word", mark, "Remove the '?' or the brackets before the colon.")
        key = str(event.value)
        if event.implicit[0]:
            if key == "<<":
                raise self._refusal("merge keys (<<) are not used here", mark, "Write the keys out.")
            if not _is_plain_word(key):
                raise self._refusal(
                    f"the key {key!r} could be read as something else", mark, f'Write "{key}" in quotes.'
                )
        if key in here.container:
            remedy = "Keep one of the two."
            raise self._refusal(f"the key '{key}' stands twice in the same place", mark, remedy)
        if self._with_marks:
            here.mark.keys[key] = mark
        return key

    def _new_value(self, event: Any, here: _Open) -> _Open | None:
        """Put the value into what is being filled; return it opened if it is a list or mapping."""
        value: Any
        if isinstance(event, yaml.ScalarEvent):
            value = self._scalar(event)
        else:
            value = {} if isinstance(event, yaml.MappingStartEvent) else []
        if isinstance(here.container, dict):
            assert here.key is not None
            place: str | int = here.key
            here.container[here.key], here.key = value, None
        else:
            place = len(here.container)
            here.container.append(value)
        mark = here.mark
        if self._with_marks:
            mark = here.mark.children[place] = _mark(event)
        return _Open(value, mark) if isinstance(event, yaml.CollectionStartEvent) else None

    def _scalar(self, event: Any) -> Any:
        if not event.implicit[0]:
            return str(event.value)
        value, trouble = plain_scalar(event.value)
        if trouble is not None:
            self.problems.append(ScalarProblem(_mark(event), *trouble))
        return value


def _mark(event: Any) -> Mark:
    return Mark(event.start_mark.line + 1, event.start_mark.column + 1)


@functools.lru_cache(maxsize=1024)
def _is_plain_word(text: str) -> bool:
    # Files hold few different keys, many times each.
    value, trouble = plain_scalar(text)
    return trouble is None and isinstance(value, str)


def plain_scalar(text: str) -> tuple[Any, tuple[str, str] | None]:
    """The value of an unquoted scalar, and (message, remedy) if YAML's readers disagree about it.

    Numbers, ``true``, ``false`` and ``null`` are written as in JSON. Anything else is text, unless some version of YAML
    reads it as a number, a truth value, a date or nothing.
    """
    number = _NUMBER.fullmatch(text)
    if number and len(text) <= _LONGEST_NUMBER:
        value = float(text) if number["real"] else int(text)
        if math.isfinite(value):
            return value, None
        return text, (f"{text} is too large for a number", "Write a smaller number.")
    if text in ("true", "false", "null"):
        return {"true": True, "false": False, "null": None}[text], None
    return text, _trouble(text)


def _trouble(text: str) -> tuple[str, str] | None:
    quoted = f'Write "{text}" in quotes if it is text.'
    if text.lower() in ("", "~", "null"):
        return "there is no value", "Write a value, or remove the key; write null where nothing is meant."
    if text.lower() in _BOOLEANS:
        meant = _BOOLEANS[text.lower()]
        return f"{text} is read as a truth value by some and as text by others", f"Write {meant}, or quote it."
    if _NOT_FINITE.fullmatch(text):
        return f"{text} is not a finite number", f"Write a number. {quoted}"
    if _SEXAGESIMAL.fullmatch(text):
        return f"{text} is read as a number to the base 60 by some", quoted
    if len(text) > _LONGEST_NUMBER and _NUMBER.fullmatch(text):
        return f"this number has {len(text)} characters", f"Write at most {_LONGEST_NUMBER}."
    if _OTHER_NUMBER.fullmatch(text):
        return f"{text} is read as different numbers", f"Write numbers as in JSON: 10, -0.5, 1e3. {quoted}"
    if _DATE.fullmatch(text):
        return f"{text} is read as a date by some and as text by others", quoted
    if text in ("=", "<<"):
        return f"{text} has a special meaning to some", quoted
    return None
