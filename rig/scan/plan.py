"""Reads scan plans: which poses, in which order, approached how, and stored as what (format: docs/formats.md)."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from rig.hal import AXES, RigPose
from rig.imagegrid.entry import Degrees, Millimetres, ZoomSetting, pose_key
from rig.scan.order import OneSided, at_every_zoom, serpentine
from rig.schema import Document, load_yaml, raise_problems, validate

MAX_POSES = 100_000
PLAN_MAX_BYTES = 16 * 1024 * 1024
_WHOLE = 1e-6

AxisName = Literal["x_mm", "y_mm", "z_mm", "theta_deg", "zoom"]
Real = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Range(_Strict):
    """Evenly spaced values from one end to the other, both included."""

    # `from` is a word of Python's.
    start: Annotated[Real, Field(alias="from")]
    to: Real
    step: Annotated[Positive | None, Field(description="Between neighbours; fits a whole number of times.")] = None
    count: Annotated[int | None, Field(ge=2, le=MAX_POSES, description="How many values; instead of `step`.")] = None

    @model_validator(mode="after")
    def _evenly(self) -> Self:
        if (self.step is None) == (self.count is None):
            raise ValueError("give either step or count")
        if self.to <= self.start:
            raise ValueError(f"`to` ({self.to:g}) should be above `from` ({self.start:g}); the order is the scan's")
        if self.step is not None:
            steps = (self.to - self.start) / self.step
            if steps > MAX_POSES:
                raise ValueError(f"has {steps + 1:.0f} values, more than {MAX_POSES}")
            if abs(steps - round(steps)) > _WHOLE:
                raise ValueError(
                    f"steps of {self.step:g} from {self.start:g} do not end at {self.to:g}, but at "
                    f"{self.start + int(steps) * self.step:g} or {self.start + (int(steps) + 1) * self.step:g}"
                )
        return self

    @property
    def values(self) -> tuple[float, ...]:
        """The values, rising."""
        steps = self.count - 1 if self.count is not None else round((self.to - self.start) / (self.step or 1.0))
        # Rounded: 0.1 + 2 * 0.1 is not what anybody means by 0.3.
        return tuple(round(self.start + k * (self.to - self.start) / steps, 9) for k in range(steps + 1))


def _form(value: Any) -> str:
    return "range" if isinstance(value, dict | Range) else "list" if isinstance(value, list | tuple) else "number"


Values = Annotated[
    Annotated[Real, Tag("number")]
    | Annotated[Annotated[tuple[Real, ...], Field(min_length=1, max_length=MAX_POSES)], Tag("list")]
    | Annotated[Range, Tag("range")],
    Discriminator(_form),
]


class LatticeEntry(_Strict):
    """Every combination of the axes' values: each a number, a list, or a range."""

    x_mm: Values
    y_mm: Values
    z_mm: Values
    theta_deg: Values
    zoom: Values = 0.0
    order: Annotated[
        tuple[AxisName, ...], Field(description="Axes by how often they change, the one that changes least first.")
    ] = ("y_mm", "z_mm", "x_mm", "theta_deg", "zoom")

    @model_validator(mode="after")
    def _every_axis_once(self) -> Self:
        if sorted(self.order) != sorted(AXES):
            raise ValueError(f"`order` should name each of {', '.join(AXES)} once")
        return self


class PlaceEntry(_Strict):
    """One pose of a list."""

    x_mm: Millimetres
    y_mm: Millimetres
    z_mm: Millimetres
    theta_deg: Degrees
    zoom: ZoomSetting | None = None


class SideEntry(_Strict):
    """How a one-sided axis is approached."""

    # `from` is a word of Python's.
    side: Annotated[Literal["below", "above"], Field(alias="from")]
    overshoot: Annotated[Positive, Field(description="How far past a value, in the axis's unit; above the backlash.")]


class SidesEntry(_Strict):
    """Axes that are approached from one side."""

    x_mm: SideEntry | None = None
    y_mm: SideEntry | None = None
    z_mm: SideEntry | None = None
    theta_deg: SideEntry | None = None
    zoom: SideEntry | None = None


class PictureEntry(_Strict):
    """What pictures are stored as."""

    format: Literal["png", "jpg"] = "png"
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] = 95


