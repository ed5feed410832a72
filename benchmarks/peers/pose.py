"""Prints how exact pose solvers are, and how fast, on the same noisy points of a camera whose internals drift.

Run: OPENBLAS_NUM_THREADS=1 python -m benchmarks.peers.pose [--trials 2000] [--noise 0.5 1] [--seed 0]
Twelve points on two perpendicular faces, 100 to 600 mm away, filling 60 % of the picture's width; fx drifts by 40 px
about the nominal focal length, the principal point by 40 px about the image's centre, fy/fx by 2 %, in every view. The
peers are told the nominal focal length and the image's centre; ours is told no focal length, unless the row says so.
"Soft priors" are the recogniser's own, Cauchy: principal point within 38 px of the image's centre, which is near what
is drawn here, pixels square to 0.5 %, which is not; they are weighed against the noise, which ours is told. Ours with 4
degrees of freedom uses that the camera hangs upright; so does "pan alone" of a peer, which is its rotation projected on
that. Rows in brackets are no solvers but the Cramer-Rao bound: no unbiased solver does better with that knowledge.
The time of a peer is the median over its calls from Python; ours in batch is all trials at once, the closed-form start
included, divided by their number, median of the repeats. The wall's clock judges; on a busy machine it is unkind to
batches, which are interrupted where most short calls are not, so processor time stands beside it. Needs the extra
``peers``.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from benchmarks.peers import ours
from benchmarks.peers.bound import DRIFT_KNOWN, KNOWN, UNKNOWN, bound, sampled
from benchmarks.peers.needs import command, quiet, require, versions
from benchmarks.peers.rigs import RIGS
from benchmarks.peers.scenes import Scenes, draw
from benchmarks.peers.score import HEADER, Row, errors, line, told, verdict
from benchmarks.peers.solvers import ONE_VIEW, Found

FloatArray = npt.NDArray[np.float64]
MOVES = {1: (0.0,), 2: (0.0, 15.0), 3: (0.0, 15.0, -15.0)}
NOTHING: tuple[FloatArray, FloatArray] = np.full((3, 3), np.nan), np.full(3, np.nan)
WARM = 3
"""Calls that are not timed: libraries set themselves up in the first."""


def clocks() -> FloatArray:
    """Seconds by the wall's clock and of the processor."""
    return np.array([time.perf_counter(), time.process_time()])


def peer_row(name: str, scenes: Scenes, solve: Callable[[int], Found]) -> Row:
    """Run a peer scene by scene, each call timed."""
    for k in range(WARM):
        solve(k)
    found, took = [], []
    for k in range(len(scenes.pose)):
        before = clocks()
        pose = solve(k)
        took.append(clocks() - before)
        found.append(NOTHING if pose is None else pose)
    rotation, shift = (np.array(column) for column in zip(*found, strict=True))
    found_errors = errors(rotation, shift, scenes.rotation, scenes.pose[:, 1:])
    return Row(name, found_errors, *(1e6 * np.median(took, axis=0)))


def our_row(name: str, scenes: Scenes, solve: Callable[[Scenes], ours.Poses], repeats: int) -> Row:
    """Run ours on all scenes at once, several times after a first one that compiles."""
    rotation, shift = solve(scenes.first(WARM))
    took = []
    for _ in range(repeats):
        before = clocks()
        rotation, shift = solve(scenes)
        took.append((clocks() - before) / len(scenes.pose))
    found_errors = errors(rotation, shift, scenes.rotation, scenes.pose[:, 1:])
    return Row(name, found_errors, *(1e6 * np.median(took, axis=0)))


def bounds(rng: np.random.Generator, scenes: Scenes, what: str) -> Iterator[Row]:
    """The bound by degrees of freedom and knowledge."""
    for dof in (4, 6):
        for knowledge in (UNKNOWN, DRIFT_KNOWN, KNOWN):
            name = f"[bound, {what}, {dof} DOF, internals {knowledge}]"
            yield Row(name, sampled(rng, scenes, bound(scenes, dof, knowledge)), None)


