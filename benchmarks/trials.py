"""What the benchmarks of whole recognitions share: running one and timing it, scoring it, keeping it, and the table."""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from recognition.geometry import CameraPose
    from recognition.steps import Answer, Step
    from rig.run import Steps

RIGHT, WRONG, UNDECIDED = "right", "wrong", "undecided"
PHASES = ("detect", "update", "plan")

Task = TypeVar("Task")


@dataclass(frozen=True)
class Trial:
    """One recognition, scored.

    Attributes:
        name: what it began from.
        kind: ``right``, ``wrong`` (an object was named, but it or its place is not the true one), or ``undecided``.
        near: whether the pose is within the tolerance.
        outcome: how the run ended.
        named: the object that the answer names.
        true_object: the object that was there.
        views: how many were taken.
        first_left: hypotheses left after the first view.
        error_mm, error_deg: of the camera's pose in the object frame, where an object was named.
        sd_mm, sd_deg: what the answer says of them (largest axis).
        seconds: detect, update, plan of each step.
        travel_mm: path of the gantry.
        rss_mib: peak memory of the process so far.
        why: the answer's sentence.
        log: one line a step.
    """

    name: str
    kind: str
    near: bool
    outcome: str
    named: str | None
    true_object: str
    views: int
    first_left: int
    error_mm: float
    error_deg: float
    sd_mm: float
    sd_deg: float
    seconds: list[list[float]]
    travel_mm: float
    rss_mib: float
    why: str
    log: list[str] = field(default_factory=list)

    @property
    def line(self) -> str:
        """The trial in one line."""
        took = sum(map(sum, self.seconds))
        pose = f"{self.error_mm:7.1f} mm {self.error_deg:6.2f}° (sd {self.sd_mm:5.1f} {self.sd_deg:5.2f})"
        return (
            f"{self.name:32s} {self.kind:9s} {self.outcome:10s} {self.named or '-':16s} {self.views:2d} views {pose} "
            f"{took:5.1f} s  {self.why}"
        )


def run(steps: Steps, watch: Callable[[Step], None] = lambda step: None) -> tuple[Answer, list[Step]]:
    """Run to the end; the steps come back without their pictures, so that many runs fit into memory."""
    from dataclasses import replace

    import numpy as np

    kept: list[Step] = []
    nothing = np.zeros((0, 0), dtype=np.uint8)
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            return end.value, kept
        watch(step)
        kept.append(replace(step, frame=replace(step.frame, image=nothing)))


def scored(
    name: str,
    answer: Answer,
    steps: Sequence[Step],
    true_object: str,
    true_camera: CameraPose,
    within_mm: float,
    within_deg: float,
    placed: bool = False,
    notes: Sequence[str] = (),
) -> Trial:
    """Score an answer against the truth at the last view.

    Args:
        name: of the trial.
        answer: the answer.
        steps: its views.
        true_object: what was there.
        true_camera: the camera in the object frame at the last view.
        within_mm: tolerance of the camera's centre.
        within_deg: tolerance of its pan.
        placed: whether the place is known to be right, whatever the pose; it is if the pose is within the tolerance.
        notes: one for each view, for the log.
    """
    import numpy as np

    from recognition.geometry import wrap_deg

    error_mm = error_deg = sd_mm = sd_deg = float("inf")
    if answer.pose is not None:
        error_mm = float(np.linalg.norm(answer.pose.centre_mm - true_camera.centre_mm))
        error_deg = abs(wrap_deg(answer.pose.theta_deg - true_camera.theta_deg))
        sd_mm = max(answer.pose_sd[key] for key in ("x_mm", "y_mm", "z_mm"))
        sd_deg = answer.pose_sd["theta_deg"]
    near = error_mm <= within_mm and error_deg <= within_deg
    if answer.outcome != "recognised":
        kind = UNDECIDED
    else:
        kind = RIGHT if answer.object_id == true_object and (near or placed) else WRONG
    return Trial(
        name=name,
        kind=kind,
        near=near,
        outcome=str(answer.outcome),
        named=answer.object_id,
        true_object=true_object,
        views=len(steps),
        first_left=steps[0].belief.hypotheses_left if steps else 0,
        error_mm=error_mm,
        error_deg=error_deg,
        sd_mm=sd_mm,
        sd_deg=sd_deg,
        seconds=[[step.seconds.detect, step.seconds.update, step.seconds.plan] for step in steps],
        travel_mm=answer.travel_mm,
        rss_mib=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        why=answer.why,
        log=[f"{step_line(step)} {notes[k] if notes else ''}".rstrip() for k, step in enumerate(steps)],
    )