class PlanFile(_Strict):
    """The schema of a scan plan."""

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")]
    note: Annotated[str, Field(max_length=1000, description="Goes into the grid's provenance.")] = ""
    lattice: LatticeEntry | None = None
    poses: Annotated[tuple[PlaceEntry, ...] | None, Field(min_length=1, max_length=MAX_POSES)] = None
    zooms: Annotated[
        tuple[ZoomSetting, ...] | None, Field(min_length=1, description="Each pose of the list at each of these.")
    ] = None
    one_sided: SidesEntry = SidesEntry()
    picture: PictureEntry = PictureEntry()
    retries: Annotated[int, Field(ge=0, le=100, description="Of a picture that is black, frozen or the like.")] = 2
    pause_s: Annotated[float, Field(ge=0, le=3600, description="Before each retry.")] = 1.0

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.lattice is None) == (self.poses is None):
            raise ValueError("give either lattice or poses")
        if self.zooms is not None and self.poses is None:
            raise ValueError("zooms go with poses; a lattice has its own zoom")
        if self.zooms is not None and any(place.zoom is not None for place in self.poses or ()):
            raise ValueError("give either zooms, or a zoom with each pose")
        return self


@dataclass(frozen=True)
class ScanPlan:
    """A plan, checked.

    Attributes:
        name: the file, for messages.
        poses: where pictures are taken, in order; no two are the same place.
        sides: the one-sided axes.
        suffix: of the picture files: ``.png`` or ``.jpg``.
        quality: of JPEG; ``None``: PNG.
        retries: how often a bad picture is taken again.
        pause_s: waited before each retry.
        note: for the grid's provenance.
    """

    name: str
    poses: tuple[RigPose, ...] = field(repr=False)
    sides: tuple[OneSided, ...] = ()
    suffix: str = ".png"
    quality: int | None = None
    retries: int = 2
    pause_s: float = 1.0
    note: str = ""

    @property
    def sha256(self) -> str:
        """Digest of what decides the pictures: poses, approaches and format. Comments and retries do not."""
        told = [[list(asdict(pose).values()) for pose in self.poses], [asdict(side) for side in self.sides]]
        return hashlib.sha256(json.dumps([told, self.suffix, self.quality]).encode()).hexdigest()


def load_plan(path: Path) -> ScanPlan:
    """Read a scan plan.

    Raises:
        InputError: with file:line:column of everything that is wrong, and remedies.
    """
    document = load_yaml(path, max_bytes=PLAN_MAX_BYTES)
    file = validate(PlanFile, document)
    told = ((axis, getattr(file.one_sided, axis)) for axis in AXES)
    sides = tuple(OneSided(axis, side.side, side.overshoot) for axis, side in told if side is not None)
    poses = _of_list(file, sides) if file.lattice is None else _of_lattice(file.lattice, sides, document)
    _refuse_same_places(poses, file, document)
    jpeg = file.picture.format == "jpg"
    return ScanPlan(
        name=str(path),
        poses=tuple(poses),
        sides=sides,
        suffix=f".{file.picture.format}",
        quality=file.picture.jpeg_quality if jpeg else None,
        retries=file.retries,
        pause_s=file.pause_s,
        note=file.note,
    )


def _of_lattice(lattice: LatticeEntry, sides: tuple[OneSided, ...], document: Document) -> list[RigPose]:
    axes = [(axis, _values(getattr(lattice, axis))) for axis in lattice.order]
    number = 1
    for _, values in axes:
        number *= len(values)
    if number > MAX_POSES:
        what = f"has {number} poses, more than {MAX_POSES}"
        raise_problems([document.problem(("lattice",), what, "Divide it into several plans")])
    return serpentine(axes, sides)


def _values(told: float | tuple[float, ...] | Range) -> tuple[float, ...]:
    if isinstance(told, Range):
        return told.values
    return told if isinstance(told, tuple) else (told,)


def _of_list(file: PlanFile, sides: tuple[OneSided, ...]) -> list[RigPose]:
    places = file.poses or ()
    poses = [RigPose(p.x_mm, p.y_mm, p.z_mm, p.theta_deg, p.zoom or 0.0) for p in places]
    return poses if file.zooms is None else at_every_zoom(poses, file.zooms, sides)


def _refuse_same_places(poses: list[RigPose], file: PlanFile, document: Document) -> None:
    """A grid holds one picture a place, so a plan names each place once; a full turn leads back to the same one."""
    seen: dict[tuple[int, ...], RigPose] = {}
    for pose in poses:
        other = seen.setdefault(pose_key(pose), pose)
        if other is not pose:
            at = "lattice" if file.lattice is not None else "poses"
            what = f"{_told(pose)} is the same place as {_told(other)}" if other != pose else f"{_told(pose)} twice"
            raise_problems([document.problem((at,), what, "Name each place once; a full turn leads back to it")])


def _told(pose: RigPose) -> str:
    return ", ".join(f"{axis} {getattr(pose, axis):g}" for axis in AXES)
