"""Prints how SIFT + PnP localisation and ours find the place on the castle, from the same first photographs.

Run: python -m benchmarks.peers.castle [--starts 12] [--inliers 30] [--pose-sd-mm MM] [--jobs 2]
     [--cache FILE] [--keep FILE] [--scores FILE]
The peer: OpenCV's SIFT, a map of points triangulated from all other photographs, pycolmap's pose from the 30
photographs that match best. It is given the poses of those photographs in the object frame and their true internals;
its map holds one object, so that it cannot name a wrong one. Of the photograph to be located it knows nothing
("focal", "fx, fy, centre": what is refined), or the internals that photographs of the same zoom have ("given": a
calibrated camera). As a "rig" it gets the views that ours took, and their known moves; none of them is in the
map. "Other places": nor is any photograph from the same places, which the photographs of the grid share, pixel by pixel
(they were cut from 30).
Ours is given none of these photographs, but the surveyed windows, and chooses its views. Right: within 300 mm and 2
degrees of pan at the last view. Wrong: told, but not right; ours tells by its outcome, the peer if at least
``--inliers`` features agree (COLMAP's own limit). ``--starts N`` takes N starts spread evenly over the list; 80 are
all. Photographs: ``--data`` or RIG_REAL_DATA. Needs the extra ``peers``.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.bench_castle import OBJECT, WITHIN_DEG, WITHIN_MM, recognise_from, starts, truth
from benchmarks.peers.localise import ALL, FOCAL, GIVEN, Located, Matches, locate, matches
from benchmarks.peers.needs import command, quiet, require, versions
from benchmarks.peers.sift_map import (
    SAME_PLACE_M,
    Features,
    Observations,
    Reference,
    SiftMap,
    build,
    detect,
    triangulated,
)
from benchmarks.trials import RIGHT, UNDECIDED, WRONG, Trial, keep, kept_trials, spread_out
from recognition.geometry import CameraPose, wrap_deg
from rig.errors import ImageGridError

FloatArray = npt.NDArray[np.float64]
OURS = "ours"
MAPS = {False: "", True: ", other places"}
"""Whether the map leaves out photographs from the places of the views to be located, and what the row says of it."""
PEERS = {FOCAL: "focal refined", ALL: "fx, fy, centre refined", GIVEN: "internals given"}


@dataclass(frozen=True)
class Score:
    """One localisation: which method, from which start, how many views, how it ended, and how far off."""

    method: str
    start: str
    views: int
    kind: str
    error_mm: float
    error_deg: float
    inliers: int


def score(method: str, start: str, views: int, found: Located | None, true: CameraPose, least_inliers: int) -> Score:
    """Score a peer's answer; fewer than ``least_inliers`` are no answer."""
    if found is None:
        return Score(method, start, views, UNDECIDED, np.inf, np.inf, 0)
    off = float(np.linalg.norm(found.camera.centre_mm - true.centre_mm))
    turn = abs(wrap_deg(found.camera.theta_deg - true.theta_deg))
    kind = RIGHT if off <= WITHIN_MM and turn <= WITHIN_DEG else WRONG
    if found.inliers < least_inliers:
        kind = UNDECIDED
    return Score(method, start, views, kind, off, turn, found.inliers)


def of_ours(trial: Trial) -> Score:
    """The same of one of our runs."""
    return Score(OURS, trial.name, trial.views, trial.kind, trial.error_mm, trial.error_deg, 0)


def references(castle: Path) -> list[Reference]:
    """All photographs with their true poses and internals."""
    sizes = {}
    for text in (castle / "frames.jsonl").read_text().splitlines():
        frame = json.loads(text)
        sizes[frame["file"]] = (frame["width"], frame["height"])
    return [
        Reference(
            file,
            CameraPose(**line["camera_in_object"]),
            np.array([line[key] for key in ("fx", "fy", "u0", "v0")]),
            line["zoom"],
            sizes[file],
        )
        for file, line in truth(castle).items()
    ]


def sift_map(castle: Path, cache: Path | None) -> SiftMap:
    """The map of all photographs, made once if it is kept."""
    listed = references(castle)
    if cache is not None and cache.is_file():
        kept = np.load(cache)
        cut = np.cumsum(kept["counts"])[:-1]
        parts = np.split(kept["pixels"], cut), np.split(kept["descriptors"].astype(np.float32), cut)
        features = [Features(*one) for one in zip(*parts, strict=True)]
        return SiftMap(listed, features, Observations(*kept["seen"].T))
    features = [detect(castle / one.file) for one in listed]
    made = build(listed, features)
    if cache is not None:
        seen = made.seen
        np.savez(
            cache,
            counts=[len(f.pixels) for f in features],
            pixels=np.concatenate([f.pixels for f in features]),
            descriptors=np.concatenate([f.descriptors for f in features]),
            seen=np.column_stack([seen.image, seen.feature, seen.other_image, seen.other_feature]),
        )
    return made


def frames_of(trial: Trial) -> list[str]:
    """Files of the views that a run took, in order."""
    return [line.split(" ")[2] for line in trial.log]


