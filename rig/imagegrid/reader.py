"""Reads an image grid's manifest, every line checked, and loads its pictures one at a time."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import ValidationError

from rig.errors import ImageGridError
from rig.hal import AXES, Image, RigPose
from rig.imagegrid.entry import INFO, MANIFEST, FrameEntry, GridFrame, GridInfo, pose_key
from rig.imagegrid.images import load_image
from rig.schema import BENCH_MAX_BYTES, Problem, did_you_mean, load_model, raise_problems
from rig.schema_words import describe

MAX_LINE_BYTES = 64 * 1024


@dataclass(frozen=True)
class ImageGrid:
    """A checked manifest: what pictures there are and where each was taken.

    Attributes:
        folder: of the grid.
        frames: in the manifest's order; at least one.
        info: what holds for the whole grid.
        left_out: with ``allow_partial``, what is missing, one message each.
    """

    folder: Path
    frames: tuple[GridFrame, ...] = field(repr=False)
    info: GridInfo = field(default_factory=GridInfo)
    left_out: tuple[str, ...] = ()

    def load(self, frame: GridFrame) -> Image:
        """The picture, its digest checked before it is decoded: ``(h, w)`` grey or ``(h, w, 3)`` BGR, 8 bits.

        Raises:
            ImageGridError: the file is missing, damaged, or of another size than the manifest says.
            ImageError: it is not a picture that can be used.
        """
        width, height = self.info.image_size or (None, None)
        size = (frame.width or width, frame.height or height)
        return load_image(self.folder / frame.file, sha256=frame.sha256, size=size)

    def frame(self, file: str) -> GridFrame:
        """The frame of a picture file, by its path inside the folder, or by its name or stem where only one has it.

        Raises:
            ImageGridError: there is none, or several.
        """
        found = [f for f in self.frames if f.file == file]
        found = found or [f for f in self.frames if file in (PurePosixPath(f.file).name, PurePosixPath(f.file).stem)]
        if len(found) == 1:
            return found[0]
        known = [f.file for f in found] or [f.file for f in self.frames]
        raise ImageGridError(
            f"{'several pictures are' if found else 'no picture is'} called {file!r}",
            where=str(self.folder / MANIFEST),
            remedy=did_you_mean(file, known) or "Name a file that the manifest lists.",
        )

    def axis_values(self) -> dict[str, tuple[float, ...]]:
        """The different values of each axis (``x_mm``, ``y_mm``, ``z_mm``, ``theta_deg``, ``zoom``), rising."""
        return {axis: tuple(sorted({getattr(f.pose, axis) for f in self.frames})) for axis in AXES}

    @property
    def is_full_lattice(self) -> bool:
        """True if every combination of the axes' values is a cell."""
        return math.prod(len(values) for values in self.axis_values().values()) == len(self.frames)


def read_grid(folder: Path, *, allow_partial: bool = False) -> ImageGrid:
    """Read and check a grid's manifest; pictures are opened later, when they are asked for.

    Args:
        folder: holds ``frames.jsonl``, perhaps ``grid.yaml``, and the pictures.
        allow_partial: go on where pictures or cells are missing, or the manifest's last line is torn off.

    Raises:
        ImageGridError: names file and line of everything that is wrong, at most twenty things.
    """
    manifest = folder / MANIFEST
    if not manifest.is_file():
        what = f"there is no {MANIFEST} in this folder" if folder.is_dir() else "there is no such folder"
        if folder.is_file():
            what = "this is a file, and an image grid is a folder"
        raise ImageGridError(what, where=str(folder), remedy=f"Name an image grid's folder, which holds {MANIFEST}")
    info, frames, problems, gaps = read_manifest(folder)
    present = [frame for frame in frames if (folder / frame.file).is_file()]
    gaps += [_missing_file(frame, manifest) for frame in frames if not (folder / frame.file).is_file()]
    if info.layout == "lattice" and not problems:
        gaps += _missing_cells(frames, manifest)
    raise_problems(problems if allow_partial else problems + gaps, ImageGridError)
    if not present:
        what = "none of its pictures is there" if frames else "it lists no picture"
        raise ImageGridError(what, where=str(manifest), remedy="Copy the grid again from its source")
    return ImageGrid(folder, tuple(present), info, tuple(str(gap) for gap in gaps))


def read_manifest(folder: Path) -> tuple[GridInfo, list[GridFrame], list[Problem], list[Problem]]:
    """What holds for the grid, its frames, what is wrong, and what is missing because the last line is torn off.

    Raises:
        ImageGridError: ``grid.yaml`` is wrong, or the manifest cannot be read.
    """
    manifest, info = folder / MANIFEST, GridInfo()
    if (folder / INFO).exists():
        info = load_model(folder / INFO, GridInfo, BENCH_MAX_BYTES, error=ImageGridError)
    frames, problems, torn = _read_lines(manifest)
    problems += _duplicates(frames, manifest) + _other_sizes(frames, info, manifest)
    return info, frames, problems + _leading_out(frames, folder, manifest), torn


def _read_lines(manifest: Path) -> tuple[list[GridFrame], list[Problem], list[Problem]]:
    """The frames, what is wrong, and what is missing because the last line is torn off."""
    frames: list[GridFrame] = []
    problems: list[Problem] = []
    torn: list[Problem] = []
    for number, raw in _lines(manifest):
        where = f"{manifest}:{number}"
        if not raw.strip():
            continue
        outcome = read_line(raw, where)
        if isinstance(outcome, FrameEntry):
            frames.append(GridFrame.of(outcome, number))
        elif not raw.endswith(b"\n") and len(raw) <= MAX_LINE_BYTES and not _is_json(raw):
            remedy = "Delete the torn line, or go on without it with --allow-partial"
            torn.append(Problem(where, "the last line is torn off", remedy))
        else:
            problems += outcome
    return frames, problems, torn