def step_line(step: Step) -> str:
    """A step in one line, for logs of failures."""
    belief, took = step.belief, step.seconds
    ahead = ", ".join(f"{one.object_id} at {one.place} {one.probability:.3f}" for one in belief.leaders[:2])
    pose = step.frame.rig_pose
    return (
        f"view {step.index + 1} {step.frame.name} at ({pose.x_mm:.0f}, {pose.y_mm:.0f}, {pose.z_mm:.0f}) mm "
        f"{pose.theta_deg:.1f}° zoom {pose.zoom:g}: {len(step.parts)} parts, {belief.hypotheses_left} left, "
        f"{belief.entropy_bits:.2f} bits, unknown {belief.posterior['unknown']:.3f}, {ahead}; "
        f"{took.detect:.2f} + {took.update:.2f} + {took.plan:.2f} s; {step.move.why if step.move else 'end'}"
    )


def spread_out(work: Callable[[Task], Trial], tasks: Sequence[Task], jobs: int) -> Iterator[Trial]:
    """Do the tasks, in ``jobs`` processes of one thread each; in this process, with all its threads, if it is one."""
    if jobs <= 1:
        yield from map(work, tasks)
        return
    # Spawned processes read these before they import numpy; forked ones would come too late.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    with multiprocessing.get_context("spawn").Pool(jobs, one_thread) as pool:
        yield from pool.imap(work, tasks, chunksize=1)


def one_thread() -> None:
    """Keep OpenCV to one thread in this process."""
    import cv2

    cv2.setNumThreads(1)


def kept_trials(path: Path | None) -> dict[str, Trial]:
    """Trials that an earlier run kept, by name."""
    if path is None or not path.is_file():
        return {}
    lines = path.read_text().splitlines()
    return {trial.name: trial for trial in (Trial(**json.loads(line)) for line in lines if line.strip())}


def keep(path: Path | None, trial: Trial) -> None:
    """Add a trial to the file, so that a run that was cut off can go on."""
    if path is not None:
        with path.open("a") as file:
            file.write(json.dumps(asdict(trial)) + "\n")


def table(title: str, trials: Sequence[Trial]) -> str:
    """The figures of many trials, a row each with their spread."""
    import numpy as np

    if not trials:
        return f"{title}: no trials"
    counts = Counter(trial.kind for trial in trials)
    total = len(trials)
    shares = ", ".join(f"{kind} {counts[kind]} ({counts[kind] / total:.1%})" for kind in (RIGHT, WRONG, UNDECIDED))
    views = [trial.views for trial in trials]
    lines = [
        f"{title}: {total} runs: {shares}",
        f"  views               mean {np.mean(views):.2f}, {spread(views, '.0f')}",
        f"  left after view 1   {spread([t.first_left for t in trials], '.0f')}",
    ]
    good = [trial for trial in trials if trial.kind == RIGHT]
    if good:
        lines.append(f"  pose in tolerance   {sum(t.near for t in good)} of the {len(good)} right ones")
        lines.append(f"  pose error, mm      {spread([t.error_mm for t in good], '.1f')}  (right ones)")
        lines.append(f"  pose error, °       {spread([t.error_deg for t in good], '.3f')}")
        lines.append(f"  error / told sd     {spread([t.error_mm / t.sd_mm for t in good], '.2f')}  (mm, largest axis)")
    seconds = np.array([row for trial in trials for row in trial.seconds])
    for name, column in zip((*PHASES, "step"), (*seconds.T, seconds.sum(axis=1)), strict=True):
        lines.append(f"  {name + ', s':19s} {spread(column, '.3f')}")
    lines.append(f"  peak memory, MiB    {max(trial.rss_mib for trial in trials):.0f} (largest process)")
    return "\n".join(lines)


def spread(values: Iterable[float], form: str) -> str:
    """Median, 90th percentile and greatest."""
    import numpy as np

    values = np.array(list(values), dtype=float)
    parts = (("median", np.median(values)), ("p90", np.quantile(values, 0.9)), ("most", values.max()))
    return ", ".join(f"{name} {value:{form}}" for name, value in parts)
