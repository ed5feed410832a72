"""How a model base is written in YAML: the schema that a file must fit before its meaning is checked."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Name = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")]
# Bounded so that squares stay finite; what a part may measure is checked with its unit in mind.
Length = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Point = tuple[Length, Length, Length]
Real = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
UnitInterval = Annotated[float, Field(ge=0, le=1)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=False)


class PoseEntry(_Strict):
    """Where a part's local frame stands in the object: p_object = rotation p_local + translation_mm."""

    rotation: Annotated[
        tuple[tuple[Real, Real, Real], tuple[Real, Real, Real], tuple[Real, Real, Real]],
        Field(description="Rows of a rotation matrix."),
    ]
    translation_mm: Point


_CORNERS = "Clockwise as seen from outside, starting top-left, mm (X right, Y down, Z forward)"
_ONE_FORM = "give either corners_mm, or vertices_mm together with pose"


class PartEntry(_Strict):
    """One part: a planar polygon, in the object frame, or in a frame of its own with its pose."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {"required": ["corners_mm"], "not": {"anyOf": [{"required": ["vertices_mm"]}, {"required": ["pose"]}]}},
                {"required": ["vertices_mm", "pose"], "not": {"required": ["corners_mm"]}},
            ]
        }
    )

    id: Name
    part_class: Annotated[Name, Field(alias="class", description="Built in, or from the file's `classes`.")]
    face: Annotated[Name | None, Field(description="The wall it lies on.")] = None
    look: Annotated[Name | None, Field(description="A free word for detectors that can tell more.")] = None
    recess_mm: Annotated[Length, Field(ge=0, description="How far its surface lies behind the face.")] = 0.0
    corners_mm: Annotated[
        tuple[Point, ...] | None, Field(min_length=4, description=f"{_CORNERS}, in the object frame.")
    ] = None
    vertices_mm: Annotated[
        tuple[Point, ...] | None, Field(min_length=4, description=f"{_CORNERS}, in the part's own frame.")
    ] = None
    pose: PoseEntry | None = None

    @model_validator(mode="after")
    def _one_form(self) -> PartEntry:
        if (self.corners_mm is None) == (self.vertices_mm is None) or (self.vertices_mm is None) != (self.pose is None):
            raise ValueError(_ONE_FORM)
        return self


class FaceEntry(_Strict):
    """A flat, rectangular wall, for rendering and drawing."""

    id: Name
    corners_mm: Annotated[tuple[Point, Point, Point, Point], Field(description=f"{_CORNERS}, in the object frame.")]


class ObjectEntry(_Strict):
    """One object and its parts."""

    id: Name
    parts: Annotated[tuple[PartEntry, ...], Field(min_length=1)]
    faces: Annotated[tuple[FaceEntry, ...], Field(description="If given, each part's `face` is one of them.")] = ()


class ClassEntry(_Strict):
    """A part-class that is not built in, or another reading of one that is."""

    name: Name
    corners: Annotated[
        tuple[tuple[UnitInterval, UnitInterval], ...] | None,
        Field(
            min_length=4,
            description="Outline in the unit square, x right, y down, clockwise from the top-left, in the order in "
            "which parts list their corners. Left out: as built in, or any four corners.",
        ),
    ] = None
    bright: Annotated[
        bool | None, Field(description="Brighter than the wall (true), darker (false), or either (null).")
    ] = None


class ModelBaseFile(_Strict):
    """Objects that can be told apart by their parts. All lengths are millimetres."""

    version: Literal[1] = 1
    name: Name | None = None
    classes: tuple[ClassEntry, ...] = ()
    objects: Annotated[tuple[ObjectEntry, ...], Field(min_length=1)]


def json_schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of a model base file, as published in ``rig/data/modelbase.schema.json``."""
    schema = ModelBaseFile.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
