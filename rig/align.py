"""From a scan to the mount's entry in a bench file: reads the pictures, estimates, and words the result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from recognition.alignment.advice import Y_IS_SILENT, advice
from recognition.alignment.estimate import MOTION_SD_DEG, MOTION_SD_MM, MOUNT, MountEstimate, estimate_mount
from recognition.alignment.moves import Moves
from recognition.alignment.tracks import find_features, follow
from recognition.geometry import Mount
from rig.bench import BenchConfig
from rig.errors import InputError
from rig.imagegrid import GridFrame, ImageGrid

MOST_VIEWS = 80
"""More views than this hardly make the mount surer, but the work grows with them."""

_DIGITS = 4

Progress = Callable[[Sequence[GridFrame]], Iterable[GridFrame]]


@dataclass(frozen=True)
class Alignment:
    """What `rig align` found.

    Attributes:
        estimate: of the mount; zoom: at which zoom setting; views: how many pictures of it were used.
        notices: what a user should know of the scan, whatever came out.
        mount: for the bench file: what was determined, and of the rest what the bench says.
    """

    estimate: MountEstimate = field(repr=False)
    zoom: float
    views: int
    notices: tuple[str, ...]
    mount: Mount

    @property
    def found_anything(self) -> bool:
        """Whether the scan determined at least one value."""
        return len(self.estimate.open) < len(MOUNT)


def align(
    grid: ImageGrid,
    bench: BenchConfig,
    *,
    zoom: float | None = None,
    most_views: int = MOST_VIEWS,
    progress: Progress = lambda frames: frames,
) -> Alignment:
    """Estimate the mount from a scan of any fixed, textured target.

    Args:
        grid: the scan.
        bench: tells scale and squareness of the axes, how far moves may be trusted, and the values to keep.
        zoom: use the pictures of this setting; ``None``: of the one with the most pictures.
        most_views: use at most so many pictures, evenly taken from all.
        progress: shows how far the reading is while it hands the frames on.

    Raises:
        InputError: no picture was taken at that zoom, or the camera's internals are said to change with every view.
        DegenerateGeometryError: nothing can be estimated; tells why and what to scan instead.
    """
    _refuse_changing(grid, bench)
    zoom, frames = _of_one_zoom(grid, zoom)
    left_out = len(frames) - most_views
    frames = [frames[int(k)] for k in np.linspace(0, len(frames) - 1, min(most_views, len(frames))).round()]
    moves = Moves.of([frame.pose for frame in frames], bench.mount)
    features, sizes = [], set()
    for frame in progress(frames):
        image = grid.load(frame)
        sizes.add((image.shape[1], image.shape[0]))
        features.append(find_features(image))
    if len(sizes) > 1:
        raise InputError("the pictures are of different sizes", where=str(grid.folder), remedy="Scan with one size")
    trust = bench.file.motion
    estimate = estimate_mount(
        follow(features, moves),
        moves,
        sizes.pop(),
        motion_sd_mm=max(trust.sd_mm, MOTION_SD_MM),
        motion_sd_deg=max(trust.sd_deg, MOTION_SD_DEG),
    )
    return Alignment(estimate, zoom, len(frames), _notices(left_out, most_views), _merged(bench.mount, estimate))


def _of_one_zoom(grid: ImageGrid, zoom: float | None) -> tuple[float, list[GridFrame]]:
    count = Counter(round(frame.pose.zoom, 6) for frame in grid.frames)
    chosen = round(zoom, 6) if zoom is not None else max(count, key=lambda z: (count[z], -z))
    frames = [frame for frame in grid.frames if round(frame.pose.zoom, 6) == chosen]
    if not frames:
        there = ", ".join(f"{z:g}" for z in sorted(count))
        raise InputError(f"no picture was taken at zoom {chosen:g}", where="--zoom", remedy=f"The scan has {there}")
    return chosen, frames


def _refuse_changing(grid: ImageGrid, bench: BenchConfig) -> None:
    for told, where in ((grid.info.internals, str(grid.folder)), (bench.file.camera.internals, bench.name)):
        if told == "change_every_view":
            raise InputError(
                "says that the camera's internals change with every view; aligning needs the same in all",
                where=where,
                remedy="Lock zoom and focus, scan again, and say `fixed_by_zoom`",
            )


def _notices(left_out: int, most_views: int) -> tuple[str, ...]:
    if left_out <= 0:
        return ()
    return (f"{most_views} of {most_views + left_out} pictures were used; --views takes more",)


def _merged(before: Mount, estimate: MountEstimate) -> Mount:
    found = {name: round(v, _DIGITS) for name, v in estimate.values.items() if name not in estimate.open}
    return replace(before, **found)


def entry_of(mount: Mount) -> dict[str, float]:
    """The mount's entry in a bench file."""
    return {name: getattr(mount, name) for name in ("x_mm", "y_mm", "z_mm", *MOUNT[2:])}


def snippet(mount: Mount) -> str:
    """The line for a bench file."""
    return "mount: {" + ", ".join(f"{name}: {value:.10g}" for name, value in entry_of(mount).items()) + "}"


def report(found: Alignment) -> str:
    """What was found, for a person."""
    e = found.estimate
    lines = [
        f"{found.views} views at zoom {found.zoom:g}: {e.points:,} points of the target seen {e.observations:,} times, "
        f"fitted to {e.residual_px:.2f} px; {e.explained:.0%} of the matches agree. "
        f"Moves are trusted to {e.off.mm:.2g} mm and {e.off.deg:.2g} degrees.",
        "",
        f"{'':14}{'estimate':>10}{'sd':>10}",
    ]
    for name in MOUNT:
        value = f"{'not seen':>10}" if name in e.open else f"{e.values[name]:10.3f}{e.sd[name]:10.3f}"
        lines.append(f"{name:14}{value}")
    lines += ["", "For the bench file:" if found.found_anything else "Nothing of the mount was determined."]
    if found.found_anything:
        lines.append(f"  {snippet(found.mount)}")
    lines += ["", *(f"- {text}." for text in (*advice(e), Y_IS_SILENT, *found.notices))]
    return "\n".join(lines)


def as_json(found: Alignment) -> Mapping[str, Any]:
    """What was found, for a program."""
    e = found.estimate
    return {
        "zoom": found.zoom,
        "views": found.views,
        "points": e.points,
        "observations": e.observations,
        "agreeing": round(e.explained, 4),
        "motion": {"sd_mm": round(e.off.mm, 4), "sd_deg": round(e.off.deg, 4)},
        "residual_px": round(e.residual_px, 4),
        "estimate": {name: round(value, 6) for name, value in e.values.items()},
        "sd": {name: round(value, 6) for name, value in e.sd.items()},
        "covariance": [[float(f"{v:.6g}") for v in row] for row in e.covariance],
        "unobservable": {**{name: list(against) for name, against in e.open.items()}, "y_mm": []},
        "advice": [*advice(e), Y_IS_SILENT, *found.notices],
        "mount": entry_of(found.mount),
    }


def write_bench(bench: Path, mount: Mount, out: Path) -> None:
    """Write a copy of a bench file with another mount; the rest, comments too, stays as it is.

    Raises:
        InputError: there is a file at ``out`` already, or it cannot be written.
    """
    from rig.benchedit import with_mount

    text = with_mount(bench, entry_of(mount))
    try:
        with out.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise InputError("is there already", where=str(out), remedy="Name a new file; nothing is overwritten") from None
    except OSError as failure:
        why = f"cannot be written: {failure.strerror or failure}"
        raise InputError(why, where=str(out), remedy="Name another place") from failure