def one_view(scenes: Scenes, slow: int, repeats: int) -> Iterator[Row]:
    """Ours from a single view."""
    few = scenes.first(slow)
    yield our_row("ours, batch, 4 DOF", scenes, lambda s: ours.batch_upright(s, None), repeats)
    yield our_row("ours, batch, 4 DOF, soft priors", scenes, lambda s: ours.batch_upright(s, ours.SOFT), repeats)
    yield our_row("ours, batch, 6 DOF", scenes, lambda s: ours.batch_general(s, None), repeats)
    yield our_row("ours, batch, 6 DOF, soft priors", scenes, lambda s: ours.batch_general(s, ours.SOFT), repeats)
    yield our_row("ours, one by one, 4 DOF, soft, told the nominal focal", scenes, ours.told_nominal, 1)
    name = f"ours, estimate_pose, {{}} DOF, no start (first {slow})"
    yield our_row(name.format(4), few, lambda s: ours.single(s, 4, None), 1)
    yield our_row(name.format(6), few.first(slow // 10), lambda s: ours.single(s, 6, None), 1)


def several_views(scenes: Scenes, views: int, repeats: int) -> Iterator[Row]:
    """Ours from views with known moves; all internals differ from view to view."""
    name = f"ours, batch, {views} views, {{}}"
    yield our_row(name.format("4 DOF"), scenes, lambda s: ours.batch_upright(s, None), repeats)
    yield our_row(name.format("4 DOF, soft priors"), scenes, lambda s: ours.batch_upright(s, ours.SOFT), repeats)
    yield our_row(name.format("6 DOF"), scenes, lambda s: ours.batch_general(s, None), repeats)


def show(rows: Iterator[Row]) -> list[Row]:
    """Print the rows as they come."""
    kept = []
    for row in rows:
        print(line(row), flush=True)
        kept.append(row)
    return kept


def compare(noise_px: float, options: argparse.Namespace) -> None:
    """One table."""
    print(f"\n{options.trials} trials, noise {noise_px:g} px\n{HEADER}")
    # The same first view in every table: as many draws in each.
    scenes = {v: draw(np.random.default_rng(options.seed), options.trials, noise_px, MOVES[v]) for v in MOVES}
    one = scenes[1]
    rng = np.random.default_rng([options.seed, 1])
    single = show(
        peer_row(name, one, lambda k, solve=solve: solve(one.points_mm[k], one.pixels[k, 0], one.nominal_px[k]))
        for name, solve in ONE_VIEW.items()
    )
    mine = show(one_view(one, min(options.slow, options.trials), options.repeats))
    show(bounds(rng, one, "1 view"))
    together: dict[int, list[Row]] = {}
    rigs: dict[int, list[Row]] = {}
    for v in (2, 3):
        many = scenes[v]
        print(f"{v} views 15 degrees apart, moves known, internals drift in each")
        rigs[v] = show(
            peer_row(
                f"{name}, {v} views",
                many,
                lambda k, solve=solve, s=many: solve(s.points_mm[k], s.pixels[k], s.nominal_px[k], s.cameras[k]),
            )
            for name, solve in RIGS.items()
        )
        together[v] = show(several_views(many, v, options.repeats))
        show(bounds(rng, many, f"{v} views"))
    print("\nOurs over the best peer's; asked: rotation and centre <= 0.33, time <= 1/10")
    print("One view against one view:")
    for row in mine[:2]:
        print(told(row, verdict(row, single)))
    for v in (2, 3):
        for title, others in (("the peers' one view", single), (f"the peers' rigs of {v} views", rigs[v])):
            print(f"{v} views with known moves against {title}:")
            for row in together[v][:2]:
                print(told(row, verdict(row, others)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.5, 1.0], metavar="PX")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--repeats", type=int, default=5, help="of our batches, for their time")
    parser.add_argument("--slow", type=int, default=200, help="scenes for ours without a start, 6 DOF a tenth of them")
    options = parser.parse_args()
    require()
    quiet()
    import cv2

    cv2.setNumThreads(1)
    print(versions())
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
        print("times are not those of one thread: set OPENBLAS_NUM_THREADS=1 before the start")
    for noise_px in options.noise:
        compare(noise_px, options)


if __name__ == "__main__":
    command(main)
