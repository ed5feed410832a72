"""Loads model bases from YAML and refuses what would give confident nonsense, naming the line."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from recognition.modelbase import ModelBase
from recognition.modelbase_check import build
from recognition.modelbase_file import ModelBaseFile
from rig.errors import ModelBaseError
from rig.schema import MODEL_BASE_MAX_BYTES, Document, did_you_mean, load_yaml, parse_yaml, validate


def load_model_base(name_or_path: str | os.PathLike[str]) -> ModelBase:
    """Load a model base: a file, or, by a name without suffix, one of those that ship (``architecture``, ``campus``).

    Part-classes are those that the parts use, taken from the file's ``classes`` and then from the built-in ones. Unless
    the file says otherwise a DW4 may be brighter or darker than its wall, but is darker where OPEN, which differs from
    it only in being brighter, is used beside it.

    Raises:
        ModelBaseError: (an InputError) listing every broken rule as ``file:line:column: path: message. remedy``.
    """
    path = Path(name_or_path)
    if path.suffix or path.name != os.fspath(name_or_path):
        return _build(load_yaml(name_or_path, max_bytes=MODEL_BASE_MAX_BYTES, error=ModelBaseError), path.stem)
    shipped = {entry.name.removesuffix(".yaml"): entry for entry in _shipped_files()}
    if path.name not in shipped:
        remedy = did_you_mean(path.name, shipped) or "Give the path of a YAML file, with its suffix."
        raise ModelBaseError(f"no model base of the name '{path.name}' ships with the package", remedy=remedy)
    with resources.as_file(shipped[path.name]) as file:
        return _build(load_yaml(file, max_bytes=MODEL_BASE_MAX_BYTES, error=ModelBaseError), path.name)


def parse_model_base(text: str, source: str = "<text>") -> ModelBase:
    """Like `load_model_base`, for YAML text; ``source`` names it in messages."""
    return _build(parse_yaml(text, source, error=ModelBaseError), Path(source).stem)


def shipped_model_bases() -> tuple[str, ...]:
    """Names of the model bases that ship with the package."""
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in _shipped_files()))


def _shipped_files() -> Iterator[resources.abc.Traversable]:
    # The bench's package holds the data; it is read as files, so nothing of the bench is imported.
    for entry in (resources.files("rig") / "data").iterdir():
        if entry.name.endswith(".yaml"):
            yield entry


def _build(document: Document, name: str) -> ModelBase:
    return build(validate(ModelBaseFile, document, error=ModelBaseError), document, name)


@dataclass(frozen=True, slots=True)
class ModelBaseSummary:
    """Counts of a model base: parts per object and per part-class, and per object of each part-class."""

    name: str
    parts: int
    by_object: dict[str, int]
    by_class: dict[str, int]
    by_object_and_class: dict[str, dict[str, int]]


def describe(model_base: ModelBase) -> ModelBaseSummary:
    """Count a model base's parts."""
    per_object = {thing.id: Counter(part.part_class for part in thing.parts) for thing in model_base.objects}
    names = [known.name for known in model_base.classes]
    table = {thing: {name: counts[name] for name in names if counts[name]} for thing, counts in per_object.items()}
    return ModelBaseSummary(
        name=model_base.name,
        parts=sum(counts.total() for counts in per_object.values()),
        by_object={thing: counts.total() for thing, counts in per_object.items()},
        by_class={name: sum(counts[name] for counts in per_object.values()) for name in names},
        by_object_and_class=table,
    )
