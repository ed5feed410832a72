"""Reads evaluation plans: which model bases, policies and conditions, and how many trials (format: docs/formats.md)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import resources
from importlib.metadata import entry_points
from pathlib import Path

from rig.errors import InputError
from rig.evaluate.plan_file import PlanFile, RowEntry
from rig.schema import Document, Problem, did_you_mean, load_yaml, raise_problems, validate

PLAN_MAX_BYTES = 1024 * 1024


@dataclass(frozen=True)
class Row:
    """One row of results: a model base, a policy, and conditions.

    ``source`` is the model base's file, or its name if it ships; ``base`` its name in any case.
    """

    source: str
    policy: str
    conditions: RowEntry = field(repr=False)

    @property
    def base(self) -> str:
        """Name of the model base."""
        return Path(self.source).stem

    @property
    def key(self) -> str:
        """Names the row within its plan."""
        return f"{self.base} | {self.policy} | {self.conditions.name}"


@dataclass(frozen=True)
class Task:
    """One trial: everything in it is drawn from its seed, which is the same for all rows."""

    row: Row
    number: int
    seed: int

    @property
    def key(self) -> tuple[str, int]:
        """Names the trial within its plan."""
        return self.row.key, self.number


@dataclass(frozen=True)
class Plan:
    """A plan, read and checked.

    Attributes:
        name: as the user gave it.
        title: for people.
        trials: over all rows.
        seed: of the first trial of each row.
        rows: all combinations, in the file's order.
    """

    name: str
    title: str
    trials: int
    seed: int
    rows: tuple[Row, ...]

    def of(self, *, trials: int | None = None, seed: int | None = None) -> Plan:
        """The plan with so many trials, or another seed."""
        return replace(
            self,
            trials=self.trials if trials is None else trials,
            seed=self.seed if seed is None else seed,
        )

    @property
    def counts(self) -> tuple[int, ...]:
        """Trials of each row: as even as can be, the first rows having one more where it does not come out even."""
        each, more = divmod(self.trials, len(self.rows))
        return tuple(each + (k < more) for k in range(len(self.rows)))

    @property
    def tasks(self) -> list[Task]:
        """All trials: the first of each row, then the second, so that an early end leaves the rows even."""
        counts = self.counts
        return [
            Task(row, number, self.seed + number)
            for number in range(max(counts))
            for row, count in zip(self.rows, counts, strict=True)
            if number < count
        ]

    @property
    def sha256(self) -> str:
        """Digest of all that the results of a trial depend on: rows, seed and model bases, but not how many trials."""
        rows = [
            [row.base, row.policy, row.conditions.model_dump(mode="json", exclude_defaults=True)] for row in self.rows
        ]
        bases = sorted({(row.base, _digest(row.source)) for row in self.rows})
        text = json.dumps([rows, self.seed, bases], sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()


def load_plan(name_or_path: str) -> Plan:
    """Read a plan: a file, or, by a name without suffix, one of those that ship (`shipped_plans`).

    Raises:
        InputError: with file:line:column of everything that is wrong, and remedies.
    """
    path = Path(name_or_path)
    if path.suffix or path.name != name_or_path:
        return _plan(load_yaml(path, max_bytes=PLAN_MAX_BYTES), name_or_path, path.parent)
    if name_or_path not in shipped_plans():
        raise InputError(
            f"no plan of the name {name_or_path!r} ships with the package",
            where="PLAN",
            remedy=did_you_mean(name_or_path, shipped_plans()) or "Give the path of a YAML file, with its suffix",
        )
    with resources.as_file(_folder() / f"{name_or_path}.yaml") as file:
        return _plan(load_yaml(file, max_bytes=PLAN_MAX_BYTES), name_or_path, Path())


def shipped_plans() -> tuple[str, ...]:
    """Names of the plans that ship with the package."""
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in _folder().iterdir()))


def _folder() -> resources.abc.Traversable:
    return resources.files("rig") / "data" / "plans"


def _plan(document: Document, name: str, folder: Path) -> Plan:
    file = validate(PlanFile, document)
    known = sorted(point.name for point in entry_points(group="rig.policies"))
    raise_problems([*_unknown_policies(file, document, known), *_unknown_models(file, document, folder)])
    rows: dict[str, Row] = {}
    for number, entry in enumerate(file.rows):
        policies = entry.policies if entry.policies != "all" else [p for p in known if p not in entry.without]
        for base in entry.models:
            for policy in policies:
                row = Row(_source(base, folder), policy, entry)
                if row.key in rows:
                    message = f"there is a row for {row.key!r} already"
                    problem = document.problem(("rows", number, "name"), message, "Give each row another name")
                    raise_problems([problem])
                rows[row.key] = row
    return Plan(name, file.title, file.trials, file.seed, tuple(rows.values()))


def _unknown_policies(file: PlanFile, document: Document, known: list[str]) -> Iterator[Problem]:
    for number, entry in enumerate(file.rows):
        for key in ("policies", "without"):
            names = getattr(entry, key)
            for k, name in enumerate(() if names == "all" else names):
                # A policy to leave out may be one that is not installed here.
                if name not in known and key == "policies":
                    yield document.problem(
                        ("rows", number, key, k), f"there is no policy {name!r}", _one_of(name, known)
                    )


def _unknown_models(file: PlanFile, document: Document, folder: Path) -> Iterator[Problem]:
    from recognition.modelbase_io import shipped_model_bases

    for number, entry in enumerate(file.rows):
        for k, name in enumerate(entry.models):
            source = _source(name, folder)
            if source not in shipped_model_bases() and not Path(source).is_file():
                remedy = _one_of(name, list(shipped_model_bases()))
                yield document.problem(("rows", number, "models", k), f"there is no model base {name!r}", remedy)


def _one_of(name: str, known: list[str]) -> str:
    return did_you_mean(name, known) or f"Known here: {', '.join(known)}."


def _source(name: str, folder: Path) -> str:
    """A shipped model base's name, or the path of a file, which a plan gives from its own folder."""
    path = Path(name)
    return str(folder / path) if path.suffix or path.name != name else name


def _digest(source: str) -> str:
    path = Path(source)
    file = path if path.suffix else resources.files("rig") / "data" / f"{source}.yaml"
    return hashlib.sha256(file.read_bytes()).hexdigest()
