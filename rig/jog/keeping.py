"""Keeps pictures that were taken by hand in an image grid, each with its pose."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rig.hal import Frame
    from rig.imagegrid import GridFrame, GridWriter


def _now() -> datetime:
    return datetime.now().astimezone()


class HandGrid:
    """An image grid that grows by pictures taken by hand; one that is there already goes on. A context manager.

    Args:
        folder: of the grid; made, and locked until `close`, by `open` or the first `add`.
        bench: where the pictures are taken, for the grid's provenance.
        fixed_by_zoom: the bench vouches that the camera's internals are the same whenever the zoom is.
        now: date and time, for people.
    """

    def __init__(
        self, folder: Path, bench: str, *, fixed_by_zoom: bool = False, now: Callable[[], datetime] = _now
    ) -> None:
        self.folder = folder
        self._bench, self._fixed_by_zoom, self._now = bench, fixed_by_zoom, now
        self._writer: GridWriter | None = None

    @property
    def count(self) -> int:
        """Pictures in the grid; 0 before it is opened."""
        return 0 if self._writer is None else len(self._writer.frames)

    def open(self) -> GridWriter:
        """Make the grid, or take over the one that is there.

        Raises:
            InputError: its internals are others than the bench's, or another process writes there.
            ImageGridError: the grid that is there is damaged.
            RigError: the folder cannot be written.
        """
        from rig.imagegrid import GridInfo, GridWriter

        if self._writer is None:
            internals = {"internals": "fixed_by_zoom"} if self._fixed_by_zoom else {}
            info = GridInfo.model_validate({"provenance": f"taken by hand on the bench {self._bench}", **internals})
            self._writer = GridWriter(self.folder, info, grow=True)
        return self._writer

    def add(self, frame: Frame) -> GridFrame:
        """Keep a picture under a file name that is still free.

        Raises:
            ImageGridError: there is a picture from this pose already.
            InputError, RigError: as `open`; the disk is full or refuses.
        """
        writer = self.open()
        return writer.add(frame, writer.free_name(), taken_at=self._now().isoformat("T", "seconds"))

    def close(self) -> None:
        """Let others write there. Safe to call twice."""
        if self._writer is not None:
            self._writer.close()

    def __enter__(self) -> HandGrid:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()
