"""Places that a person has marked on a bench, kept in a small file between sessions."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from rig.errors import InputError, RigError
from rig.hal import AXES, RigPose

LONGEST_NAME = 20
_MOST, _MOST_BYTES = 200, 100_000


def marks_file(key: str) -> Path:
    """``rig/marks/KEY.json`` in ``$XDG_STATE_HOME`` or ``~/.local/state``.

    Args:
        key: of the bench (`rig.bench.BenchConfig.key`): the marks are the bench's, whatever is taken there.
    """
    told = os.environ.get("XDG_STATE_HOME", "")
    base = Path(told) if told.startswith("/") else Path.home() / ".local" / "state"
    return base / "rig" / "marks" / f"{key}.json"


class Marks:
    """Named poses in the rig frame, in the order in which they were first set.

    Args:
        path: of the file; it and its folder are made when the first mark is set.

    Raises:
        InputError: the file is there and is no file of marks, or cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._poses = _read(path)

    @property
    def poses(self) -> dict[str, RigPose]:
        """All of them, by name."""
        return dict(self._poses)

    def free_name(self) -> str:
        """The lowest number that no mark has as its name."""
        number = 1
        while str(number) in self._poses:
            number += 1
        return str(number)

    def set(self, name: str, pose: RigPose) -> None:
        """Set a mark, or move one.

        Raises:
            InputError: the name cannot be shown in a list, or there are too many marks.
            RigError: the file cannot be written; the marks are as before.
        """
        if not (name.isprintable() and name.strip() == name and 0 < len(name) <= LONGEST_NAME):
            raise InputError(f"{name!r} cannot name a mark", remedy=f"Use 1 to {LONGEST_NAME} letters or digits")
        if name not in self._poses and len(self._poses) >= _MOST:
            raise InputError(f"there are {_MOST} marks already", remedy="Remove one first")
        self._keep(self._poses | {name: pose})

    def remove(self, name: str) -> None:
        """Remove a mark, if there is one of that name.

        Raises:
            RigError: the file cannot be written; the marks are as before.
        """
        self._keep({other: pose for other, pose in self._poses.items() if other != name})

    def _keep(self, poses: dict[str, RigPose]) -> None:
        text = json.dumps({"schema": 1, "marks": {name: asdict(pose) for name, pose in poses.items()}}, indent=1)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            # Written beside it and renamed: whoever is killed in between keeps the old marks.
            with tempfile.NamedTemporaryFile("w", dir=self._path.parent, delete=False) as file:
                file.write(text + "\n")
            Path(file.name).replace(self._path)
        except OSError as failure:
            raise RigError(f"{self._path}: the marks cannot be kept ({failure.strerror or failure})") from failure
        self._poses = poses


def _read(path: Path) -> dict[str, RigPose]:
    try:
        with path.open("rb") as file:
            found = json.loads(file.read(_MOST_BYTES))
        if found["schema"] != 1:
            raise ValueError(f"schema {found['schema']} is not 1")
        return {str(name): _pose(values) for name, values in found["marks"].items()}
    except FileNotFoundError:
        return {}
    except OSError as failure:
        raise InputError(
            f"the marks cannot be read ({failure.strerror or failure})", where=str(path), remedy="Mend its rights"
        ) from failure
    except (ValueError, KeyError, TypeError, AttributeError) as failure:
        raise InputError(
            f"this is no file of marks ({failure})", where=str(path), remedy="Move it away; new marks make a new one"
        ) from failure


def _pose(values: Mapping[str, float]) -> RigPose:
    pose = RigPose(*(float(values[axis]) for axis in AXES))
    if not all(math.isfinite(getattr(pose, axis)) for axis in AXES):
        raise ValueError("a mark is not finite")
    return pose
