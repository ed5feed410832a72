"""A disk that remembers every call, and what is left of its folders when the power fails after any of them.

The model is POSIX's promise and no more: content survives if the file was flushed since, a name (made, renamed or
removed) if its folder was. Of what was not flushed, anything from nothing to all may survive, in order.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calibration_free_tests.scan.sample import QuickDisk

Event = tuple[Any, ...]


class RememberingDisk(QuickDisk):
    """Does what it is told, and keeps a trace; ``note`` adds what others have to tell, e.g. an acknowledgement."""

    def __init__(self) -> None:
        self.trace: list[Event] = []
        self._paths: dict[int, Path] = {}

    def note(self, *event: Any) -> None:
        self.trace.append(event)

    def open(self, path: Path, flags: int, mode: int = 0o666) -> int:
        if flags & os.O_CREAT and not path.exists():
            self.note("create", path)
        elif flags & os.O_TRUNC:
            self.note("cut", path, 0)
        handle = super().open(path, flags, mode)
        self._paths[handle] = path
        return handle

    def write(self, handle: int, data: bytes) -> int:
        self.note("append", self._paths[handle], data)
        return super().write(handle, data)

    def fsync(self, handle: int) -> None:
        self.note("flush", self._paths[handle])

    def ftruncate(self, handle: int, length: int) -> None:
        self.note("cut", self._paths[handle], length)
        super().ftruncate(handle, length)

    def replace(self, source: Path, target: Path) -> None:
        self.note("rename", source, target)
        super().replace(source, target)

    def mkdir(self, path: Path) -> None:
        self.note("mkdir", path)
        super().mkdir(path)

    def unlink(self, path: Path) -> None:
        super().unlink(path)
        self.note("unlink", path)


@dataclass(eq=False)
class File:
    """Content as the programs see it, and each content since the last flush, that one first: any may be on the disk."""

    content: bytes = b""
    states: list[bytes] = field(default_factory=lambda: [b""])

    def become(self, content: bytes) -> None:
        self.content = content
        self.states.append(content)


@dataclass(eq=False)
class Folder:
    """Names as the programs see them, and each state of them since the last flush, that one first."""

    names: dict[str, File | Folder] = field(default_factory=dict)
    states: list[dict[str, File | Folder]] = field(default_factory=lambda: [{}])

    def set(self, **changes: File | Folder | None) -> None:
        self.names = {name: what for name, what in {**self.names, **changes}.items() if what is not None}
        self.states.append(self.names)


class Replayed:
    """The state of a tree of folders after a part of a trace; ``root`` was there, and safe, before."""

    def __init__(self, root: Path) -> None:
        self._root, self._top = root, Folder()

    def play(self, event: Event) -> None:
        kind, *rest = event
        if not isinstance(rest[0], Path) or not rest[0].is_relative_to(self._root):
            return  # It changes nothing of the tree.
        if kind == "flush":
            found = self._at(rest[0])
            if isinstance(found, File):
                found.states = [found.content]
            else:
                found.states = [found.names]
        elif kind == "append":
            file = self._file(rest[0])
            file.become(file.content + rest[1])
        elif kind == "cut":
            file = self._file(rest[0])
            file.become(file.content[: rest[1]])
        elif kind in ("create", "mkdir"):
            self._folder(rest[0]).set(**{rest[0].name: File() if kind == "create" else Folder()})
        elif kind == "unlink":
            self._folder(rest[0]).set(**{rest[0].name: None})
        elif kind == "rename":
            source, target = rest
            moved = self._at(source)
            self._folder(source).set(**{source.name: None, target.name: moved})

    def left_after_power_loss(self, target: Path, luck: np.random.Generator | None, whole: bool = False) -> None:
        """Write to ``target`` what is left: only what was flushed, everything (``whole``), or, with luck, any of it."""
        self._leave(self._top, target, luck, whole)

    def _leave(self, folder: Folder, target: Path, luck: np.random.Generator | None, whole: bool) -> None:
        target.mkdir()
        for name, what in self._drawn(folder.states, luck, whole).items():
            if isinstance(what, Folder):
                self._leave(what, target / name, luck, whole)
            else:
                (target / name).write_bytes(self._content(what, luck, whole))

    def _content(self, file: File, luck: np.random.Generator | None, whole: bool) -> bytes:
        content: bytes = self._drawn(file.states, luck, whole)
        flushed = file.states[0]
        if luck is not None and content.startswith(flushed):
            # A line that is being written reaches the disk in pieces.
            content = content[: luck.integers(len(flushed), len(content) + 1)]
        return content

    @staticmethod
    def _drawn(states: list[Any], luck: np.random.Generator | None, whole: bool) -> Any:
        return states[luck.integers(len(states))] if luck is not None else states[-1 if whole else 0]

    def _at(self, path: Path) -> File | Folder:
        found: File | Folder = self._top
        for name in path.relative_to(self._root).parts:
            assert isinstance(found, Folder)
            found = found.names[name]
        return found

    def _file(self, path: Path) -> File:
        found = self._at(path)
        assert isinstance(found, File)
        return found

    def _folder(self, path: Path) -> Folder:
        found = self._at(path.parent)
        assert isinstance(found, Folder)
        return found
