"""The demonstration: an architecture model rendered into an image grid, and a first view that fits most places."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recognition.geometry import wrap_deg
from recognition.modelbase import ModelBase
from recognition.modelbase_io import load_model_base
from recognition.steps import Answer
from rig.bench import BenchConfig, BenchFile
from rig.hal import RigPose
from sim_backends.internals_policy import ChangingInternals, FixedByZoom
from sim_backends.rendered_rig import RenderedRig
from sim_backends.simulate import draw_scene, rendered_rig, simulate

MODELS = "architecture"
JPEG_QUALITY = 93
CANDIDATES = 80
WRONG_PLACE_MM = 50.0
"""Neighbouring windows are farther apart than this."""

CLEAN_BENCH = {
    "schema": 1,
    "kind": "mock",
    "camera": {"internals": "change_every_view", "view_angle_deg": (15.0, 60.0)},
    "object": {"distance_mm": (60.0, 2000.0)},
    "detection": {"found": 0.97, "clutter": 5.0, "corner_sd_px": 0.5},
}
"""What anyone at such a bench would know: the model is on a table, the lens is no fisheye, the pictures are clean."""

Progress = Callable[[Sequence[RigPose]], Iterable[RigPose]]


@dataclass(frozen=True)
class Demonstration:
    """What is to be recognised, and from where.

    Attributes:
        grid: folder of the image grid.
        models: what the object may be.
        start: the first view.
        true_object: what was rendered; the recogniser is not told.
        in_view: what the first view shows, by part-class.
        rendered_by: knows where the camera really was.
    """

    grid: Path
    models: ModelBase
    start: RigPose
    true_object: str
    in_view: Counter[str]
    rendered_by: RenderedRig

    def bench(self) -> BenchConfig:
        """The bench that the grid is put on."""
        return BenchConfig(f"rendered {MODELS}", BenchFile.model_validate(CLEAN_BENCH), self.grid)

    def verdict(self, answer: Answer, last: RigPose) -> str:
        """One sentence: what was really there, and how far off the answer is; ``last`` is the last view's rig pose."""
        true = self.rendered_by.truth(last).camera_in_object
        if answer.object_id is None or answer.pose is None:
            return f"In truth it was {self.true_object}."
        if answer.object_id != self.true_object:
            return f"In truth it was {self.true_object}: the answer is wrong."
        off_mm = float(np.linalg.norm(answer.pose.centre_mm - true.centre_mm))
        off_deg = abs(wrap_deg(answer.pose.theta_deg - true.theta_deg))
        place = "" if off_mm < WRONG_PLACE_MM else ": the object is right, the place on it is wrong"
        return (
            f"In truth it was {self.true_object}, and the camera {off_mm:.1f} mm and {off_deg:.2f}° from there{place}."
        )

    @property
    def places_that_fit(self) -> int:
        """Places where the camera might be, at most: one for each part of the rarest class that the first view shows.

        It is before one of these, whatever else it shows; with one part in view it may be before any of them.
        """
        there = Counter(part.part_class for thing in self.models.objects for part in thing.parts)
        return min((there[name] for name in self.in_view), default=0)

    @property
    def first_view(self) -> str:
        """What the first view shows and how many places that fits, for people."""
        listed = ", ".join(f"{number} {name}" for name, number in self.in_view.items())
        most = "" if self.in_view.total() == 1 else "at most "
        return f"the first view shows {listed or 'no part'}: it fits {most}{self.places_that_fit} places"


def prepare(grid: Path, seed: int, progress: Progress = lambda poses: poses) -> Demonstration:
    """Render one of the models at an unknown place, by a camera whose internals change with every view.

    Args:
        grid: folder to write the image grid to, new or empty.
        seed: chooses the object, its place, its looks and the noise.
        progress: shows how far the rendering is while it hands the poses on.
    """
    models = load_model_base(MODELS)
    rng = np.random.default_rng([seed, 3])
    thing = models.objects[int(rng.integers(len(models.objects)))]
    internals = ChangingInternals(FixedByZoom(), f_sd=0.03, centre_sd_px=15.0)
    rig = rendered_rig(draw_scene(models, thing.id, seed), zooms=(0.0,), internals=internals, seed=seed)
    poses = list(rig.reachable())
    start, in_view = _most_ambiguous(rig, [poses[int(k)] for k in rng.permutation(len(poses))[:CANDIDATES]], models)
    simulate(rig, progress(poses), grid, quality=JPEG_QUALITY)
    return Demonstration(grid, models, start, thing.id, in_view, rig)


def _most_ambiguous(rig: RenderedRig, poses: Sequence[RigPose], models: ModelBase) -> tuple[RigPose, Counter[str]]:
    """The pose whose fully visible parts are fewest and of the commonest classes, so that most places fit."""
    common = Counter(part.part_class for thing in models.objects for part in thing.parts)
    best: tuple[float, RigPose, Counter[str]] | None = None
    for pose in poses:
        shown = [part for part in rig.parts(pose) if part.fully_in_frame and part.visible_fraction > 0.9]
        seen = Counter(part.part_class for part in shown)
        # A view without parts fits anything, but says nothing either: it would be no beginning.
        if not seen:
            continue
        told_bits = sum(number * (1.0 - np.log2(common[name] / common.total())) for name, number in seen.items())
        if best is None or told_bits < best[0]:
            best = (float(told_bits), pose, seen)
    return (poses[0], Counter()) if best is None else best[1:]
