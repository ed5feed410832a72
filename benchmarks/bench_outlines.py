"""How well the model-driven measurement tells true outlines from wrong ones, and moves them into place, on photographs.

Run from the repository: ``python -m benchmarks.bench_outlines [CASTLE] [EVERY]``; CASTLE is the castle's folder of
photographs, EVERY takes each EVERYth of them. Right outlines are the surveyed ones, jittered by up to 3 px; wrong ones
are the same shapes at random places, a third of a window aside, and shrunken copies inside the windows, as panes and
frames are. The log ratio of right to wrong ones (anywhere or aside) by score is what ``likelihood.edge_log_odds``
interpolates, where a wrong placement would put an outline; panes are told from windows by other means.
"""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recognition.detectors.edges import EdgeField, measure_outlines

DEFAULT = Path(__file__).resolve().parents[2] / "shared" / "data" / "castle"
JITTER_PX = 3.0
RADII_PX = (3.0, 6.0)
ASIDE = 1.0 / 3.0
SCORE_BINS = (0.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0)


def strict_parts(view: dict[str, Any]) -> list[dict[str, Any]]:
    """Parts fully in the picture whose four edges were all found by the survey."""
    return [p for p in view["parts"] if p["state"] == "visible" and p["edges_confirmed"] == 4 and p["fully_in_frame"]]


def random_places(shapes: np.ndarray, taken: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    moved = shapes - shapes.mean(axis=1, keepdims=True) + rng.uniform([150, 150], [1130, 810], (len(shapes), 1, 2))
    gap = np.linalg.norm(moved.mean(axis=1)[:, None] - taken.mean(axis=1)[None], axis=-1)
    return moved[gap.min(axis=1) > 25]


def inside_windows(shapes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    centre, size = shapes.mean(axis=1, keepdims=True), np.ptp(shapes, axis=1)[:, None]
    shift = rng.uniform(-0.2, 0.2, (len(shapes), 1, 2)) * size
    return (shapes - centre) * rng.uniform(0.3, 0.55, (len(shapes), 1, 1)) + centre + shift


def aside(shapes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    way = rng.choice([-1.0, 1.0], (len(shapes), 1, 1)) * np.eye(2)[rng.integers(2, size=len(shapes))][:, None]
    return shapes + ASIDE * np.ptp(shapes, axis=1)[:, None] * way


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT
    every = int(sys.argv[2]) if len(sys.argv) > 2 else 6
    rng = np.random.default_rng(0)
    scores: dict[str, list[float]] = defaultdict(list)
    errors: dict[tuple[str, float], list[float]] = defaultdict(list)
    prepare_s: list[float] = []
    with (folder / "truth.jsonl").open() as lines:
        views = [json.loads(line) for line in lines][::every]
    for view in views:
        parts = strict_parts(view)
        if not parts:
            continue
        image = cv2.imread(str(folder / view["file"]))
        start = time.perf_counter()
        edge_field = EdgeField(image)
        prepare_s.append(time.perf_counter() - start)
        truth = np.array([p["corners_px"] for p in parts])
        taken = np.array([p["corners_px"] for p in view["parts"]])
        shift = rng.uniform(-JITTER_PX, JITTER_PX, (len(truth), 1, 2))
        guess = truth + shift + rng.uniform(-0.5, 0.5, truth.shape)
        scores["true"] += list(measure_outlines(edge_field, guess).score)
        for _ in range(10):
            scores["random"] += list(measure_outlines(edge_field, random_places(truth, taken, rng)).score)
            scores["aside"] += list(measure_outlines(edge_field, aside(truth, rng)).score)
            scores["inside"] += list(measure_outlines(edge_field, inside_windows(truth, rng)).score)
        for radius in RADII_PX:
            near = truth + shift * radius / max(RADII_PX) + rng.uniform(-0.5, 0.5, truth.shape)
            found = measure_outlines(edge_field, near, radius).corners_px
            worst = np.linalg.norm(found - truth, axis=-1).max(axis=1)
            for part, error in zip(parts, worst, strict=True):
                for group in (part["cls"], "all wide" if view["zoom"] < 0.5 else "all tele"):
                    errors[(group, radius)].append(float(error))
    report(scores, errors)
    many = np.repeat(truth, 2000 // len(truth) + 1, axis=0)[:2000]
    start = time.perf_counter()
    measure_outlines(edge_field, many)
    took = time.perf_counter() - start
    print(f"prepare {1e3 * np.median(prepare_s):.1f} ms a picture; 2,000 outlines {1e3 * took:.0f} ms")


def report(scores: dict[str, list[float]], errors: dict[tuple[str, float], list[float]]) -> None:
    right = np.array(scores["true"])
    print(f"{len(right)} true outlines, median score {np.median(right):.2f}")
    for kind in ("random", "aside", "inside"):
        wrong = np.array(scores[kind])
        area = (right[:, None] > wrong[None]).mean()
        rates = [(right > np.quantile(wrong, 1 - share)).mean() for share in (0.1, 0.05, 0.01)]
        print(
            f"against {len(wrong)} {kind:6s}: area under ROC {area:.4f}; true found at 10, 5, 1 % false: "
            + ", ".join(f"{rate:.3f}" for rate in rates)
            + f"; 99 % of these score below {np.quantile(wrong, 0.99):.2f}"
        )
    print_odds(right, np.array(scores["random"] + scores["aside"]))
    print(f"{'look':34s} {'n':>4s} " + " ".join(f"{f'r={r:g}: <3 px, median':>24s}" for r in RADII_PX))
    for group in sorted({group for group, _ in errors}):
        columns = [np.array(errors[(group, radius)]) for radius in RADII_PX]
        cells = " ".join(f"{(c < 3).mean():14.2f} {np.median(c):9.2f}" for c in columns)
        print(f"{group:34s} {len(columns[0]):4d} {cells}")


def print_odds(right: np.ndarray, wrong: np.ndarray) -> None:
    """Log of the share of right outlines over that of wrong ones, bin by bin of the score; half a count in each."""
    counts = [np.histogram(np.clip(scores, 0.0, 1.0), SCORE_BINS)[0] + 0.5 for scores in (right, wrong)]
    odds = np.log(counts[0] / counts[0].sum()) - np.log(counts[1] / counts[1].sum())
    bins = ", ".join(f"{low:g}-{high:g}: {o:+.1f}" for (low, high), o in zip(pairwise(SCORE_BINS), odds, strict=True))
    print(f"log odds of a right outline by score, against random and aside: {bins}")


if __name__ == "__main__":
    main()
