"""Stores pictures in the background, one at a time, while the rig moves on."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any, Protocol

from rig.hal import Frame
from rig.imagegrid import GridFrame, GridWriter


class FrameStore(Protocol):
    """Takes one picture at a time and says when it is safe."""

    def put(self, frame: Frame, file: str) -> None:
        """Begin to store a picture; the one before has been collected."""
        ...

    def collect(self) -> GridFrame | None:
        """Wait until the picture in hand is safe on the disk; ``None`` if there is none in hand.

        Raises:
            RigError: it could not be stored.
        """
        ...


class BackgroundStore:
    """Encodes, writes and flushes in one thread of its own. A context manager: leaving it waits for the last picture.

    It holds one picture and no more: a queue would not make a slow disk faster, and a kill would lose all of it.

    Args:
        writer: of the image grid.
        quality: of JPEG; ``None``: as the writer has it.
        now: date and time, which pictures carry for people; nothing is decided by it.
    """

    def __init__(
        self, writer: GridWriter, quality: int | None = None, now: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        self._writer, self._quality, self._now = writer, quality, now
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="store")
        self._in_hand: Future[GridFrame] | None = None

    def put(self, frame: Frame, file: str) -> None:
        """Begin to store a picture; see `FrameStore`."""
        if self._in_hand is not None:
            raise RuntimeError("the picture before has not been collected")
        taken_at = self._now().isoformat(timespec="milliseconds")
        self._in_hand = self._thread.submit(self._writer.add, frame, file, quality=self._quality, taken_at=taken_at)

    def collect(self) -> GridFrame | None:
        """Wait for the picture in hand; see `FrameStore`."""
        in_hand, self._in_hand = self._in_hand, None
        return None if in_hand is None else in_hand.result()

    def __enter__(self) -> BackgroundStore:
        return self

    def __exit__(self, *exc: Any) -> None:
        self._thread.shutdown(wait=True)
