"""Puts what pydantic finds wrong into words for people, with the place in the file and a remedy."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

Location = tuple[str | int, ...]
"""Keys and list indices from the top of the document, e.g. ``("axes", "x", "limits", 0)``."""

ELSEWHERE = "elsewhere"
"""Type of a `PydanticCustomError` of a whole model whose context ``at`` says which value within it is meant."""

_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping (lines of `key: value`)",
    "model_type": "a mapping (lines of `key: value`)",
    "model_attributes_type": "a mapping (lines of `key: value`)",
    "finite_number": "a finite number",
}


@dataclass(frozen=True, slots=True)
class Wording:
    """A problem in words; ``at_key`` tells that the key itself is meant, not its value."""

    location: Location
    message: str
    remedy: str | None = None
    at_key: bool = False


def describe(model: type[BaseModel], detail: Mapping[str, Any], data: Any) -> Wording:
    """Word one entry of ``ValidationError.errors()`` for data that did not fit the model."""
    kind, given, context = detail["type"], detail.get("input"), detail.get("ctx", {})
    location = _in_data(detail["loc"], data)
    if kind == "extra_forbidden":
        return _unknown_key(model, location)
    if kind == "missing":
        name = detail["loc"][-1]
        if isinstance(name, int):
            return Wording(location, f"the list is too short: entry {name + 1} is missing")
        return Wording((*location, name), "this key is missing", f"Add `{name}: ...`.")
    if kind in _KINDS:
        remedy = "Remove the quotes." if isinstance(given, str) and _is_number(given) else None
        return Wording(location, f"should be {_KINDS[kind]}, not {_shown(given)}", remedy)
    if kind in ("literal_error", "enum"):
        return _choice(location, given, str(context.get("expected", "")))
    if kind == "union_tag_invalid":
        at = (*location, str(context["discriminator"]).strip("'"))
        return _choice(at, context["tag"], str(context["expected_tags"]).replace(", ", " or "))
    if kind == "union_tag_not_found":
        name = str(context["discriminator"]).strip("'")
        return Wording((*location, name), "this key is missing", f"Add `{name}: ...`.")
    if kind == ELSEWHERE:
        return Wording((*location, *context["at"]), str(detail["msg"]))
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        word = "at least" if kind == "too_short" else "at most"
        return Wording(location, f"needs {word} {bound} entries, has {context.get('actual_length')}")
    message = str(detail["msg"]).removeprefix("Value error, ").removesuffix(".").replace("Input should", "should")
    return Wording(location, message if isinstance(given, dict | list) else f"{message} (it is {_shown(given)})")


def is_echo(detail: Mapping[str, Any]) -> bool:
    """True for a list that is too short only because its wrong entries, which are told anyway, do not count."""
    shortest = detail.get("ctx", {}).get("min_length", 0)
    return detail["type"] == "too_short" and isinstance(detail["input"], list) and len(detail["input"]) >= shortest


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A remedy that names the known word most like ``name``, or the known words if they are few."""
    names = sorted(set(known))
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f"Did you mean '{close[0]}'?"
    return f"Known here: {', '.join(names)}." if 0 < len(names) <= 12 else None


def _unknown_key(model: type[BaseModel], location: Location) -> Wording:
    known = {name for fields in _models_at(model, location[:-1]) for name in _field_names(fields)}
    return Wording(location, "unknown key", did_you_mean(str(location[-1]), known), at_key=True)


def _choice(location: Location, given: Any, expected: str) -> Wording:
    known = [word.strip().strip("'") for word in expected.replace(" or ", ", ").split(",")]
    guess = did_you_mean(given, known) if isinstance(given, str) else None
    return Wording(location, f"should be {expected}, not {_shown(given)}", guess)


def _shown(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    text = f"the text {value!r}" if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _in_data(location: Sequence[str | int], data: Any) -> Location:
    """The part of pydantic's location that exists in the data (it also names union members and a missing key)."""
    found: list[str | int] = []
    for name in location:
        in_list = isinstance(data, list) and isinstance(name, int) and name < len(data)
        if in_list or (isinstance(data, Mapping) and name in data):
            data = data[name]
            found.append(name)
    return tuple(found)


def _field_names(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


def _models_at(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    """The models that may stand at a location, following fields, lists, mappings and unions."""
    annotations: list[Any] = [model]
    for name in location:
        annotations = [inner for outer in annotations for inner in _step(outer, name)]
    return [a for a in annotations if isinstance(a, type) and issubclass(a, BaseModel)]


def _step(annotation: Any, name: str | int) -> list[Any]:
    inner: list[Any] = []
    for member in _members(annotation):
        origin, arguments = get_origin(member), get_args(member)
        if isinstance(member, type) and issubclass(member, BaseModel):
            fields = member.model_fields.items()
            inner += [field.annotation for field_name, field in fields if (field.alias or field_name) == name]
        elif isinstance(origin, type) and issubclass(origin, Mapping) and len(arguments) == 2:
            inner.append(arguments[1])
        elif isinstance(origin, type) and issubclass(origin, Sequence) and isinstance(name, int):
            fixed = [a for a in arguments if a is not Ellipsis]
            inner.append(fixed[name] if 1 < len(fixed) > name else fixed[0])
    return [member for found in inner for member in _members(found)]


def _members(annotation: Any) -> list[Any]:
    """The alternatives of a union, ``Annotated`` removed."""
    if get_origin(annotation) is Annotated:
        return _members(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return [member for choice in get_args(annotation) for member in _members(choice)]
    return [annotation]
