"""Prints how accurate the pose estimator is, whether its covariance tells the truth, and how long it takes.

Run: python benchmarks/bench_pose.py [--trials 2000] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from recognition import Priors, estimate_pose
from recognition.geometry import Pose4, project, rotation_y
from recognition.jk_solve import solve_invariants
from recognition.varpro import refine_batch

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
SIZE = (1280, 960)
SOFT = Priors(image_size=SIZE)
Method = tuple[str, Callable[[FloatArray, Pose4, FloatArray], Pose4]]
KEYS = ("theta_deg", "x_mm", "y_mm", "z_mm")


def two_faces(rng: np.random.Generator) -> FloatArray:
    """Six points on each of two perpendicular faces that meet in a vertical edge, 120 mm deep and 90 mm high."""
    a, b = (np.column_stack([rng.uniform(5, 65, 6), rng.uniform(-45, 45, 6)]) for _ in range(2))
    zero = np.zeros(6)
    return np.vstack([np.column_stack([-a[:, 0], a[:, 1], zero]), np.column_stack([zero, b[:, 1], b[:, 0]])])


def draw(rng: np.random.Generator, zoomed: bool) -> tuple[FloatArray, Pose4, FloatArray]:
    """Points, pose and noisy pixels of one trial: principal point off by sd 40 px, aspect by 2 %, noise 0.5 px."""
    points = two_faces(rng)
    rotation = rotation_y(np.radians(theta := rng.uniform(20, 70)))
    distance = rng.uniform(100, 600)
    aim = np.array([*rng.uniform(-0.1, 0.1, 2) * distance, distance])
    # Distances count from the nearest point, which keeps everything in front of the camera at 100 mm, too.
    turned = points @ rotation.T
    aim[2] -= turned[:, 2].min()
    aim[:2] -= turned.mean(axis=0)[:2]
    seen = turned + aim
    span = float(np.ptp(seen[:, 0] / seen[:, 2]))
    f = 0.6 * SIZE[0] / span if zoomed else 800.0
    internals = np.array([f, f * (1 + 0.02 * rng.standard_normal()), *(0, 0)])
    internals[2:] = [639.5, 479.5] + 40 * rng.standard_normal(2)
    return points, Pose4.of(theta, aim), project(seen, internals) + 0.5 * rng.standard_normal((12, 2))


def centre(pose: FloatArray) -> FloatArray:
    """Camera centres ``(H, 3)`` in the object frame, of poses ``(H, 4)`` (radians, mm)."""
    return np.asarray(-np.einsum("hji,hj->hi", rotation_y(pose[:, 0]), pose[:, 1:]))


def table(pose: Pose4) -> FloatArray:
    return np.array([np.radians(pose.theta_deg), *pose.translation_mm])


def spread(values: FloatArray) -> str:
    low, mid, high, far = np.quantile(values, [0.1, 0.5, 0.9, 0.99])
    return f"median {mid:6.2f}   (10 % {low:5.2f}, 90 % {high:6.2f}, 99 % {far:7.2f})"


def errors(found: FloatArray, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation errors, degrees, and camera centre errors, mm; each ``(H,)``."""
    turn = np.degrees(np.abs((found[:, 0] - truth[:, 0] + np.pi) % (2 * np.pi) - np.pi))
    return turn, np.linalg.norm(centre(found) - centre(truth), axis=1)


def accuracy(rng: np.random.Generator, trials: int) -> None:
    print("Accuracy: 12 points on two perpendicular faces, 0.5 px, principal point sd 40 px, aspect 2 %, 100-600 mm")
    for zoomed, what in ((True, "zoomed so that the points fill 60 % of the width"), (False, "f = 800 px throughout")):
        drawn = [draw(rng, zoomed) for _ in range(trials)]
        truth = np.array([table(pose) for _, pose, _ in drawn])
        print(f"  {what}")
        methods: list[Method] = [
            ("no priors, no start", lambda p, _, x: upright(estimate_pose(p, x).pose)),
            ("soft priors, no start", lambda p, _, x: upright(estimate_pose(p, x, 4, SOFT).pose)),
            ("J/K, from the truth", lambda p, pose, x: upright(solve_invariants(p, x, pose).pose)),
        ]
        for name, method in methods:
            found = np.array([table(method(*one)) for one in drawn])
            turn, off = errors(found, truth)
            print(f"    {name:<22}  rotation deg {spread(turn)}")
            print(f"    {'':<22}  centre mm    {spread(off)}")


def upright(pose: object) -> Pose4:
    assert isinstance(pose, Pose4)
    return pose


WINDOW = np.array([[-15, -20, 0], [15, -20, 0], [15, 20, 0], [-15, 20, 0]], dtype=np.float64)
CORNER = np.vstack([WINDOW + np.array([-20, 0, 0]), WINDOW[:, [2, 1, 0]] + np.array([0, 0, 20])])


