"""Keeps a recognition while it goes on: every step is in the run folder before anybody sees it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Generator, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from recognition.modelbase import ModelBase
from recognition.steps import Answer, Step
from rig.errors import InputError, RigError
from rig.run.events import SCHEMA, belief_event, finish_event, finite, move_event, parts_event, view_event
from rig.run.result import aborted_answer, outlines, result_object

Steps = Generator[Step, None, Answer]
"""What the recogniser, a recorder and a replay all are: one step per view, and the answer at the end."""

FIRST_VIEW = "The view that the run was started from."
INTERRUPTED = "The run was interrupted."


@dataclass(frozen=True)
class RunStart:
    """What a run was started with, for the record; every value must be plain JSON."""

    models: str
    bench: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    command: str = ""
    version: str = ""


def watch(steps: Steps, show: Callable[[Step], None]) -> Answer:
    """Show each step as it comes and return the answer; the generator is closed whatever happens."""
    try:
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                answer: Answer = end.value
                return answer
            show(step)
    finally:
        steps.close()


class RunRecorder:
    """Passes steps on and keeps what they say: in a run folder, if there is one, and as the result object.

    Args:
        folder: the run folder, made if need be; ``None`` keeps nothing on disk.
        start: what the run was started with.
        models: its outlines are kept with the run.
        now: the clock for the record's time stamps.

    Raises:
        InputError: the folder already holds something.
    """

    def __init__(
        self,
        folder: Path | None,
        start: RunStart,
        models: ModelBase | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self.folder = folder
        self.answer: Answer | None = None
        self.interrupted = False
        self._now = now
        self._steps: list[Step] = []
        self._reason = FIRST_VIEW
        if folder is not None:
            _claim(folder)
            if models is not None:
                _write_json(folder / "objects.json", outlines(models))
        self._write({"kind": "start", "schema": SCHEMA, **asdict(start), "why": "A recognition was asked for."})

    def record(self, steps: Steps, stop: Callable[[], bool] = lambda: False) -> Steps:
        """Yield every step once it is safely written; return the answer.

        The record is ended in every case: when ``stop()`` says so after a step, on an interrupt, on an error (which is
        raised again), or when the watcher gives up. The outcome is then ``aborted``.
        """
        try:
            answer = yield from self._until_done(steps, stop)
        except KeyboardInterrupt:
            self.interrupted = True
            answer = self._aborted(INTERRUPTED)
        except BaseException as error:
            self._finish(self._aborted(_reason(error)))
            raise
        finally:
            steps.close()
        self._finish(answer)
        return answer

    def result(self) -> dict[str, Any]:
        """The result object of design §8 (``--json``, ``result.json``). Only after the end of the run."""
        if self.answer is None:
            raise RuntimeError("the run has not ended")
        return result_object(self._steps, self.answer)

    def _until_done(self, steps: Steps, stop: Callable[[], bool]) -> Steps:
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                answer: Answer = end.value
                return answer
            self._keep(step)
            yield step
            if stop():
                self.interrupted = True
                return self._aborted(INTERRUPTED)

    def _keep(self, step: Step) -> None:
        if self.folder is not None:
            file, sha256 = _write_view(self.folder, step)
            self._write(view_event(step, file, sha256, self._reason))
            self._write(parts_event(step))
            self._write(belief_event(step))
            if step.move is not None:
                self._write(move_event(step.index, step.move))
        if step.move is not None:
            self._reason = step.move.why
        self._steps.append(step)

    def _finish(self, answer: Answer) -> None:
        self.answer = answer
        self._write(finish_event(answer))
        if self.folder is not None:
            _write_json(self.folder / "result.json", self.result())

    def _write(self, event: Mapping[str, Any]) -> None:
        if self.folder is None:
            return
        line = json.dumps(finite({**event, "time": self._now().isoformat()}), allow_nan=False, ensure_ascii=False)
        path = self.folder / "events.jsonl"
        try:
            with path.open("a", encoding="utf-8") as journal:
                journal.write(line + "\n")
                journal.flush()
                os.fsync(journal.fileno())
        except OSError as error:
            raise _cannot_write(path, error) from error

    def _aborted(self, why: str) -> Answer:
        return aborted_answer(self._steps, why)


def _claim(folder: Path) -> None:
    """Make the run folder; a folder in use is refused, so that no run is ever mixed into another."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError("the folder is not empty", where=str(folder), remedy="Give --out a new folder")
        (folder / "views").mkdir()
    except OSError as error:
        raise InputError(
            f"cannot make the run folder: {error.strerror}",
            where=str(folder),
            remedy="Give --out a folder that can be written",
        ) from error


def _write_view(folder: Path, step: Step) -> tuple[str, str]:
    """Write the picture and return its name in the folder and its SHA-256."""
    import cv2

    done, encoded = cv2.imencode(".jpg", step.frame.image, [cv2.IMWRITE_JPEG_QUALITY, 95])
    if not done:
        raise RigError(f"the picture {step.frame.name!r} cannot be encoded as JPEG")
    data = encoded.tobytes()
    name = f"views/{step.index:03d}.jpg"
    _write_atomically(folder / name, data)
    return name, hashlib.sha256(data).hexdigest()


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    text = json.dumps(finite(value), allow_nan=False, ensure_ascii=False, indent=1 if path.stem == "result" else None)
    _write_atomically(path, (text + "\n").encode())


def _write_atomically(path: Path, data: bytes) -> None:
    """Under its name there is either the whole file or none, whatever happens meanwhile."""
    temporary = path.with_name(path.name + ".tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise _cannot_write(path, error) from error


def _cannot_write(path: Path, error: OSError) -> RigError:
    return RigError(f"{path}: cannot be written ({error.strerror}). Free some space or choose another --out")


def _reason(error: BaseException) -> str:
    """Why the run was cut short, in one sentence."""
    if isinstance(error, GeneratorExit):
        return "Whoever watched the run gave up."
    if isinstance(error, RigError):
        return f"The run failed: {error}"
    return f"The run failed unexpectedly ({type(error).__name__})."
