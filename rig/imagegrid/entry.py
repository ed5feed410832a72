"""How an image grid is written: the schema of ``grid.yaml`` and of one line of ``frames.jsonl``, and their values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from rig.hal import RigPose

MANIFEST, INFO, TRUTH = "frames.jsonl", "grid.yaml", "truth.jsonl"

# Bounded so that squares stay finite, and loose enough for a rotary that counts its turns.
Millimetres = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Degrees = Annotated[float, Field(ge=-36_000, le=36_000, allow_inf_nan=False)]
ZoomSetting = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=1, le=100_000)]
Internals = Literal["fixed_by_zoom", "change_every_view"]

_BAD_IN_NAME = re.compile(r'[\x00-\x1f\x7f\\:*?"<>|]')


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Units(_Strict):
    """The units, said for whoever reads the file; there is no choice."""

    length: Literal["mm"] = "mm"
    angle: Literal["deg"] = "deg"


class GridInfo(_Strict):
    """``grid.yaml``: what holds for the whole grid. A grid without the file has these defaults."""

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")] = 1
    provenance: Annotated[str, Field(max_length=10_000, description="Where the pictures and poses come from.")] = ""
    image_size: Annotated[tuple[Pixels, Pixels] | None, Field(description="Width and height of every picture.")] = None
    units: Units = Units()
    layout: Annotated[
        Literal["lattice", "irregular"], Field(description="`lattice`: every combination of the axes' values exists.")
    ] = "irregular"
    internals: Annotated[
        Internals | None, Field(description="If the camera's internals are the same at the same zoom; absent: unknown.")
    ] = None


class PoseEntry(_Strict):
    """A rig pose as it is written."""

    x_mm: Millimetres
    y_mm: Millimetres
    z_mm: Millimetres
    theta_deg: Degrees
    zoom: ZoomSetting

    def to_pose(self) -> RigPose:
        """The value that the rest of the system knows."""
        return RigPose(self.x_mm, self.y_mm, self.z_mm, self.theta_deg, self.zoom)


class FrameEntry(PoseEntry):
    """One line of ``frames.jsonl``."""

    file: Annotated[str, Field(min_length=1, max_length=500)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    width: Pixels | None = None
    height: Pixels | None = None
    size_bytes: Annotated[int, Field(ge=0)] | None = None
    commanded: PoseEntry | None = None
    measured: PoseEntry | None = None
    exposure_s: Seconds | None = None
    exposed_at_s: Seconds | None = None
    taken_at: Annotated[str | None, Field(max_length=64)] = None

    @field_validator("file")
    @classmethod
    def _inside_the_folder(cls, file: str) -> str:
        if file.startswith("/") or any(name in ("", ".", "..") for name in file.split("/")):
            raise ValueError("should be a path inside the grid's folder, with / between names and no . or ..")
        if _BAD_IN_NAME.search(file):
            raise ValueError('should have no control characters and none of \\ : * ? " < > |')
        return file


@dataclass(frozen=True, slots=True)
class GridFrame:
    """One picture of a grid, still in its file.

    Attributes:
        file: path inside the grid's folder, with ``/``.
        sha256: digest of the file's bytes, 64 lower-case hexadecimal digits.
        pose: where the rig stood, as well as it is known; by this pose the picture is offered.
        width, height: in pixels, where the manifest tells them.
        size_bytes: of the file, where the manifest tells it.
        commanded: what the gantry was told to go to, if that is recorded.
        measured: what it read back at the time, if that is recorded.
        exposure_s: exposure time.
        exposed_at_s: monotonic time at which the exposure began.
        taken_at: date and time, for people.
        line: of the manifest, counted from 1.
    """

    file: str
    sha256: str
    pose: RigPose
    width: int | None = None
    height: int | None = None
    size_bytes: int | None = None
    commanded: RigPose | None = None
    measured: RigPose | None = None
    exposure_s: float | None = None
    exposed_at_s: float | None = None
    taken_at: str | None = None
    line: int = 0

    @staticmethod
    def of(entry: FrameEntry, line: int) -> GridFrame:
        """From a checked line of the manifest."""
        return GridFrame(
            file=entry.file,
            sha256=entry.sha256,
            pose=entry.to_pose(),
            width=entry.width,
            height=entry.height,
            size_bytes=entry.size_bytes,
            commanded=None if entry.commanded is None else entry.commanded.to_pose(),
            measured=None if entry.measured is None else entry.measured.to_pose(),
            exposure_s=entry.exposure_s,
            exposed_at_s=entry.exposed_at_s,
            taken_at=entry.taken_at,
            line=line,
        )


def pose_key(pose: RigPose) -> tuple[int, int, int, int, int]:
    """Equal for poses that are the same place: to a millionth of a millimetre, degree or zoom, full turns left out."""
    x, y, z, zoom = (round(value * 1e6) for value in (pose.x_mm, pose.y_mm, pose.z_mm, pose.zoom))
    return x, y, z, round(pose.theta_deg * 1e6) % 360_000_000, zoom
