"""The live table of a run: a line a view, on a terminal as it grows, elsewhere as plain lines.

A row is made from a step alone, so a replay shows what was seen live.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from recognition.geometry import wrap_deg
from recognition.steps import Answer, Step
from rig.hal import RigPose

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table

HEADINGS = ("view", "parts", "left", "bits", "leading", "next move and why")
_WIDTHS = (4, 5, 6, 5, 20)
_END = "stop here"


@dataclass(frozen=True, slots=True)
class Row:
    """What a person is told of one view; all text."""

    view: str
    parts: str
    left: str
    bits: str
    leading: str
    move: str


def row_of(step: Step) -> Row:
    """The row of a step."""
    posterior = step.belief.posterior
    leading = max(posterior, key=lambda name: posterior[name]) if posterior else ""
    name = "none of these" if leading == "unknown" else plain(leading)
    move = f"{describe_move(step.frame.rig_pose, step.move.target)}: {step.move.why}" if step.move else _END
    return Row(
        view=str(step.index + 1),
        parts=str(len(step.parts)),
        left=f"{step.belief.hypotheses_left:,}",
        bits=f"{step.belief.entropy_bits:.2f}",
        leading=f"{name} {100 * posterior[leading]:.1f} %" if leading else "",
        move=plain(move),
    )


def describe_move(start: RigPose, end: RigPose) -> str:
    """``X +180 mm, pan -24.0°``: what changes from one rig pose to the next."""
    changes = []
    for axis in "xyz":
        change = getattr(end, f"{axis}_mm") - getattr(start, f"{axis}_mm")
        if abs(change) >= 0.05:
            changes.append(f"{axis.upper()} {change:+.{0 if abs(change) >= 100 else 1}f} mm")
    # A pan that goes round turns the shorter way; wherever it turns, this is how the view changes.
    pan = wrap_deg(end.theta_deg - start.theta_deg)
    if abs(pan) >= 0.005:
        changes.append(f"pan {pan:+.1f}°")
    if abs(end.zoom - start.zoom) >= 0.0005:
        changes.append(f"zoom {start.zoom:.2f} to {end.zoom:.2f}")
    return ", ".join(changes) or "stay"


def summary(answer: Answer) -> str:
    """The answer in a few lines for a person."""
    lines = [f"{answer.outcome.value}: {plain(answer.object_id)}" if answer.object_id else answer.outcome.value]
    if answer.pose_sure is False:
        lines[0] += ", its pose less sure than asked"
    lines.append(plain(answer.why))
    if answer.object_id is None and answer.candidates:
        listed = ", ".join(plain(name) for name in answer.candidates[:5])
        more = f" and {len(answer.candidates) - 5} more" if len(answer.candidates) > 5 else ""
        lines.append(f"left: {listed}{more}")
    if answer.pose is not None:
        units = {"x_mm": "mm", "y_mm": "mm", "z_mm": "mm", "theta_deg": "°"}
        values = [
            f"{key.split('_')[0]} {getattr(answer.pose, key):.1f} ± {answer.pose_sd.get(key, float('nan')):.1f} {unit}"
            for key, unit in units.items()
        ]
        lines.append(f"camera in the object frame: {', '.join(values).replace('nan', '?')}")
    if answer.unobservable:
        lines.append(f"not determined by these views: {', '.join(plain(name) for name in answer.unobservable)}")
    return "\n".join(lines)


def plain(text: str) -> str:
    """``text`` without control characters: names come from files, and a terminal obeys escape sequences."""
    return "".join(character if character.isprintable() else "�" for character in text)


class LiveTable:
    """Shows steps on a stream as they come; a context manager.

    Args:
        stream: where to; if it is no terminal, each view is one plain line.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._rows: list[Row] = []
        self._live: Live | None = None

    def __enter__(self) -> LiveTable:
        if self._stream.isatty():
            from rich.console import Console
            from rich.live import Live

            self._live = Live(self._table(), console=Console(file=self._stream), auto_refresh=False)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, step: Step) -> None:
        """Add the row of a step."""
        self._rows.append(row_of(step))
        if self._live is None:
            if len(self._rows) == 1:
                self._line(Row(*HEADINGS))
            self._line(self._rows[-1])
        else:
            self._live.update(self._table(), refresh=True)

    def _line(self, row: Row) -> None:
        *cells, last = astuple(row)
        aligned = [cell.rjust(width) for cell, width in zip(cells[:4], _WIDTHS, strict=False)]
        print(*aligned, cells[4].ljust(_WIDTHS[4]), last, sep="  ", file=self._stream, flush=True)

    def _table(self) -> Table:
        from rich import box
        from rich.table import Table
        from rich.text import Text

        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for heading in HEADINGS:
            number = heading in HEADINGS[:4]
            table.add_column(heading, justify="right" if number else "left", no_wrap=number, overflow="fold")
        for row in self._rows:
            table.add_row(*(Text(cell) for cell in astuple(row)))
        return table
