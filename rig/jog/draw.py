"""What the jog screen says, as styled text. Pure: values in, text out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.text import Text

from rig.devices import Clock
from rig.guard import GuardStatus, State
from rig.hal import AXES, AxisLimits, RigLimits
from rig.jog.jogger import STEPS, Message
from rig.jog.looking import Look
from rig.jog.places import UNITS
from rig.table import plain

STATE_STYLES: dict[State, str] = {
    State.IDLE: "bold black on green",
    State.MOVING: "bold black on cyan",
    State.JOGGING: "bold black on cyan",
    State.CAPTURING: "bold black on cyan",
    State.HELD: "bold black on yellow",
    State.UNHOMED: "bold black on yellow",
    State.DISCONNECTED: "bold white on red",
    State.ALARM: "bold white on red",
    State.STOPPED: "bold white on red",
}
HINTS: dict[State, str] = {
    State.UNHOMED: "H homes it",
    State.HELD: "R resumes",
    State.ALARM: "look, then U or H",
    State.STOPPED: "Shift-R releases",
    State.DISCONNECTED: "N connects again",
}
_MARKS = {"done": ("✓", "green"), "note": ("•", "cyan"), "refused": ("–", "yellow"), "fault": ("!", "bold red")}
_NAMES = {"x_mm": "X", "y_mm": "Y", "z_mm": "Z", "theta_deg": "pan", "zoom": "zoom"}
_KEYS = {"x_mm": "← →", "y_mm": "↑ ↓", "z_mm": "PgDn PgUp", "theta_deg": ", .", "zoom": "- +"}
_BLOCKS = "▁▂▃▄▅▆▇█"
_OLD_S = 2.0
_DIM, _KEY = "grey62", "bold bright_white"


def top(bench: str, status: GuardStatus, running: str, waiting: str) -> Text:
    """One line: the bench, the state, what is being done and what waits."""
    text = Text(f" {plain(bench)} ", style="bold", no_wrap=True, overflow="ellipsis")
    text.append(f" {status.state.value.upper()} ", STATE_STYLES[status.state])
    said = f" {running or HINTS.get(status.state, '')}"
    return text.append(plain(said) + (f", then {plain(waiting)}" if waiting else ""))


def axes(status: GuardStatus, limits: RigLimits, steps: Mapping[str, float], width: int, height: int) -> Text:
    """Two lines an axis: name, keys, place and step; and the place within the limits as a bar."""
    lines = []
    for axis in AXES:
        limit: AxisLimits = getattr(limits, axis)
        value = None if status.pose is None else float(getattr(status.pose, axis))
        unit = UNITS[axis]
        line = Text(f"{_NAMES[axis]:<5}", style="bold")
        if limit.lower >= limit.upper:
            lines += [line.append("fixed", _DIM), Text()]
            continue
        line.append(f"{_KEYS[axis]:<10}", _KEY)
        place = "not known" if value is None else f"{value:.3f}"
        line.append(f"{place:>9} {unit:<2}", "dim italic" if status.stale else "")
        line.append(f" ±{steps[unit]:g}", "cyan")
        lines += [line, bar(limit, value, steps[unit], width)]
    if height >= 3 * len(AXES):
        lines = [line for n in range(0, len(lines), 2) for line in (*lines[n : n + 2], Text())]
    return Text("\n").join(lines)


def bar(limit: AxisLimits, value: float | None, step: float, width: int) -> Text:
    """Travel from end to end, the present place in it, and in cyan how far one step reaches to either side."""
    low, high = f"{limit.lower:>5g} ", f" {limit.upper:<5g}"
    cells = max(3, width - len(low) - len(high))
    text = Text(low, style=_DIM, no_wrap=True)
    if value is None:
        return text.append("╌" * cells + high, _DIM)

    def cell(at: float) -> int:
        share = (at - limit.lower) / (limit.upper - limit.lower)
        return min(cells - 1, max(0, round(share * (cells - 1))))

    here, first, last = cell(value), cell(value - step), cell(value + step)
    outside = not limit.lower - 1e-6 <= value <= limit.upper + 1e-6
    no_step = outside or value - step < limit.lower or value + step > limit.upper
    for n in range(cells):
        if n == here:
            text.append("●", "bold red" if outside else "bold yellow" if no_step else "bold green")
        else:
            text.append("━", "cyan" if first <= n <= last else "grey37")
    return text.append(high, _DIM)


def troubles(status: GuardStatus, running: str) -> Text:
    """What is wrong; empty where nothing is. While something runs only the devices that move are read."""
    lines = [Text(f"! {plain(trouble)}", style="bold red") for trouble in status.troubles]
    if status.stale and status.rig is not None and not running:
        lines.append(Text(f"! the status is {status.age_s:.1f} s old", style="bold red"))
    return Text("\n").join(lines)


def messages(told: Sequence[Message], width: int, height: int) -> Text:
    """The last messages, as many as there is room for, each wrapped; the newest at the bottom."""
    lines: list[Text] = []
    for message in reversed(told):
        mark, style = _MARKS[message.kind]
        times = f"  (×{message.times})" if message.times > 1 else ""
        wrapped = _wrapped(message.text + times, max(10, width - 2))
        body = style if message.kind == "fault" else ""
        block = [Text.assemble((f"{mark if n == 0 else ' '} ", style), (line, body)) for n, line in enumerate(wrapped)]
        lines = [*block, *lines]
        if len(lines) >= height:
            break
    return Text("\n").join(lines[-max(1, height) :])


def look(seen: Look | None, clock: Clock, kept: str, width: int) -> Text:
    """Below the picture: sharpness with its course, exposure, and what has been kept."""
    if seen is None:
        return Text(kept, style=_DIM)
    room = max(0, min(len(seen.course), width - 18))
    first = Text.assemble("sharp ", (f"{seen.sharpness:6.1f} % ", "bold"), (spark(seen.course[-room:]), "cyan"))
    verdict = seen.exposure.verdict
    second = Text.assemble(
        "light ",
        (f"{100 * seen.exposure.mean:6.1f} % ", "bold"),
        (verdict, "green" if verdict == "good" else "bold yellow"),
    )
    third = Text(f"black {100 * seen.exposure.dark:6.1f} %  clipped {100 * seen.exposure.bright:.1f} %", _DIM)
    age_s = max(0.0, clock.now_s() - seen.exposed_at_s)
    fourth = Text(f"{kept}  newest {_age(age_s)}", _DIM if age_s < _OLD_S else "yellow")
    return Text("\n").join([first, second, third, fourth])


def spark(values: Sequence[float]) -> str:
    """A course as blocks, from the smallest value to the largest."""
    if not values:
        return ""
    low, high = min(values), max(values)
    scale = (len(_BLOCKS) - 1) / (high - low) if high > low else 0.0
    return "".join(_BLOCKS[round((value - low) * scale)] for value in values)


def keys(steps: Mapping[str, float], preview: bool) -> Text:
    """The keys that are not shown beside the axes; of the step sizes the present ones stand out."""
    sizes = Text("step  ", _DIM)
    number = 1
    for unit, offered in STEPS.items():
        for size in offered:
            sizes.append(str(number), _KEY).append(f" {size:g}", "bold cyan" if steps[unit] == size else _DIM).append(
                " "
            )
            number += 1
        sizes.append(f"{unit or 'zoom'}   ", _DIM)
    rows = [
        "G go to  C capture  M mark  L marks  H home  F reference  U unlock  B reboot",
        "N connect  ^C hold  R resume  Shift-R release  Q quit" + ("  P preview" if preview else ""),
    ]
    lines = [Text("  ").join(_key(entry) for entry in row.split("  ")) for row in rows]
    lines[-1].append("  ").append(" SPACE: STOP ", "bold white on red")
    return Text("\n").join([sizes, *lines])


def _key(entry: str) -> Text:
    key, _, what = entry.partition(" ")
    return Text.assemble((key, _KEY), (f" {what}", _DIM))


def _age(seconds: float) -> str:
    return f"{seconds:.1f} s old" if seconds < 100 else "old"


def _wrapped(text: str, width: int) -> list[str]:
    import textwrap

    # An address must stay whole.
    return textwrap.wrap(text, width, break_on_hyphens=False) or [""]
