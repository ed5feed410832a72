"""The paper's loop: what the first view leaves, what a view eliminates, and how an empty view is undone."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.paper.perfect import SETTINGS, BlankRig, TrueDetector, architecture, blank_rig
from recognition import paper_mode
from recognition.expected import within_gates
from recognition.geometry import camera_in_rig
from recognition.modelbase import ModelBase
from recognition.paper_belief import Interpretations, eliminate, interpret, part_area
from recognition.paper_mode import recognise_as_paper
from recognition.parts import DetectedPart
from recognition.recogniser import recognise
from recognition.seen import Seen, see
from recognition.steps import Answer, Outcome, Step
from recognition.tracking import World, make_world
from rig.hal import RigPose


@pytest.fixture(scope="module")
def base() -> ModelBase:
    return architecture()


@pytest.fixture(scope="module")
def world(base: ModelBase) -> World:
    return make_world(base, SETTINGS.bounds, SETTINGS.rates)


def run(steps: Generator[Step, None, Answer]) -> tuple[list[Step], Answer]:
    taken = []
    while True:
        try:
            taken.append(next(steps))
        except StopIteration as end:
            return taken, end.value


def look(world: World, rig: BlankRig, pose: RigPose | None = None) -> Seen:
    if pose is not None:
        rig.move_to(pose)
    parts = TrueDetector(rig).detect(rig.capture().image)
    corners = world.layout.corners_mm.shape[1]
    return see(parts, camera_in_rig(rig.pose), rig.size, 0, 0.0, world.layout.class_names, corners)


def true_row(world: World, rig: BlankRig, left: Interpretations) -> int:
    """The row that places the object where it stands, or -1."""
    thing = [o.id for o in world.layout.base.objects].index(rig.scene.object_model.id)
    away = left.hypotheses.placement[:, 1:] - rig.scene.object_in_rig.translation_mm
    off = np.linalg.norm(away, axis=1) + 1e6 * (left.hypotheses.object_of != thing)
    return int(off.argmin()) if len(off) and off.min() < 60 else -1


def test_the_first_view_leaves_every_part_of_its_class(base: ModelBase) -> None:
    rig = blank_rig(base, "DS", 4)
    step = next(recognise(rig, base, SETTINGS, detector=TrueDetector(rig)))
    assert step.belief.hypotheses_left == 374


def test_an_object_is_as_probable_as_the_area_of_its_parts_of_that_class(base: ModelBase) -> None:
    rig = blank_rig(base, "DS", 4)
    step = next(recognise_as_paper(rig, base, SETTINGS, detector=TrueDetector(rig)))
    area = {o.id: sum(p.part_class == "DW4" for p in o.parts) / 374 for o in base.objects}
    assert step.belief.posterior == pytest.approx({**area, "unknown": 0.0})


def test_prior_is_the_share_of_area(world: World) -> None:
    door = world.layout.class_names.index("DW8HANDLE")
    window = world.layout.class_names.index("DW4")
    area = part_area(world.layout)
    assert area[world.layout.part_class == window] == pytest.approx(30 * 40)
    handles = area[world.layout.part_class == door]
    assert np.all((handles > 0.8 * 36 * 64) & (handles < 36 * 64))


@pytest.mark.parametrize("seed", range(10))
def test_a_perfect_detector_ends_at_the_right_place(base: ModelBase, seed: int) -> None:
    rig = blank_rig(base, base.objects[seed % 3].id, seed)
    steps, answer = run(recognise_as_paper(rig, base, SETTINGS, detector=TrueDetector(rig)))
    assert answer.outcome is Outcome.RECOGNISED
    assert answer.object_id == rig.scene.object_model.id
    assert answer.pose is not None
    truth = rig.truth().camera_in_object
    assert np.linalg.norm(answer.pose.centre_mm - truth.centre_mm) < 60
    assert all(step.move.why for step in steps if step.move)


@pytest.mark.parametrize(("asked_mm", "sure"), [(0.001, False), (1e4, True)])
def test_no_view_is_taken_for_a_surer_pose_but_the_answer_tells(base: ModelBase, asked_mm: float, sure: bool) -> None:
    rig = blank_rig(base, "LH", 3)
    plain, _ = run(recognise_as_paper(rig, base, SETTINGS, detector=TrueDetector(rig)))
    rig = blank_rig(base, "LH", 3)
    steps, answer = run(
        recognise_as_paper(rig, base, replace(SETTINGS, pose_sd_mm=asked_mm), detector=TrueDetector(rig))
    )
    assert len(steps) == len(plain)
    assert (answer.outcome, answer.pose_sure) == (Outcome.RECOGNISED, sure)
    assert ("no view for the pose's sake" in answer.why) != sure


def test_what_is_eliminated_never_comes_back(base: ModelBase, monkeypatch: pytest.MonkeyPatch) -> None:
    left = []

    def noted(world: World, before: Interpretations, views: list[Seen]) -> Interpretations:
        after = eliminate(world, before, views)
        left.append((set(before.part.tolist()), set(after.part.tolist())))
        return after

    monkeypatch.setattr(paper_mode, "eliminate", noted)
    rig = blank_rig(base, "LH", 0)
    run(recognise_as_paper(rig, base, SETTINGS, detector=TrueDetector(rig)))
    assert left
    assert all(after < before for before, after in left)


def test_the_gates_are_five_degrees_and_twenty_millimetres() -> None:
    pose = np.array([178.0, 10.0, 0.0, 200.0])
    assert within_gates(pose, np.array([-177.5, 29.0, -19.0, 181.0]))
    for axis, off in enumerate((5.1, 20.1, 20.1, 20.1)):
        assert not within_gates(pose, pose + off * np.eye(4)[axis])


@pytest.mark.parametrize(("turn_deg", "lift_mm", "stays"), [(0, 0, True), (9, 0, False), (0, 30, False)])
def test_the_true_interpretation_stays_until_its_part_is_out_of_the_gates(
    base: ModelBase, world: World, turn_deg: float, lift_mm: float, stays: bool
) -> None:
    rig = blank_rig(base, "GH", 5)
    first = look(world, rig)
    left = interpret(world, [first], 0)
    row = true_row(world, rig, left)
    assert row >= 0
    # Seen obliquely, so that the part itself tells its rotation.
    here = {q.id for q in rig.parts()}
    beside = [
        p for p in rig.reachable() if abs(p.y_mm - rig.pose.y_mm) < 1 and abs(p.theta_deg - rig.pose.theta_deg) > 15
    ]
    beside.sort(key=lambda p: rig.travel_s(rig.pose, p))
    oblique = next(p for p in beside if here & {q.id for q in rig.parts(p) if q.fully_in_frame})
    placement = left.hypotheses.placement.copy()
    placement[:, 0] += np.radians(turn_deg)
    placement[:, 2] += lift_mm
    moved = replace(left, hypotheses=replace(left.hypotheses, placement=placement))
    after = eliminate(world, moved.take(np.array([row])), [first, look(world, rig, oblique)])
    assert (after.count == 1) == stays


def test_an_empty_view_is_undone_and_eliminates_nothing(base: ModelBase) -> None:
    def blind_once(view: int, parts: list[DetectedPart]) -> list[DetectedPart]:
        return [] if view == 1 else parts

    rig = blank_rig(base, "LH", 0)
    start = rig.pose
    steps, _ = run(recognise_as_paper(rig, base, SETTINGS, detector=TrueDetector(rig, blind_once)))
    assert steps[1].belief.hypotheses_left == steps[0].belief.hypotheses_left
    assert steps[1].move is not None
    assert "undone" in steps[1].move.why
    # To the empty view, back to the start, and on to another leaf.
    assert rig.visited[1] == steps[1].frame.rig_pose
    assert rig.visited[2] == start
    assert rig.visited[3] == steps[1].move.target != steps[1].frame.rig_pose


def test_when_all_are_eliminated_the_answer_says_not_found(base: ModelBase) -> None:
    def lie(view: int, parts: list[DetectedPart]) -> list[DetectedPart]:
        return parts if view == 0 else [replace(p, class_scores={"OPEN": 1.0}) for p in parts[:1]]

    def misplace(view: int, parts: list[DetectedPart]) -> list[DetectedPart]:
        parts = lie(view, parts)
        return parts if view == 0 else [replace(p, corners_px=p.corners_px * 0.5) for p in parts]

    rig = blank_rig(base, "LH", 0)
    _, answer = run(recognise_as_paper(rig, base, SETTINGS, detector=TrueDetector(rig, misplace)))
    assert answer.outcome is Outcome.NOT_FOUND
    assert answer.object_id is None
    assert "5 degrees and 20 mm" in answer.why


def test_a_scene_without_parts_is_not_found(base: ModelBase) -> None:
    rig = blank_rig(base, "LH", 0)
    settings = replace(SETTINGS, max_views=3)
    steps, answer = run(recognise_as_paper(rig, base, settings, detector=TrueDetector(rig, lambda *_: [])))
    assert len(steps) == 3
    assert answer.outcome is Outcome.NOT_FOUND


def test_views_run_out_as_ambiguous(base: ModelBase) -> None:
    rig = blank_rig(base, "LH", 0)
    _, answer = run(recognise_as_paper(rig, base, replace(SETTINGS, max_views=1), detector=TrueDetector(rig)))
    assert answer.outcome is Outcome.AMBIGUOUS
    assert "374 interpretations are left" in answer.why
