"""Stages a trial: everything in it is drawn from its seed, whatever the policy, so that policies meet the same trials.

The object, its place in the rig frame, the start among the reachable views that show at least one whole part, and the
noise of every view. The recogniser is told what a bench file would tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache

import numpy as np

from recognition.geometry import Mount
from recognition.modelbase import ModelBase
from recognition.parts import Detector
from recognition.rates import DetectionRates
from recognition.settings import BenchBounds, Effort, RecogniserSettings
from rig.errors import RigError
from rig.evaluate.plan import Task
from rig.evaluate.plan_file import RowEntry
from rig.hal import RigLimits, RigPose
from sim_backends import turntable
from sim_backends.corner_noise import CornerNoise
from sim_backends.corner_rig import CornerRig
from sim_backends.rendered_rig import RenderedRig
from sim_backends.renderer import DEFAULT_SIZE
from sim_backends.scene import Scene
from sim_backends.scenes.stranger import stranger
from sim_backends.simulate import draw_scene
from sim_backends.viewpoints import limits_around, viewing_poses

DISTANCES_MM, ZOOMS = (150.0, 300.0), (0.0, 1.0)
_RANGE_MM, _VIEW_ANGLE_DEG = (60.0, 2000.0), (15.0, 60.0)
"""What anyone at such a bench would know: the model is on a table, the lens is no fisheye."""
_WHOLE = 0.99
_OF_PICTURES = DetectionRates(found=0.97, clutter=5.0, corner_sd_px=0.5)
_MOST_FOUND, _LEAST_CLUTTER, _LEAST_SD_PX = 0.97, 0.2, 0.5
_USUAL_PARTS = 5.0
"""Parts that a close-up shows, more or less."""


@dataclass(frozen=True)
class Stage:
    """A trial that can begin.

    Attributes:
        rig: at its first view; knows the truth.
        base: what the object may be.
        true_object: what it is; in_base: whether the base holds it.
        settings: of the recogniser.
        detector: in place of the one that looks at pictures; ``None``: that one.
    """

    rig: RenderedRig
    base: ModelBase = field(repr=False)
    true_object: str
    in_base: bool
    settings: RecogniserSettings
    detector: Detector | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Bench:
    """Where a bench's camera can be before a scene: poses, limits, mount, and the distances that may occur, mm."""

    scene: Scene
    poses: Sequence[RigPose] = field(repr=False)
    limits: RigLimits
    mount: Mount
    range_mm: tuple[float, float]


def close_up(base: ModelBase, scene: Scene, seed: int) -> Bench:
    """All axes move, around an object much larger than the field of view."""
    poses = viewing_poses(scene.object_model, scene.object_in_rig, DISTANCES_MM, zooms=ZOOMS)
    return Bench(scene, poses, limits_around(poses), Mount(), _RANGE_MM)


def one_axis(base: ModelBase, scene: Scene, seed: int) -> Bench:
    """Only the rotary moves, before an object that is wholly in view."""
    away = turntable.distance_mm(base.objects)
    standing = replace(scene, object_in_rig=turntable.placed(scene.object_model, np.random.default_rng([seed, 9])))
    return Bench(standing, turntable.poses(), turntable.limits(), Mount(z_mm=-away), (away / 3.0, 2.0 * away))


BENCHES = {"close_up": close_up, "one_axis": one_axis}


def staged(task: Task) -> Stage:
    """Draw a trial of a row that is no experiment.

    Raises:
        RigError: no reachable view shows a whole part.
    """
    conditions, base = task.row.conditions, model_base(task.row.source)
    rng = np.random.default_rng([task.seed, 7])
    thing = base.objects[int(rng.integers(len(base.objects)))]
    scene = draw_scene(base, thing.id, task.seed, cluttered=conditions.clutter)
    if conditions.object == "stranger":
        scene = replace(scene, object_model=stranger(thing, np.random.default_rng([task.seed, 8])))
    bench = BENCHES[conditions.bench](base, scene, task.seed)
    rig = rig_on(bench, base, conditions, task.seed)
    rig.move_to(first_view(rig, rng))
    return Stage(
        rig,
        base,
        scene.object_model.id,
        conditions.object == "in_base",
        settings_for(task, bench.range_mm, bench.mount),
        rig if isinstance(rig, CornerRig) else None,
    )


@cache
def model_base(name: str) -> ModelBase:
    """A model base, read once in each process."""
    from recognition.modelbase_io import load_model_base

    return load_model_base(name)


def noise_of(conditions: RowEntry) -> CornerNoise:
    """The noise of simulated corners; of pictures only its internals count."""
    noise = {} if conditions.noise is None else conditions.noise.model_dump()
    return CornerNoise(**noise, **conditions.internals.model_dump())


def rig_on(bench: Bench, base: ModelBase, conditions: RowEntry, seed: int) -> RenderedRig:
    """The rig of a bench, by simulated corners or by pictures."""
    noise = noise_of(conditions)
    if conditions.views == "corners":
        return CornerRig(bench.scene, bench.limits, bench.poses, base.classes, noise, seed=seed, mount=bench.mount)
    inner = noise.internals(DEFAULT_SIZE)
    return RenderedRig(bench.scene, bench.limits, bench.poses, internals=inner, seed=seed, mount=bench.mount)


def first_view(rig: RenderedRig, rng: np.random.Generator) -> RigPose:
    """A reachable pose that shows at least one whole part, all of them alike probable.

    Raises:
        RigError: there is none.
    """
    poses = rig.reachable()
    for k in rng.permutation(len(poses)):
        pose = poses[int(k)]
        if any(part.fully_in_frame and part.visible_fraction >= _WHOLE for part in rig.parts(pose)):
            return pose
    raise RigError(f"no view of {rig.scene.object_model.id} shows a whole part. Choose another bench or model base")


def settings_for(task: Task, range_mm: tuple[float, float], mount: Mount) -> RecogniserSettings:
    """What the recogniser is asked and told."""
    conditions = task.row.conditions
    told, noise = conditions.told, noise_of(conditions)
    rates = rates_for(conditions)
    effort = Effort.for_clutter(rates.clutter)
    if conditions.views == "corners":
        # There is no picture to look at again.
        effort = replace(effort, second_looks=0)
    bounds = BenchBounds(
        *range_mm,
        *_VIEW_ANGLE_DEG,
        motion_sd_mm=noise.motion_sd_mm if told.motion_sd_mm is None else told.motion_sd_mm,
        motion_sd_deg=noise.motion_theta_sd_deg if told.motion_theta_sd_deg is None else told.motion_theta_sd_deg,
    )
    asked = conditions.recogniser.model_dump()
    return RecogniserSettings(
        **asked, policy=task.row.policy, seed=task.seed, bounds=bounds, mount=mount, rates=rates, effort=effort
    )


def rates_for(conditions: RowEntry) -> DetectionRates:
    """How the recogniser is told that the detector behaves: as the conditions say, or else as it does."""
    rates = _OF_PICTURES
    if conditions.views == "corners":
        noise = noise_of(conditions)
        rates = DetectionRates(
            found=min(_MOST_FOUND, max(0.01, 1.0 - noise.missed)),
            clutter=max(_LEAST_CLUTTER, noise.false_parts * _USUAL_PARTS),
            corner_sd_px=max(_LEAST_SD_PX, noise.corner_sd_px),
        )
    told = {name: value for name, value in conditions.told.model_dump().items() if name in asdict(rates)}
    return replace(rates, **{name: value for name, value in told.items() if value is not None})