def _lines(manifest: Path) -> Iterator[tuple[int, bytes]]:
    """Numbered lines; a line too long to be one of a manifest comes cut, and is then refused as such."""
    try:
        with manifest.open("rb") as stream:
            number = 0
            while raw := stream.readline(MAX_LINE_BYTES + 1):
                number += 1
                yield number, raw.removeprefix(b"\xef\xbb\xbf") if number == 1 else raw
                if len(raw) > MAX_LINE_BYTES:
                    return
    except OSError as failure:
        raise ImageGridError(
            f"cannot be read: {failure.strerror or failure}", where=str(manifest), remedy="Check its permissions"
        ) from failure


def read_line(raw: bytes, where: str) -> FrameEntry | list[Problem]:
    """One line of a manifest, or what is wrong with it; ``where`` is its file and number."""
    if len(raw) > MAX_LINE_BYTES:
        return [Problem(where, f"the line is longer than {MAX_LINE_BYTES // 1024} KiB", "Is it a manifest?")]
    try:
        data = json.loads(raw.decode("utf-8"), object_pairs_hook=_object, parse_constant=_not_finite)
    except UnicodeDecodeError as failure:
        return [Problem(where, f"the byte 0x{raw[failure.start]:02x} is not UTF-8", "Save the file as UTF-8")]
    except json.JSONDecodeError as failure:
        place = f"{where}:{failure.colno}"
        return [Problem(place, f"this is not JSON: {failure.msg}", "Each line is one JSON object of its own")]
    except (ValueError, RecursionError) as failure:
        text = "nested too deeply" if isinstance(failure, RecursionError) else str(failure)
        return [Problem(where, text, "Correct the line")]
    if not isinstance(data, dict):
        return [Problem(where, "this is not a JSON object", "Each line is one JSON object of its own")]
    try:
        return FrameEntry.model_validate(data, strict=True)
    except ValidationError as failure:
        words = [describe(FrameEntry, detail, data) for detail in failure.errors(include_url=False)]
    return [Problem(where, f"{'.'.join(map(str, w.location))}: {w.message}", w.remedy) for w in words]


def _is_json(raw: bytes) -> bool:
    try:
        json.loads(raw)
    except (ValueError, RecursionError):
        return False
    return True


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        twice = next(name for name in data if sum(name == key for key, _ in pairs) > 1)
        raise ValueError(f"the key {twice!r} stands there twice")
    return data


def _not_finite(text: str) -> float:
    raise ValueError(f"{text} is not a finite number")


def _duplicates(frames: Iterable[GridFrame], manifest: Path) -> list[Problem]:
    problems: list[Problem] = []
    files: dict[str, int] = {}
    places: dict[tuple[int, ...], GridFrame] = {}
    for frame in frames:
        where = f"{manifest}:{frame.line}"
        first = files.setdefault(frame.file, frame.line)
        other = places.setdefault(pose_key(frame.pose), frame)
        if first != frame.line:
            problems.append(
                Problem(where, f"{frame.file} is listed a second time, first in line {first}", "Delete one")
            )
        elif other is not frame:
            what = f"{frame.file} was taken from the same pose as {other.file} (line {other.line})"
            problems.append(Problem(where, what, "Keep one of the two"))
    return problems


def _other_sizes(frames: Iterable[GridFrame], info: GridInfo, manifest: Path) -> list[Problem]:
    if info.image_size is None:
        return []
    told = "{} x {}".format(*info.image_size)
    return [
        Problem(f"{manifest}:{f.line}", f"{f.file} is {f.width} x {f.height} pixels, {INFO} says {told}", "Correct one")
        for f in frames
        if any(own not in (None, whole) for own, whole in zip((f.width, f.height), info.image_size, strict=True))
    ]


def _leading_out(frames: Iterable[GridFrame], folder: Path, manifest: Path) -> list[Problem]:
    root, remedy = folder.resolve(), "Put the picture itself into the grid's folder"
    return [
        Problem(f"{manifest}:{f.line}", f"{f.file} is a link that leads out of the grid's folder", remedy)
        for f in frames
        if not (folder / f.file).resolve().is_relative_to(root)
    ]


def _missing_file(frame: GridFrame, manifest: Path) -> Problem:
    remedy = "Copy it again, or go on without it with --allow-partial"
    return Problem(f"{manifest}:{frame.line}", f"{frame.file} is missing", remedy)


def _missing_cells(frames: list[GridFrame], manifest: Path) -> list[Problem]:
    """Cells of the lattice that no line of the manifest gives, one problem for each."""
    grid = ImageGrid(manifest.parent, tuple(frames))
    if grid.is_full_lattice:
        return []
    values = grid.axis_values()
    cells = math.prod(len(of_axis) for of_axis in values.values())
    if cells > 10 * len(frames) + 10:
        what = (
            f"{INFO} says that this is a lattice, but only {len(frames)} of {cells} combinations of its axes are there"
        )
        return [Problem(str(manifest), what, "Say `layout: irregular`")]
    taken = {pose_key(frame.pose) for frame in frames}
    poses = (RigPose(*combination) for combination in product(*values.values()))
    remedy = "Capture it, say `layout: irregular`, or go on without it with --allow-partial"
    return [
        Problem(str(manifest), f"no picture of the cell {_told(p)}", remedy) for p in poses if pose_key(p) not in taken
    ]


def _told(pose: RigPose) -> str:
    return ", ".join(f"{axis} = {getattr(pose, axis):g}" for axis in AXES)
