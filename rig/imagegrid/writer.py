"""Writes image grids so that a crash at any moment leaves a grid that can be read: picture first, then its line."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rig.errors import ImageGridError, InputError, RigError
from rig.hal import Frame, Image
from rig.imagegrid.entry import INFO, MANIFEST, TRUTH, FrameEntry, GridFrame, GridInfo, pose_key
from rig.imagegrid.images import read_header
from rig.schema_words import describe


class GridWriter:
    """Adds pictures to a new image grid.

    Each picture is written under a temporary name, flushed to disk, renamed, and only then gets its line in the
    manifest, which is flushed too: what the manifest lists is whole.

    Args:
        folder: made if need be; must not hold a grid yet.
        info: for ``grid.yaml``.

    Raises:
        InputError: there is a grid already.
        RigError: the folder cannot be written.
    """

    def __init__(self, folder: Path, info: GridInfo) -> None:
        self.folder = folder
        self._info = info
        self._files: set[str] = set()
        self._places: dict[tuple[int, ...], str] = {}
        if (folder / MANIFEST).exists():
            raise InputError("holds an image grid already", where=str(folder), remedy="Name another folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as failure:
            why = f"the folder cannot be made ({failure.strerror or failure})"
            raise InputError(why, where=str(folder), remedy="Name another folder") from failure
        try:
            _write_whole(folder / INFO, _info_yaml(info).encode())
            _write_whole(folder / MANIFEST, b"")
        except OSError as failure:
            raise _cannot_write(folder, failure) from failure

    def add(
        self,
        frame: Frame,
        file: str,
        *,
        quality: int | None = None,
        exposure_s: float | None = None,
        taken_at: str | None = None,
        truth: Mapping[str, Any] | None = None,
    ) -> GridFrame:
        """Encode a picture and add it by ``frame.rig_pose``; ``frame.commanded`` is kept where it differs.

        Args:
            frame: the picture, ``(h, w)`` grey or ``(h, w, 3)`` BGR.
            file: path inside the folder, ending in ``.png`` or ``.jpg``.
            quality: of JPEG, 1..100; ``None``: 95.
            exposure_s: exposure time.
            taken_at: date and time, for people.
            truth: for ``truth.jsonl``, which no recogniser reads; ``file`` is added.

        Raises:
            ImageGridError: the file or the pose is in the grid already, or the picture cannot be encoded.
            RigError: the disk is full or refuses; the grid is as it was before.
        """
        extra: dict[str, Any] = {"exposure_s": exposure_s, "exposed_at_s": frame.exposed_at_s, "taken_at": taken_at}
        if frame.commanded != frame.rig_pose:
            extra["commanded"] = asdict(frame.commanded)
        data = _encode(frame.image, self.folder / file, quality)
        return self.add_bytes(data, {"file": file, **asdict(frame.rig_pose), **extra}, truth=truth)

    def add_bytes(self, data: bytes, entry: Mapping[str, Any], *, truth: Mapping[str, Any] | None = None) -> GridFrame:
        """Add a picture that is encoded already, byte for byte; ``entry`` is its line without digest and size.

        Raises:
            ImageGridError: the file or the pose is in the grid already, or the entry breaks the manifest's rules.
            RigError: the disk is full or refuses; the grid is as it was before.
            ImageError: the bytes are neither PNG nor JPEG.
        """
        path = self.folder / str(entry.get("file"))
        header = read_header(data, str(path))
        size = {"width": header.width, "height": header.height}
        line = {name: value for name, value in {**entry, **size}.items() if value is not None}
        line["sha256"] = hashlib.sha256(data).hexdigest()
        checked = self._checked(line, path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _write_whole(path, data)
            if truth is not None:
                # Before the manifest: a kill in between leaves a truth without a picture, which harms nobody.
                _append(self.folder / TRUTH, {"file": checked.file, **truth})
            _append(self.folder / MANIFEST, line)
        except OSError as failure:
            raise _cannot_write(path, failure) from failure
        self._files.add(checked.file)
        self._places[pose_key(checked.to_pose())] = checked.file
        return GridFrame.of(checked, len(self._files))

    def _checked(self, line: Mapping[str, Any], path: Path) -> FrameEntry:
        try:
            entry = FrameEntry.model_validate(line, strict=True)
        except ValidationError as failure:
            wording = describe(FrameEntry, failure.errors(include_url=False)[0], line)
            name = ".".join(map(str, wording.location))
            raise ImageGridError(f"{name}: {wording.message}", where=str(path), remedy=wording.remedy) from failure
        if entry.file in self._files:
            raise ImageGridError("is in the grid already", where=str(path), remedy="Give each picture its own name")
        other = self._places.get(pose_key(entry.to_pose()))
        if other is not None:
            raise ImageGridError(
                f"was taken from the same pose as {other}", where=str(path), remedy="Keep one picture a pose"
            )
        if self._info.image_size not in (None, (entry.width, entry.height)):
            raise ImageGridError(
                f"is {entry.width} x {entry.height} pixels, {INFO} says {self._info.image_size}",
                where=str(path),
                remedy="Write pictures of one size",
            )
        return entry


def _info_yaml(info: GridInfo) -> str:
    values = info.model_dump(mode="json", by_alias=True, exclude_none=True)
    return "".join(f"{key}: {_quoted(value)}\n" for key, value in values.items())


def _quoted(value: Any) -> str:
    """A value as YAML; text always in quotes, lest a word like ``off`` be read as something else."""
    import yaml

    if isinstance(value, str):
        return str(yaml.safe_dump(value, default_style='"', allow_unicode=True, width=1_000_000)).strip()
    return json.dumps(value)


def _encode(image: Image, path: Path, quality: int | None) -> bytes:
    import cv2

    if path.suffix not in (".png", ".jpg", ".jpeg"):
        raise ImageGridError(f"ends in {path.suffix!r}", where=str(path), remedy="Write .png or .jpg")
    options = [] if path.suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 95 if quality is None else quality]
    # Encoded in memory and written by us: on a full disk cv2.imwrite returns False and raises nothing.
    good, encoded = cv2.imencode(path.suffix, image, options)
    if not good:
        raise ImageGridError("the picture could not be encoded", where=str(path), remedy="Use PNG, or another quality")
    return encoded.tobytes()


def _write_whole(path: Path, data: bytes) -> None:
    """Write a file that is either whole or not there, also after a power loss."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _append(path: Path, line: Mapping[str, Any]) -> None:
    """Add a line that is either whole or not there; half of one would spoil the next."""
    before = path.stat().st_size if path.exists() else None
    try:
        with path.open("ab") as stream:
            stream.write(json.dumps(line, ensure_ascii=False, allow_nan=False).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError:
        if path.exists():
            os.truncate(path, before or 0)
        raise
    if before is None:
        _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Make a rename last. Where folders cannot be opened (Windows) the file system has to see to it."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except PermissionError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _cannot_write(path: Path, failure: OSError) -> RigError:
    return RigError(
        f"{path}: cannot be written ({failure.strerror or failure}). Free some space or choose another folder"
    )
