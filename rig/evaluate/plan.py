"""Reads evaluation plans: which model bases, policies and conditions, and how many trials (format: docs/formats.md)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import resources
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rig.errors import InputError
from rig.schema import Document, Problem, did_you_mean, load_yaml, raise_problems, validate

PLAN_MAX_BYTES = 1024 * 1024
MOST_TRIALS = 10_000_000

Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=120)]


class Strict(BaseModel):
    """Frozen, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class NoiseEntry(Strict):
    """What a simulated detector does wrong, and how far the rig's poses are off (`CornerNoise`)."""

    missed: Share = 0.0
    false_parts: NotNegative = 0.0
    class_errors: Share = 0.0
    corner_sd_px: NotNegative = 0.0
    motion_theta_sd_deg: NotNegative = 0.0
    motion_sd_mm: NotNegative = 0.0


class InternalsEntry(Strict):
    """How the camera's inside changes from view to view; all 0: only the zoom changes it."""

    focal_sd: NotNegative = 0.05
    aspect_sd: NotNegative = 0.02
    centre_sd_px: NotNegative = 40.0


class ToldEntry(Strict):
    """What the recogniser is told of the bench, as a bench file would; left out, corner views follow the noise."""

    found: Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)] | None = None
    clutter: Positive | None = None
    corner_sd_px: Positive | None = None
    motion_theta_sd_deg: NotNegative | None = None
    motion_sd_mm: NotNegative | None = None


class RecogniserEntry(Strict):
    """How it recognises (`RecogniserSettings`)."""

    mode: Literal["graded", "paper"] = "graded"
    threshold: Annotated[float, Field(gt=0, le=1)] = 0.99
    max_views: Annotated[int, Field(ge=1, le=1000)] = 12
    pose_sd_mm: Positive | None = None
    pose_sd_deg: Positive | None = None


class FirstViewEntry(Strict):
    """What the first view of an experiment must show; parts count that show whole."""

    parts: Annotated[int | None, Field(ge=1, description="Exactly so many parts.")] = None
    classes: Annotated[str | None, Field(min_length=1, description="All of classes that begin so.")] = None
    two_faces: Annotated[bool, Field(description="Parts on two perpendicular faces.")] = False


class StartEntry(Strict):
    """A start found beforehand: object, seed of the scene, and which of the rig's poses."""

    object: Name
    seed: Annotated[int, Field(ge=0)]
    pose: Annotated[int, Field(ge=0)]


class ExperimentEntry(Strict):
    """One of the paper's experiments, staged (`rig.evaluate.experiments`).

    Attributes:
        number: as in the paper; title: what it is about.
        first_view: what it must show.
        hypotheses: that the first view must leave at least; paper_hypotheses: those that the paper tells, if it does.
        paper_views: that the paper took.
        trees_before: views, from 1, with a tree in front.
        half_blind: the detector misses a part from the second view on.
        third_zooms: zooms at which the third view is taken, a run for each.
        camera: the camera's inside, where it is not the usual one: aspect, u0_px, v0_px.
        starts: found beforehand; further ones are searched for, which takes long.
    """

    number: Annotated[int, Field(ge=1)]
    title: Name
    first_view: FirstViewEntry
    hypotheses: Annotated[int, Field(ge=1)]
    paper_hypotheses: int | None = None
    paper_views: Annotated[int, Field(ge=1)]
    trees_before: tuple[Annotated[int, Field(ge=1)], ...] = ()
    half_blind: bool = False
    third_zooms: tuple[Share, ...] = ()
    camera: dict[Literal["aspect", "u0_px", "v0_px"], Positive] = {}
    starts: tuple[StartEntry, ...] = ()


class RowEntry(Strict):
    """Conditions, tried with each of some model bases and policies."""

    name: Annotated[Name, Field(description="Names the conditions; the results call it `noise`.")]
    models: Annotated[tuple[Name, ...], Field(min_length=1)]
    policies: Annotated[tuple[Name, ...], Field(min_length=1)] | Literal["all"] = ("information",)
    without: Annotated[tuple[Name, ...], Field(description="Policies to leave out of all.")] = ()
    views: Annotated[Literal["corners", "rendered"], Field(description="Simulated corners, or pictures.")] = "corners"
    bench: Annotated[Literal["close_up", "one_axis"], Field(description="All axes, or a turntable.")] = "close_up"
    object: Annotated[Literal["in_base", "stranger"], Field(description="stranger: 20 % of its parts re-drawn.")] = (
        "in_base"
    )
    clutter: Annotated[bool, Field(description="Trees, pipes, jutting walls and reflections.")] = False
    noise: NoiseEntry | None = None
    internals: InternalsEntry = InternalsEntry()
    told: ToldEntry = ToldEntry()
    recogniser: RecogniserEntry = RecogniserEntry()
    experiment: ExperimentEntry | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.views == "rendered" and self.noise is not None:
            raise ValueError("rendered views have the noise of their pictures: give `noise` to corner views only")
        if self.views == "corners" and (self.clutter or self.experiment is not None):
            raise ValueError("clutter and experiments need pictures: add `views: rendered`")
        if self.experiment is not None and (self.bench, self.object) != ("close_up", "in_base"):
            raise ValueError("an experiment has a bench and an object of its own")
        if self.without and self.policies != "all":
            raise ValueError("`without` leaves policies out of `policies: all`; here they are named")
        return self


class PlanFile(Strict):
    """The schema of an evaluation plan."""

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")]
    title: Name
    trials: Annotated[int, Field(ge=1, le=MOST_TRIALS, description="Over all rows, evenly.")]
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    rows: Annotated[tuple[RowEntry, ...], Field(min_length=1)]


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
