"""Writes image grids so that a crash at any moment leaves one that can be read and go on: picture first, then line."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from rig.errors import ImageGridError, InputError, RigError
from rig.hal import Frame, Image
from rig.imagegrid.disk import Disk, TakenBackError, append_line, discard, make_folder, write_whole
from rig.imagegrid.entry import INFO, MANIFEST, TRUTH, FrameEntry, GridFrame, GridInfo, pose_key
from rig.imagegrid.images import read_header
from rig.imagegrid.lock import FolderLock
from rig.imagegrid.recovery import Progress, Recovered, encoded_line, recover
from rig.schema_words import describe


class GridWriter:
    """Adds pictures to an image grid, and holds its folder meanwhile. A context manager: leaving it lets go.

    Each picture is written under a temporary name, flushed to disk, renamed, and only then gets its line in the
    manifest, which is flushed too: what the manifest lists is whole. When `add` returns, the picture is acknowledged:
    neither a kill nor a power loss can take it back.

    Args:
        folder: made if need be.
        info: for ``grid.yaml``.
        grow: go on with a grid that is there already, mended first if its writer was killed. Otherwise one is refused.
        retake_damaged: (with ``grow``) check every digest, and strike out pictures that are missing or damaged.
        lock: on the folder, where the caller has taken it already; it is released with the writer.
        disk: the calls that change the disk.
        progress: shows how far the check of a grid that is there already has come.

    Attributes:
        mended: what had to be done to a grid that was there already, one message each.

    Raises:
        InputError: there is a grid already, its internals are others than told, or another process writes there.
        ImageGridError: the grid that is there is damaged.
        RigError: the folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        info: GridInfo,
        *,
        grow: bool = False,
        retake_damaged: bool = False,
        lock: FolderLock | None = None,
        disk: Disk = os,
        progress: Progress = lambda frames: frames,
    ) -> None:
        self.folder = folder
        self.mended: tuple[str, ...] = ()
        self._disk, self._info = disk, info
        self._frames: dict[str, GridFrame] = {}
        self._places: dict[tuple[int, ...], str] = {}
        self._lines, self._sound = 0, True
        self._ready: set[Path] = set()
        self._lock = lock or hold_folder(folder, disk)
        try:
            if not (folder / MANIFEST).exists():
                write_whole(disk, folder / INFO, yaml_of(info).encode())
                write_whole(disk, folder / MANIFEST, b"")
            elif grow:
                self._take_over(recover(self._lock, disk, retake_damaged=retake_damaged, progress=progress))
            else:
                raise InputError("holds an image grid already", where=str(folder), remedy="Name another folder")
        except OSError as failure:
            self.close()
            raise cannot_write(folder, failure) from failure
        except RigError:
            self.close()
            raise

    @property
    def frames(self) -> tuple[GridFrame, ...]:
        """What is in the grid, in the manifest's order."""
        return tuple(self._frames.values())

    def free_name(self, suffix: str = ".png") -> str:
        """A file name that neither the manifest nor the folder has yet, counted on: ``images/00017.png``."""
        number = len(self._frames) + 1
        while (file := f"images/{number:05d}{suffix}") in self._frames or (self.folder / file).exists():
            number += 1
        return file

    def close(self) -> None:
        """Let others write there. Safe to call twice."""
        self._lock.release()

    def __enter__(self) -> GridWriter:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

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
        data = encode_image(frame.image, self.folder / file, quality)
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
        size = {"width": header.width, "height": header.height, "size_bytes": len(data)}
        line = {name: value for name, value in {**entry, **size}.items() if value is not None}
        line["sha256"] = hashlib.sha256(data).hexdigest()
        checked = self._checked(line, path)
        self._refuse_unsound()
        try:
            self._lock.note(line)
            self._make_folder(path.parent)
            if truth is not None:
                # Before the picture: a kill in between leaves a truth without a picture, which harms nobody.
                self._append(self.folder / TRUTH, {"file": checked.file, **truth})
            write_whole(self._disk, path, data)
            self._append(self.folder / MANIFEST, line)
        except OSError as failure:
            if self._sound:
                discard(self._disk, path)
            raise cannot_write(path, failure) from failure
        self._lines += 1
        frame = GridFrame.of(checked, self._lines)
        self._remember(frame)
        return frame

    def _append(self, path: Path, line: Mapping[str, Any]) -> None:
        self._sound = False
        try:
            append_line(self._disk, path, encoded_line(line))
        except TakenBackError:
            self._sound = True
            raise
        self._sound = True

    def _refuse_unsound(self) -> None:
        if not self._sound:
            raise RigError(
                f"{self.folder}: a line could neither be written nor taken back. Open the grid again, which mends it"
            )

    def _make_folder(self, folder: Path) -> None:
        if folder not in self._ready:
            make_folder(self._disk, folder, self.folder)
            self._ready.add(folder)

    def _take_over(self, found: Recovered) -> None:
        told = self._info.internals
        if None not in (told, found.info.internals) and told != found.info.internals:
            raise InputError(
                f"the grid's internals are {found.info.internals}, the rig's {told}",
                where=str(self.folder / INFO),
                remedy="Name another folder",
            )
        self._info, self.mended, self._lines = found.info, found.mended, found.lines
        for frame in found.frames:
            self._remember(frame)

    def _remember(self, frame: GridFrame) -> None:
        self._frames[frame.file] = frame
        self._places[pose_key(frame.pose)] = frame.file

    def _checked(self, line: Mapping[str, Any], path: Path) -> FrameEntry:
        try:
            entry = FrameEntry.model_validate(line, strict=True)
        except ValidationError as failure:
            wording = describe(FrameEntry, failure.errors(include_url=False)[0], line)
            name = ".".join(map(str, wording.location))
            raise ImageGridError(f"{name}: {wording.message}", where=str(path), remedy=wording.remedy) from failure
        if entry.file in self._frames:
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