def observability(rng: np.random.Generator, trials: int) -> None:
    """Design §3's table: predicted sd (median) against the spread of the errors found (1.48 x median absolute).

    NEES/4 is the squared error in predicted sd, per degree of freedom; of a Gaussian: median 0.84, 90 % 1.94.
    """
    print("\nWhat the evidence fixes: 0.5 px corners, a 30 x 40 mm part at 150 mm, f = 800 px; sd predicted | found")
    arms = [
        ("1 view, soft priors, theta 10", WINDOW, 10.0, [0.0], False, SOFT),
        ("1 view, soft priors, theta 30", WINDOW, 30.0, [0.0], False, SOFT),
        ("2 views 15 deg apart, zoom free, soft", WINDOW, 10.0, [0.0, 15.0], False, SOFT),
        ("3 views, zoom locked, no priors", WINDOW, 10.0, [0.0, 15.0, -15.0], True, None),
        ("3 views, zoom locked, soft priors", WINDOW, 10.0, [0.0, 15.0, -15.0], True, SOFT),
        ("1 view, perpendicular faces, no priors", CORNER, 40.0, [0.0], False, None),
        ("1 view, perpendicular faces, soft", CORNER, 40.0, [0.0], False, SOFT),
    ]
    for name, points, theta, moves, locked, priors in arms:
        truth, arguments = scene(rng, trials, points, theta, moves, locked)
        found = refine_batch(*arguments, priors, iterations=40)
        error = found.placement - truth
        error[:, 0] = np.degrees(error[:, 0])
        covariance = found.covariance.copy()
        covariance[:, 0] *= 180 / np.pi
        covariance[:, :, 0] *= 180 / np.pi
        ok = found.valid
        predicted = np.median(np.sqrt(np.einsum("haa->ha", covariance[ok])), axis=0)
        seen = 1.4826 * np.median(np.abs(error[ok] - np.median(error[ok], axis=0)), axis=0)
        nees = np.einsum("ha,hab,hb->h", error[ok], np.linalg.inv(covariance[ok]), error[ok]) / 4
        cells = "  ".join(f"{key} {a:6.2f}|{b:6.2f}" for key, a, b in zip(KEYS, predicted, seen, strict=True))
        print(f"  {name:<40} {cells}   NEES/4 median {np.median(nees):4.2f} 90 % {np.quantile(nees, 0.9):5.2f}")


Arguments = tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, FloatArray, IntArray]


def scene(
    rng: np.random.Generator, trials: int, points: FloatArray, theta_deg: float, moves_deg: list[float], locked: bool
) -> tuple[FloatArray, Arguments]:
    """Placements, and what ``refine_batch`` takes, for noisy copies of one scene; the camera circles the part.

    Internals are drawn as the priors believe: principal point sd 3 % of the width, aspect sd 0.5 %.
    """
    truth = np.tile([np.radians(theta_deg), 5.0, -5.0, 150.0], (trials, 1))
    world = points @ rotation_y(np.radians(theta_deg)).T + truth[0, 1:]
    cameras, pixels = [], []
    internals = random_internals(rng, trials)
    for move in moves_deg:
        turn = rotation_y(np.radians(move))
        pivot = np.array([0.0, 0.0, 150.0])
        place = pivot - turn.T @ pivot
        cameras.append([np.radians(move), *place])
        seen = (world - place) @ turn.T
        clean = internals[:, None, :2] * (seen[:, :2] / seen[:, 2:]) + internals[:, None, 2:]
        pixels.append(clean + 0.5 * rng.standard_normal(clean.shape))
        internals = internals if locked else random_internals(rng, trials)
    v = len(moves_deg)
    n = len(points) * v
    view = np.broadcast_to(np.repeat(np.arange(v), len(points)), (trials, n))
    repeated = np.broadcast_to(np.tile(points, (v, 1)), (trials, n, 3))
    group = np.zeros(v, dtype=np.int64) if locked else np.arange(v)
    return truth, (truth, repeated, np.hstack(pixels), np.full((trials, n), 2.0), view, np.array(cameras), group)


def random_internals(rng: np.random.Generator, h: int) -> FloatArray:
    f = np.full(h, 800.0)
    off = 0.03 * SIZE[0] * rng.standard_normal((h, 2))
    return np.column_stack([f, f * np.exp(0.005 * rng.standard_normal(h)), 639.5 + off[:, 0], 479.5 + off[:, 1]])


def speed(rng: np.random.Generator) -> None:
    print("\nrefine_batch from starts 5 degrees and 10 mm off, wall time (median of 5)")
    for h, moves in ((100, [0.0]), (2000, [0.0]), (2000, [0.0, 15.0, -15.0])):
        truth, arguments = scene(rng, h, CORNER, 40.0, moves, locked=True)
        start = truth + np.array([0.09, 10, 10, 10]) * rng.standard_normal(truth.shape)
        for priors, name in ((None, "no priors"), (SOFT, "soft priors")):
            times = []
            for _ in range(5):
                before = time.perf_counter()
                refine_batch(start, *arguments[1:], priors)
                times.append(time.perf_counter() - before)
            corners = arguments[1].shape[1]
            print(f"  {h:5d} hypotheses x {corners:3d} corners, {name:<12} {1e3 * float(np.median(times)):7.1f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    accuracy(rng, max(options.trials // 4, 8))
    observability(rng, options.trials)
    speed(rng)


if __name__ == "__main__":
    main()
