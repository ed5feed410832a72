"""Prints how many parts the detector finds, how exactly, and how fast: on rendered views and on the castle photographs.

Run: python -m benchmarks.bench_detector [--every 1] [--views 40] [--data ../shared/data]
A part is found if all its corners lie within 3 px of those of one detection. Rendered parts count if they are fully
visible, at least 12 px wide and high, and 2 px from the border; castle parts if all four edges were
confirmed, they are fully in the frame and not near the vehicle. A false quadrilateral is one whose corners do not all
lie within 8 px of any part's (most are panes).
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from recognition.detectors import DEFAULT, load_detector
from recognition.modelbase_io import load_model_base
from recognition.parts import DetectedPart, Detector
from rig.hal import Image
from sim_backends.simulate import draw_scene, rendered_rig

FloatArray = npt.NDArray[np.float64]
FOUND_PX, FALSE_PX, LEAST_PX, BORDER_PX = 3.0, 8.0, 12.0, 2.0


@dataclass
class Tally:
    """Counts over the pictures of one kind."""

    errors_px: list[float] = field(default_factory=list)
    worst_px: list[float] = field(default_factory=list)
    class_right: list[bool] = field(default_factory=list)
    near: int = 0
    parts: int = 0

    def row(self, name: str) -> str:
        found = len(self.worst_px)
        error = f"{np.median(self.errors_px):6.2f} {np.median(self.worst_px):6.2f}" if found else "     -      -"
        right = f"{np.mean(self.class_right):6.3f}" if found else "     -"
        total = max(self.parts, 1)
        return f"{name:34s} {self.parts:6d} {found / total:7.3f} {self.near / total:7.3f} {error} {right}"


HEADER = f"{'':34s}  parts   found   <6 px  error  worst  class"


def tally(detected: list[DetectedPart], corners: FloatArray, part_class: str, *tallies: Tally) -> None:
    """Count one true part, given all detections of its picture."""
    alike = [part for part in detected if len(part.corners_px) == len(corners)]
    gaps = [np.linalg.norm(part.corners_px - corners, axis=1) for part in alike]
    best = int(np.argmin([gap.max() for gap in gaps])) if gaps else -1
    for count in tallies:
        count.parts += 1
        if best >= 0 and gaps[best].max() < 6.0:
            count.near += 1
        if best >= 0 and gaps[best].max() < FOUND_PX:
            count.errors_px.extend(gaps[best])
            count.worst_px.append(float(gaps[best].max()))
            count.class_right.append(alike[best].part_class == part_class)


def false_ones(detected: list[DetectedPart], truths: list[FloatArray]) -> int:
    """Detections that are near no part of the picture."""
    near = (
        any(len(t) == len(p.corners_px) and np.linalg.norm(p.corners_px - t, axis=1).max() < FALSE_PX for t in truths)
        for p in detected
    )
    return sum(not one for one in near)


def rank(detected: list[DetectedPart], corners: FloatArray) -> int:
    """How many detections come before the first one that is this part; a million if none is."""
    right = (np.linalg.norm(part.corners_px - corners, axis=1).max() < FOUND_PX for part in detected)
    return next((place for place, good in enumerate(right) if good), 1_000_000)


def timed(detector: Detector, image: Image) -> tuple[list[DetectedPart], float]:
    start = time.perf_counter()
    found = list(detector.detect(image))
    return found, 1e3 * (time.perf_counter() - start)


def rendered_pictures(name: str, cluttered: bool, views: int) -> Iterator[tuple[Image, list[tuple[str, FloatArray]]]]:
    """Pictures of every object of a shipped model base from random stations, with the parts that count."""
    base = load_model_base(name)
    rng = np.random.default_rng(11)
    for number, thing in enumerate(base.objects):
        rig = rendered_rig(draw_scene(base, thing.id, 100 + number, cluttered=cluttered), distances_mm=(200, 350, 600))
        poses = rig.reachable()
        for index in rng.choice(len(poses), max(1, views // len(base.objects)), replace=False):
            rig.move_to(poses[index])
            image = rig.capture().image
            limit = np.array([image.shape[1], image.shape[0]]) - 1 - BORDER_PX
            seen = [
                (part.part_class, part.corners_px)
                for part in rig.parts()
                if part.fully_in_frame and part.visible_fraction >= 0.999
                if np.ptp(part.corners_px, axis=0).min() >= LEAST_PX
                if (part.corners_px >= BORDER_PX).all() and (part.corners_px <= limit).all()
            ]
            yield image, seen


def bench_rendered(name: str, cluttered: bool, views: int) -> None:
    detector = load_detector(DEFAULT, load_model_base(name).classes)
    total, times, false, count = Tally(), [], 0, 0
    by_class: dict[str, Tally] = defaultdict(Tally)
    for image, parts in rendered_pictures(name, cluttered, views):
        found, milliseconds = timed(detector, image)
        times.append(milliseconds)
        false += false_ones(found, [corners for _, corners in parts])
        count += 1
        for part_class, corners in parts:
            tally(found, corners, part_class, total, by_class[part_class])
    print(f"\n{name}, {'cluttered' if cluttered else 'clean'}: {count} pictures, {np.median(times):.0f} ms median")
    print(HEADER)
    for part_class in sorted(by_class):
        print(by_class[part_class].row("  " + part_class))
    print(total.row("  all") + f"   false per picture {false / count:.1f}")


def bench_castle(data: Path, every: int) -> None:
    import cv2

    detector = load_detector(DEFAULT, load_model_base(data / "castle" / "modelbase.yaml").classes)
    tallies: dict[tuple[str, str], Tally] = defaultdict(Tally)
    times, false = [], defaultdict(list)
    hits: dict[str, list[int]] = defaultdict(list)
    ranked: dict[str, list[int]] = defaultdict(list)
    for line in (data / "castle" / "truth.jsonl").read_text().splitlines()[::every]:
        truth = json.loads(line)
        zoom = "wide" if truth["zoom"] < 0.5 else "tele"
        image = cv2.imread(str(data / "castle" / truth["file"]))
        found, milliseconds = timed(detector, np.asarray(image, dtype=np.uint8))
        times.append(milliseconds)
        false[zoom].append(false_ones(found, [np.array(p["corners_px"]) for p in truth["parts"]]))
        before = len(tallies[zoom, "all"].worst_px)
        for part in truth["parts"]:
            if part["edges_confirmed"] == 4 and part["fully_in_frame"] and part["state"] != "near_vehicle":
                corners = np.array(part["corners_px"])
                tally(found, corners, "DW4", tallies[zoom, part["cls"]], tallies[zoom, "all"])
                ranked[zoom].append(rank(found, corners))
        hits[zoom].append(len(tallies[zoom, "all"].worst_px) - before)
    print(f"\ncastle: {len(times)} pictures, {np.median(times):.0f} ms median")
    for zoom in ("wide", "tele"):
        one, three = (np.mean(np.array(hits[zoom]) >= least) for least in (1, 3))
        print(f"{zoom}: pictures with a part found {one:.2f}, with three {three:.2f};", end=" ")
        print(f"false quadrilaterals per picture {np.mean(false[zoom]):.0f}")
        ranks = np.array(ranked[zoom])
        print("found among the first", ", ".join(f"{n}: {np.mean(ranks < n):.2f}" for n in (20, 40, 60, 100, 200)))
        print(HEADER)
        for (at, look), counts in sorted(tallies.items()):
            if at == zoom:
                print(counts.row("  " + look))


def main() -> None:
    root = Path(__file__).resolve().parents[1]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="take every n-th castle photograph")
    parser.add_argument("--views", type=int, default=40, help="rendered pictures per model base")
    parser.add_argument("--data", type=Path, default=root.parent / "shared" / "data", help="folder of the photographs")
    arguments = parser.parse_args()
    for name, cluttered in (("architecture", False), ("campus", False), ("architecture", True)):
        bench_rendered(name, cluttered, arguments.views)
    if (arguments.data / "castle" / "truth.jsonl").is_file():
        bench_castle(arguments.data, arguments.every)
    else:
        print(f"\ncastle: skipped, {arguments.data} holds no photographs")


if __name__ == "__main__":
    main()