def peers(sift: SiftMap, start: str, taken: Sequence[str], least_inliers: int) -> Iterator[Score]:
    """All the peer's ways, from the start alone and as a rig of the views that ours took."""
    number = {one.file: k for k, one in enumerate(sift.references)}
    for elsewhere, of_map in MAPS.items():
        for files, name in (((start,), "one view"), (tuple(dict.fromkeys(taken)), "rig")):
            which = [number[file] for file in files]
            own = [sift.references[k] for k in which]
            known = triangulated(sift, from_same_places(sift.references, own) if elsewhere else which)
            seen: list[Matches] = [matches(sift, known, sift.features[k]) for k in which]
            for how, what in PEERS.items():
                found = locate(seen, own, how)
                method = f"{name}, {what}{of_map}"
                yield score(method, start, len(files), found, own[-1].camera, least_inliers)


def from_same_places(listed: Sequence[Reference], own: Sequence[Reference]) -> list[int]:
    """Which photographs were taken where any of one's own were; their pictures overlap pixel by pixel."""
    places = [one.centre_m for one in own]
    return [k for k, one in enumerate(listed) if any(np.linalg.norm(one.centre_m - p) < SAME_PLACE_M for p in places)]


HEADER = (
    f"{'':58} {'right':>12} {'wrong':>12} {'undecided':>12}  {'median of the right':>19}  {'median of all':>17}  views"
)


def line(method: str, scores: Sequence[Score]) -> str:
    """A method's row: shares, median errors of the right ones and of all (no answer: infinite), mean views."""
    counts = Counter(one.kind for one in scores)
    cells = [f"{counts[kind]} ({counts[kind] / len(scores):.0%})" for kind in (RIGHT, WRONG, UNDECIDED)]
    good = [one for one in scores if one.kind == RIGHT]
    views = np.mean([one.views for one in scores])
    return (
        f"{method:58} {cells[0]:>12} {cells[1]:>12} {cells[2]:>12}  {_medians(good):>19}  {_medians(scores):>17}  "
        f"{views:5.2f}"
    )


def _medians(scores: Sequence[Score]) -> str:
    if not scores:
        return "-"
    off, turn = (np.quantile([getattr(s, k) for s in scores], 0.5, method="lower") for k in ("error_mm", "error_deg"))
    return f"{off:.0f} mm {turn:.2f}°"


def table(scores: Sequence[Score]) -> str:
    """One row a method, ours first."""
    lines = [HEADER]
    for method in dict.fromkeys(one.method for one in scores):
        mine = [one for one in scores if one.method == method]
        lines.append(line(method if method == OURS else f"SIFT + PnP, {method}", mine))
    return "\n".join(lines)


def spread_starts(files: Sequence[str], count: int) -> list[str]:
    """So many of the files, spread evenly over the list."""
    count = min(count, len(files))
    return [files[k * len(files) // count] for k in range(count)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=12, metavar="N", help="so many starts of the 80")
    parser.add_argument("--inliers", type=int, default=30, help="features that must agree for the peer to tell a place")
    parser.add_argument("--jobs", type=int, default=2, help="processes, for ours")
    parser.add_argument("--cache", type=Path, metavar="FILE.npz", help="keep the peer's features and matches here")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep our trials here, and skip those kept already")
    parser.add_argument("--scores", type=Path, metavar="FILE", help="write each score here, a JSON line each")
    parser.add_argument("--pose-sd-mm", type=float, metavar="MM", help="how sure ours is to be; as its bench says: 40")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("RIG_REAL_DATA", "../shared/data")))
    given = parser.parse_args()
    require(("pycolmap",))
    quiet()
    castle = (given.data / "castle").resolve()
    if not (castle / "truth.jsonl").is_file():
        raise ImageGridError("no castle photographs", where=str(castle), remedy="Pass --data or set RIG_REAL_DATA")
    files = spread_starts(starts(castle, others=False), given.starts)
    print(versions(), flush=True)
    known = kept_trials(given.keep)
    trials = {file: known[file] for file in files if file in known}
    options = {"policy": "information", "seed": 0, "max_views": 12, "pose_sd_mm": given.pose_sd_mm}
    work = partial(recognise_from, castle=castle, failures=None, options=options)
    for trial in spread_out(work, [file for file in files if file not in known], given.jobs):
        print(trial.line, flush=True)
        keep(given.keep, trial)
        trials[trial.name] = trial
    sift = sift_map(castle, given.cache)
    print(
        f"map: {len(sift.features)} photographs, {len(sift.seen.image) // 2} matches on their epipolar lines",
        flush=True,
    )
    scores = [of_ours(trials[file]) for file in files]
    for file in files:
        for one in peers(sift, file, frames_of(trials[file]), given.inliers):
            print(
                f"{file:28} {one.method:46} {one.views:2d} views {one.kind:9} {one.error_mm:8.0f} mm "
                f"{one.error_deg:6.2f}° {one.inliers} agree",
                flush=True,
            )
            scores.append(one)
    if given.scores is not None:
        given.scores.write_text("".join(json.dumps(asdict(one)) + "\n" for one in scores))
    print(f"\n{len(files)} starts on {OBJECT}; right is within {WITHIN_MM:g} mm and {WITHIN_DEG:g}°\n{table(scores)}")


if __name__ == "__main__":
    command(main)
