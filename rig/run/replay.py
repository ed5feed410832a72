"""Reads a run folder back, as the same steps that its watchers saw."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from recognition.modelbase import Face, FloatArray, ObjectModel, Part
from recognition.steps import Answer, Move, Step
from rig.errors import InputError
from rig.hal import Image
from rig.imagegrid import load_image
from rig.run.events import SCHEMA, Event, answer_of, move_of, step_of
from rig.run.recorder import Steps
from rig.run.result import aborted_answer

KINDS = ("start", "view", "parts", "belief", "move", "finish")
CUT_SHORT = "The record ends here: the run was killed, or is still going on."


@dataclass(frozen=True)
class RunRecord:
    """A whole run, read back.

    Attributes:
        start: the ``start`` event.
        steps: the views, pictures included.
        reasons: why each view was taken, one sentence a step.
        answer: the end; outcome ``aborted`` where a partial record was allowed.
        objects: the outlines kept with the run (``objects.json``); empty if there are none.
    """

    folder: Path
    start: Event
    steps: tuple[Step, ...]
    reasons: tuple[str, ...]
    answer: Answer
    objects: tuple[ObjectModel, ...]


def replay(folder: Path, allow_partial: bool = False) -> Steps:
    """Yield the steps of a run from its events alone (the frames' images are empty), then return its answer.

    Raises:
        InputError: naming file and line: not a run folder, a damaged line, a missing end. The steps before the damage
            have been yielded by then. With ``allow_partial`` a missing end or half a last line is no error; the
            answer is ``aborted``.
    """
    journal = _Journal(folder, allow_torn=allow_partial)
    seen: list[Step] = []
    for step in journal.steps():
        seen.append(step)
        yield step
    if journal.answer is not None:
        return journal.answer
    if not allow_partial:
        raise InputError(
            CUT_SHORT, where=journal.place, remedy="Give --allow-partial to go on with the views before this line"
        )
    return aborted_answer(seen, CUT_SHORT)


def read_run(folder: Path, allow_partial: bool = False) -> RunRecord:
    """Read a whole run, pictures included; their SHA-256 is checked before they are decoded.

    Raises:
        InputError: as ``replay``, and for a missing or changed picture.
    """
    journal = _Journal(folder, images=True, allow_torn=allow_partial)
    steps = tuple(journal.steps())
    answer = journal.answer
    if answer is None:
        if not allow_partial:
            raise InputError(
                CUT_SHORT, where=journal.place, remedy="Give --allow-partial to go on with the views before this line"
            )
        answer = aborted_answer(steps, CUT_SHORT)
    return RunRecord(folder, journal.start, steps, tuple(journal.reasons), answer, _objects(folder))


class _Journal:
    """Walks ``events.jsonl``: knows the order that events must have, and the line it is at."""

    def __init__(self, folder: Path, images: bool = False, allow_torn: bool = False) -> None:
        self._folder, self._allow_torn = folder, allow_torn
        self._path = folder / "events.jsonl"
        self._images = images
        self._line = 0
        self.start: Event = {}
        self.reasons: list[str] = []
        self.answer: Answer | None = None

    @property
    def place(self) -> str:
        return f"{self._path}:{max(self._line, 1)}"

    def steps(self) -> Iterator[Step]:
        """Yield the steps; sets ``start`` first and ``answer`` at the end, if the end is there."""
        events = self._events()
        self.start = self._expect(next(events, None), ("start",))
        if self.start.get("schema") != SCHEMA:
            raise self._damaged(f"schema {self.start.get('schema')!r} is not known", f"This version reads {SCHEMA}")
        event = next(events, None)
        while event is not None:
            self._expect(event, ("view", "finish"))
            if event["kind"] == "finish":
                self._end(event, next(events, None))
                return
            parts, belief = next(events, None), next(events, None)
            if parts is None or belief is None:
                return
            self._expect(parts, ("parts",))
            self._expect(belief, ("belief",))
            step = self._step(event, parts, belief)
            try:
                event = next(events, None)
            except InputError:
                # The view is whole even where the line after it is not.
                yield step
                raise
            if event is None or event["kind"] != "move":
                yield step
            else:
                yield replace(step, move=self._move(event))
                event = next(events, None)

    def _events(self) -> Iterator[Event]:
        try:
            with self._path.open(encoding="utf-8") as lines:
                for self._line, line in enumerate(lines, 1):
                    # A run that is killed while it writes leaves half a line: the record ends before it.
                    if self._allow_torn and not line.endswith("\n"):
                        return
                    yield self._parse(line)
        except (FileNotFoundError, NotADirectoryError) as error:
            raise InputError(
                "is not a run folder: it has no events.jsonl",
                where=str(self._folder),
                remedy="Name a folder that rig recognise or rig demo has written",
            ) from error
        except (OSError, UnicodeDecodeError) as error:
            raise self._damaged(f"cannot be read ({error})") from error

    def _parse(self, line: str) -> Event:
        try:
            event = json.loads(line)
        except (ValueError, RecursionError) as error:
            cut = "" if line.endswith("\n") else ": it is cut off"
            raise self._damaged(f"the line is not JSON{cut}") from error
        if not isinstance(event, dict) or event.get("kind") not in KINDS:
            raise self._damaged("the line is not an event of a run")
        return event

    def _expect(self, event: Event | None, kinds: tuple[str, ...]) -> Event:
        if event is None:
            raise self._damaged("the record is empty")
        if event["kind"] not in kinds:
            raise self._damaged(f"a {event['kind']!r} event is not expected here but {' or '.join(kinds)}")
        return event

    def _step(self, view: Event, parts: Event, belief: Event) -> Step:
        try:
            image = self._image(view) if self._images else np.zeros((0, 0), dtype=np.uint8)
            step = step_of(view, parts, belief, image)
            self.reasons.append(str(view["why"]))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            message = f"the three events of view {view.get('view')!r}, up to this line, are not complete"
            raise self._damaged(f"{message} ({error!r})") from error
        return step

    def _move(self, event: Event) -> Move:
        try:
            return move_of(event)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise self._damaged(f"the move event is not complete ({error!r})") from error

    def _end(self, event: Event, after: Event | None) -> None:
        try:
            self.answer = answer_of(event)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise self._damaged(f"the finish event is not complete ({error!r})") from error
        if after is not None:
            raise self._damaged("an event follows the end of the run")

    def _image(self, view: Event) -> Image:
        file = PurePosixPath(view["file"])
        if len(file.parts) != 2 or file.parts[0] != "views" or ".." in file.parts:
            raise self._damaged(f"{view['file']!r} is not a file in the run's views folder")
        # Names the file, and checks size and digest before the decoder sees a byte.
        return load_image(self._folder / file, sha256=str(view["sha256"]), size=(view["width"], view["height"]))

    def _damaged(self, message: str, remedy: str = "The views before this line are whole") -> InputError:
        return InputError(message, where=self.place, remedy=remedy)


def _corners(data: Mapping[str, Any]) -> FloatArray:
    corners = np.array(data["corners_mm"], dtype=np.float64).reshape(-1, 3)
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise ValueError(f"{data['id']!r} has no outline")
    return corners


def _objects(folder: Path) -> tuple[ObjectModel, ...]:
    path = folder / "objects.json"
    if not path.exists():
        return ()
    try:
        objects = json.loads(path.read_text(encoding="utf-8"))["objects"]
        return tuple(
            ObjectModel(
                str(item["id"]),
                tuple(
                    Part(str(part["id"]), str(part["class"]), _corners(part), face=part["face"] and str(part["face"]))
                    for part in item["parts"]
                ),
                tuple(Face(str(face["id"]), _corners(face)) for face in item["faces"]),
            )
            for item in objects
        )
    except (OSError, ValueError, RecursionError, KeyError, TypeError, IndexError) as error:
        raise InputError(
            f"cannot be read ({error})", where=str(path), remedy="Delete it: the report then has no plan"
        ) from error
