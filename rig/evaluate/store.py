"""The folder of an evaluation: which plan it is of, and one line a trial, each on the disk before the next is counted.

``plan.json`` says which plan; ``trials.jsonl`` grows by a line a trial. A process that was killed may leave its last
line torn: it is cut away. Trials that failed are not done: they are tried again, and the newest line of a trial counts.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rig.errors import InputError, RigError
from rig.evaluate.plan import Plan
from rig.evaluate.work import Record
from rig.imagegrid.lock import FolderLock

PLAN, TRIALS, SUMMARY, REPORT = "plan.json", "trials.jsonl", "summary.json", "report.html"

Key = tuple[str, int]


class Store:
    """An evaluation's folder, held by this process until it is closed.

    Attributes:
        folder: where it is.
        records: what is known of each trial, by row and number; those that failed among them.
        mended: what had to be done about the last line, if anything.
    """

    def __init__(self, folder: Path, plan: Plan) -> None:
        """Open a folder: new, empty, or of this very plan.

        Raises:
            InputError: it holds something else, another plan's trials, or a damaged line; or another process writes
                there.
            RigError: it cannot be written.
        """
        self.folder = folder
        self.mended: str | None = None
        try:
            _claim(folder, plan)
            self._lock = FolderLock(folder)
        except OSError as error:
            raise _cannot_write(folder, error) from error
        try:
            self.records = self._read()
        except BaseException:
            self.close()
            raise

    def add(self, record: Record) -> None:
        """Keep a trial's line.

        Raises:
            RigError: the disk refused it.
        """
        line = json.dumps(record, ensure_ascii=False, allow_nan=False).encode() + b"\n"
        path = self.folder / TRIALS
        try:
            with path.open("ab") as stream:
                stream.write(line)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise _cannot_write(path, error) from error
        self.records[_key(record)] = record

    def write(self, name: str, text: str) -> Path:
        """Write a file of the folder as a whole, in place of the one before.

        Raises:
            RigError: the disk refused it.
        """
        path = self.folder / name
        temporary = path.with_name(path.name + ".tmp")
        try:
            temporary.write_text(text, encoding="utf-8")
            os.replace(temporary, path)
        except OSError as error:
            raise _cannot_write(path, error) from error
        return path

    def close(self) -> None:
        """Let go of the folder."""
        self._lock.release()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

    def _read(self) -> dict[Key, Record]:
        path = self.folder / TRIALS
        if not path.exists():
            return {}
        data = path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            os.truncate(path, whole)
            self.mended = f"{path}: the last line was torn off; it was cut away, and its trial is done again"
        return {_key(record): record for record in _lines(path, data[:whole])}


def failed(record: Record) -> bool:
    """Whether a trial came to no answer."""
    return "error" in record


def _claim(folder: Path, plan: Plan) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PLAN
    if not path.exists():
        if any(entry.name != ".lock" for entry in folder.iterdir()):
            raise InputError(
                "the folder holds something that is no evaluation", where=str(folder), remedy="Name a new one"
            )
        about = {"schema": 1, "plan": plan.name, "seed": plan.seed, "sha256": plan.sha256}
        temporary = path.with_name(path.name + ".tmp")
        temporary.write_text(json.dumps(about, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(temporary, path)
        return
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        theirs, name, seed = about["sha256"], about["plan"], about["seed"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError("this is no evaluation's plan", where=str(path), remedy="Name a new folder") from error
    if theirs != plan.sha256:
        raise InputError(
            f"the folder is of another plan: {name!r} with seed {seed}, or another version of it or its model bases",
            where=str(folder),
            remedy="Name a new folder with --out, or give the plan that it is of",
        )


def _lines(path: Path, data: bytes) -> Iterable[Record]:
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            record = json.loads(line)
            _key(record)
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                "this line is no trial's record", where=f"{path}:{number}", remedy="Remove the line"
            ) from error
        yield record


def _key(record: Record) -> Key:
    return str(record["row"]), int(record["number"])


def _cannot_write(path: Path, error: OSError) -> RigError:
    return RigError(f"{path}: cannot be written ({error.strerror}). Free some space, or choose another --out")
