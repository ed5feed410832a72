"""One recognition of an evaluation: running it to its end, and scoring its answer against the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from recognition.geometry import CameraPose
    from recognition.steps import Answer, Step
    from rig.run import Steps

RIGHT, WRONG, UNDECIDED = "right", "wrong", "undecided"
UNKNOWN = "unknown"
"""The outcome that says that it is none of the objects, and the posterior's key for that."""


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
        confidence: what the answer's posterior says of the object that it names, or of none where it says that it is
            none of them; ``None`` where it says neither.
        travel_s: seconds from the first view to the last, by the rig's speeds; 0 where nobody counted them.
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
    confidence: float | None = None
    travel_s: float = 0.0

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
        rss_mib=peak_memory_mib(),
        why=answer.why,
        log=[f"{step_line(step)} {notes[k] if notes else ''}".rstrip() for k, step in enumerate(steps)],
        confidence=answer.posterior.get(answer.object_id or (UNKNOWN if answer.outcome == UNKNOWN else "")),
    )


def peak_memory_mib() -> float:
    """The most memory that this process has had so far; not a number where the system does not tell."""
    try:
        import resource
    except ImportError:
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def step_line(step: Step) -> str:
    """A step in one line, for logs of failures; no times, so that equal runs have equal logs."""
    belief = step.belief
    ahead = ", ".join(f"{one.object_id} at {one.place} {one.probability:.3f}" for one in belief.leaders[:2])
    pose = step.frame.rig_pose
    return (
        f"view {step.index + 1} {step.frame.name} at ({pose.x_mm:.0f}, {pose.y_mm:.0f}, {pose.z_mm:.0f}) mm "
        f"{pose.theta_deg:.1f}° zoom {pose.zoom:g}: {len(step.parts)} parts, {belief.hypotheses_left} left, "
        f"{belief.entropy_bits:.2f} bits, unknown {belief.posterior['unknown']:.3f}, {ahead}; "
        f"{step.move.why if step.move else 'end'}"
    )