def hold_folder(folder: Path, disk: Disk = os) -> FolderLock:
    """Make a folder if need be, and lock it.

    Raises:
        InputError: it cannot be made, or another process writes there.
        RigError: it cannot be written.
    """
    try:
        make_folder(disk, folder)
    except OSError as failure:
        why = f"the folder cannot be made ({failure.strerror or failure})"
        raise InputError(why, where=str(folder), remedy="Name another folder") from failure
    try:
        return FolderLock(folder, disk)
    except OSError as failure:
        raise cannot_write(folder, failure) from failure


def yaml_of(values: BaseModel) -> str:
    """A flat model as YAML, one line a key."""
    told = values.model_dump(mode="json", by_alias=True, exclude_none=True)
    return "".join(f"{key}: {_quoted(value)}\n" for key, value in told.items())


def _quoted(value: Any) -> str:
    """A value as YAML; text always in quotes, lest a word like ``off`` be read as something else."""
    import yaml

    if isinstance(value, str):
        return str(yaml.safe_dump(value, default_style='"', allow_unicode=True, width=1_000_000)).strip()
    return json.dumps(value)


def encode_image(image: Image, path: Path, quality: int | None) -> bytes:
    """A picture as PNG or as JPEG, as the path's ending says.

    Raises:
        ImageGridError: another ending, or it cannot be encoded.
    """
    import cv2

    if path.suffix not in (".png", ".jpg", ".jpeg"):
        raise ImageGridError(f"ends in {path.suffix!r}", where=str(path), remedy="Write .png or .jpg")
    options = [] if path.suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 95 if quality is None else quality]
    # Encoded in memory and written by us: on a full disk cv2.imwrite returns False and raises nothing.
    good, encoded = cv2.imencode(path.suffix, image, options)
    if not good:
        raise ImageGridError("the picture could not be encoded", where=str(path), remedy="Use PNG, or another quality")
    return encoded.tobytes()


def cannot_write(path: Path, failure: OSError) -> RigError:
    """The one message for a disk that is full or refuses."""
    return RigError(
        f"{path}: cannot be written ({failure.strerror or failure}). Free some space or choose another folder"
    )
