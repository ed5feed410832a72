"""A belief is told to people as it is: when it may end, what is left, where the camera is and how sure that is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    BOUNDS,
    OBJECT_IN_RIG,
    SETTINGS,
    before_front,
    believed,
    camera_of,
    in_rig,
    rig_pose,
    seen_from,
    three_buildings,
    with_views,
    world_of,
)
from recognition.belief import Belief
from recognition.geometry import CameraPose
from recognition.hypotheses import Hypotheses
from recognition.seen import Seen
from recognition.steps import Outcome
from recognition.summary import (
    Verdict,
    answer,
    judge,
    leading_group,
    places,
    pose_of,
    pose_sd,
    summarise,
    wanted_of_pose,
)
from rig.hal import Frame, RigPose

BASE = three_buildings()
WORLD = world_of(BASE)
CAMERAS = [before_front(300.0, turn_deg=15.0), before_front(480.0, 200.0, 360.0, -10.0), before_front(390.0, 240.0)]
VIEWS = [seen_from(BASE, BASE.objects[1], camera, group=k) for k, camera in enumerate(CAMERAS)]
SURE = believed(WORLD, VIEWS)[1]


def split(*shares: float, none: float = 0.0) -> Belief:
    """The leading hypothesis, repeated for other objects, with these probabilities."""
    rows = SURE.hypotheses.take(np.zeros(len(shares), dtype=np.int64))
    return Belief(replace(rows, object_of=np.array([1, 0, 2])[: len(shares)]), np.array(shares), none)


def turned(belief: Belief, row: int, pan_deg: float, along_mm: float) -> Belief:
    """One hypothesis placed elsewhere."""
    placement = belief.hypotheses.placement.copy()
    placement[row] += [np.radians(pan_deg), along_mm, 0.0, 0.0]
    return replace(belief, hypotheses=replace(belief.hypotheses, placement=placement))


def test_a_configuration_above_the_threshold_ends_the_run() -> None:
    verdict = judge(WORLD, split(0.995, 0.005), VIEWS, SETTINGS)
    assert verdict is not None
    assert (verdict.outcome, verdict.wanted) == (Outcome.RECOGNISED, "")
    assert judge(WORLD, split(0.6, 0.4), VIEWS, SETTINGS) is None


def test_the_threshold_is_the_users() -> None:
    assert judge(WORLD, split(0.92, 0.08), VIEWS, with_views(SETTINGS, threshold=0.9)) is not None
    assert judge(WORLD, split(0.92, 0.08), VIEWS, with_views(SETTINGS, threshold=0.95)) is None


def test_a_place_that_is_settled_waits_for_a_pose_as_sure_as_asked() -> None:
    verdict = judge(WORLD, split(1.0), VIEWS, with_views(SETTINGS, pose_sd_mm=0.01))
    assert verdict is not None
    assert verdict.outcome is Outcome.RECOGNISED
    assert "position is unsure" in verdict.wanted
    pan = judge(WORLD, split(1.0), VIEWS, with_views(SETTINGS, pose_sd_mm=1e3, pose_sd_deg=1e-4))
    assert pan is not None
    assert "pan is unsure" in pan.wanted


def test_the_last_view_ends_the_run_whatever_is_left() -> None:
    last = with_views(SETTINGS, max_views=3)
    assert judge(WORLD, split(0.6, 0.4), VIEWS, SETTINGS) is None
    ended = judge(WORLD, split(0.6, 0.4), VIEWS, last)
    assert ended is not None
    assert ended.outcome is Outcome.AMBIGUOUS
    nothing = judge(WORLD, split(0.1, none=0.9), VIEWS, last)
    assert nothing is not None
    assert nothing.outcome is Outcome.NOT_FOUND
    unsure = judge(WORLD, split(1.0), VIEWS, replace(last, pose_sd_mm=0.01))
    assert unsure is not None
    assert (unsure.outcome, bool(unsure.wanted)) == (Outcome.RECOGNISED, True)


@pytest.mark.parametrize(
    ("verdict", "sure"),
    [
        (Verdict(Outcome.RECOGNISED, "because"), True),
        (Verdict(Outcome.RECOGNISED, "because", wanted="its pan is unsure"), False),
        (Verdict(Outcome.AMBIGUOUS, "because"), None),
    ],
)
def test_an_answer_tells_whether_the_pose_is_as_sure_as_asked(verdict: Verdict, sure: bool | None) -> None:
    assert answer(WORLD, split(1.0), VIEWS, verdict, [RigPose(0, 0, 0, 0)]).pose_sure is sure


def test_a_verdict_without_what_is_wanted_says_both() -> None:
    told = Verdict(Outcome.RECOGNISED, "one is left", wanted="its pan is unsure").without("no view helps")
    assert told.why == "one is left, but its pan is unsure, and no view helps"
    assert told.wanted


def test_none_of_these_ends_the_run_only_after_some_views_that_show_something() -> None:
    """Windows cut by the frame suggest no place at all; that is no evidence against the objects."""
    beaten = split(1.0)
    beaten = replace(beaten, probability=np.zeros(len(beaten.probability)), none=1.0)
    nothing = Belief(Hypotheses.empty(), np.empty(0), 1.0)
    for belief in (beaten, nothing):
        assert judge(WORLD, belief, VIEWS, SETTINGS) is None
        verdict = judge(WORLD, belief, VIEWS * 2, SETTINGS)
        assert verdict is not None
        assert verdict.outcome is Outcome.UNKNOWN
    bare = [seen_from(BASE, None, camera, group=k) for k, camera in enumerate(CAMERAS)]
    assert judge(WORLD, nothing, bare * 2, SETTINGS) is None


def with_another_part(belief: Belief, row: int) -> Belief:
    """The belief with another part in place of the first one that a hypothesis has matched in the last view."""
    matches = list(belief.hypotheses.matches)
    part = matches[-1].part.copy()
    part[row, 0] += 1
    matches[-1] = replace(matches[-1], part=part)
    return replace(belief, hypotheses=replace(belief.hypotheses, matches=tuple(matches)))


def test_companions_are_of_the_same_object_and_nearly_the_same_pose() -> None:
    belief = split(0.5, 0.3, 0.2)
    assert leading_group(WORLD, belief, VIEWS).tolist() == [True, False, False]
    same = replace(belief, hypotheses=replace(belief.hypotheses, object_of=np.array([1, 1, 1])))
    assert leading_group(WORLD, same, VIEWS).tolist() == [True, True, True]
    away = with_another_part(turned(same, 1, 0.0, 150.0), 1)
    assert leading_group(WORLD, away, VIEWS).tolist() == [True, False, True]
    assert leading_group(WORLD, turned(same, 2, 30.0, 0.0), VIEWS).tolist() == [True, True, False]


def test_one_place_whose_depth_is_open_is_one_place() -> None:
    """The same parts, matched in every view, from farther away: an unsure pose, and not another place."""
    belief = split(0.5, 0.3, 0.2)
    same = replace(belief, hypotheses=replace(belief.hypotheses, object_of=np.array([1, 1, 1])))
    assert leading_group(WORLD, turned(same, 1, 0.0, 150.0), VIEWS).tolist() == [True, True, True]
    assert pose_sd(turned(same, 1, 0.0, 150.0), VIEWS, np.ones(3, dtype=bool))["x_mm"] > 50.0


def test_companions_share_the_probability_that_ends_a_run() -> None:
    alike = split(0.5, 0.3, 0.2)
    alike = replace(alike, hypotheses=replace(alike.hypotheses, object_of=np.array([1, 1, 1])))
    verdict = judge(WORLD, alike, VIEWS, SETTINGS)
    assert verdict is not None
    assert verdict.outcome is Outcome.RECOGNISED


def test_a_place_is_named_after_the_part_in_the_middle_of_the_picture() -> None:
    here = CAMERAS[-1]
    nearest = min(
        (p for p in BASE.objects[1].parts if p.face == "front"),
        key=lambda p: float(np.hypot(p.centre_mm[0] - here.x_mm, p.centre_mm[1] - here.y_mm)),
    )
    assert WORLD.layout.part_ids[places(WORLD, SURE, VIEWS)[0]] == nearest.id


def test_the_pose_told_is_the_camera_in_the_object_frame() -> None:
    exact = np.array([np.radians(OBJECT_IN_RIG.theta_deg), *OBJECT_IN_RIG.translation_mm])
    told = pose_of(exact, VIEWS[-1])
    assert np.allclose(told.centre_mm, CAMERAS[-1].centre_mm)
    assert told.theta_deg == pytest.approx(CAMERAS[-1].theta_deg)


def test_the_sd_told_is_the_spread_of_poses_drawn_from_the_fit() -> None:
    """Covariance of the placement, carried over to the camera in the object frame, against brute force."""
    one = split(1.0)
    covariance = np.diag([0.004, 2.0, 0.5, 3.0]) ** 2
    one = replace(one, hypotheses=replace(one.hypotheses, covariance=covariance[None]))
    told = pose_sd(one, VIEWS, np.array([True]))
    drawn = np.random.default_rng(0).multivariate_normal(one.hypotheses.placement[0], covariance, 4000)
    poses = [pose_of(placement, VIEWS[-1]) for placement in drawn]
    for name in ("theta_deg", "x_mm", "y_mm", "z_mm"):
        assert told[name] == pytest.approx(np.std([getattr(p, name) for p in poses]), rel=0.08)


def test_companions_apart_make_the_pose_less_sure() -> None:
    pair = split(0.5, 0.5)
    pair = replace(pair, hypotheses=replace(pair.hypotheses, object_of=np.array([1, 1])))
    alone = pose_sd(pair, VIEWS, np.array([True, False]))
    apart = turned(pair, 1, 0.0, 30.0)
    assert pose_sd(apart, VIEWS, np.array([True, True]))["x_mm"] > alone["x_mm"] + 5.0


def test_a_rig_that_reads_back_roughly_makes_the_pose_less_sure_once_it_has_moved() -> None:
    rough = replace(BOUNDS, motion_sd_mm=6.0, motion_sd_deg=2.0)
    exact = SURE.hypotheses.take(np.array([0]))
    sure = Belief(replace(exact, covariance=np.zeros((1, 4, 4))), np.array([1.0]), 0.0)
    for views in (VIEWS, VIEWS[:1]):
        told = pose_sd(sure, views, np.array([True]), rough)
        share = np.sqrt(1.0 - 1.0 / len(views))
        assert told == pytest.approx(
            {"theta_deg": 2.0 * share, "x_mm": 6.0 * share, "y_mm": 6.0 * share, "z_mm": 6.0 * share}
        )
    assert wanted_of_pose(world_of(BASE), sure, VIEWS, with_views(SETTINGS, pose_sd_mm=1.0)) == ""
    assert "is unsure by 4.9 mm" in wanted_of_pose(
        world_of(BASE, bounds=rough), sure, VIEWS, with_views(SETTINGS, pose_sd_mm=1.0)
    )


def test_a_summary_sums_to_one_and_names_the_leaders() -> None:
    frame = Frame(
        np.zeros((480, 640), dtype=np.uint8), rig_pose(in_rig(CAMERAS[-1])), rig_pose(in_rig(CAMERAS[-1])), "", 2
    )
    told = summarise(WORLD, split(0.5, 0.3, none=0.2), VIEWS, frame)
    assert told.posterior == pytest.approx({"mill": 0.5, "tower": 0.3, "barn": 0.0, "unknown": 0.2})
    assert told.hypotheses_left == 2
    p = np.array([0.5, 0.3, 0.2])
    assert told.entropy_bits == pytest.approx(float(-(p * np.log2(p)).sum()))
    assert [leader.object_id for leader in told.leaders] == ["mill", "tower"]
    matched = [m for m in told.leaders[0].matches if m.detection is not None]
    assert len(matched) == VIEWS[-1].count


def told_of(belief: Belief, outcome: Outcome, path: list[RigPose]) -> tuple[object, ...]:
    final = answer(WORLD, belief, VIEWS, Verdict(outcome, "because"), path)
    return final.object_id, final.candidates, final.travel_mm, final.rotation_deg


def test_an_answer_names_the_object_or_else_what_is_left() -> None:
    path = [RigPose(0, 0, 0, 0), RigPose(30, 0, 40, 90), RigPose(30, 0, 40, -170)]
    thing, left, travel, turn = told_of(split(1.0), Outcome.RECOGNISED, path)
    assert (thing, left) == ("mill", ())
    assert (travel, turn) == (pytest.approx(50.0), pytest.approx(90.0 + 100.0))
    thing, left, _, _ = told_of(split(0.6, 0.4), Outcome.AMBIGUOUS, path)
    assert thing is None
    assert isinstance(left, tuple)
    assert [name.split(" at ")[0] for name in left] == ["mill", "tower"]


def test_an_answer_without_hypotheses_has_no_pose() -> None:
    final = answer(WORLD, Belief.empty(), VIEWS, Verdict(Outcome.NOT_FOUND, "because"), [RigPose(0, 0, 0, 0)])
    assert (final.pose, dict(final.pose_sd), final.candidates, final.object_id) == (None, {}, (), None)
    assert final.posterior["unknown"] == 1.0


def test_directions_that_the_views_do_not_determine_are_named() -> None:
    one = split(1.0)
    open_depth = np.diag([1e-3, 0.5, 0.5, 0.5]) ** 2
    toward = camera_of(one.hypotheses, 0, VIEWS[-1])
    farther = CameraPose(toward.theta_deg, *(toward.centre_mm + np.array([0, 0, 100.0])))
    ray = in_rig(farther).centre_mm - in_rig(toward).centre_mm
    ray = ray / np.linalg.norm(ray)
    open_depth[1:, 1:] += 90.0**2 * np.outer(ray, ray)
    vague = replace(one, hypotheses=replace(one.hypotheses, covariance=open_depth[None]))
    final = answer(WORLD, vague, VIEWS, Verdict(Outcome.RECOGNISED, "because"), [RigPose(0, 0, 0, 0)])
    assert final.unobservable == ("z_mm",)
    sure = answer(WORLD, SURE, VIEWS, Verdict(Outcome.RECOGNISED, "because"), [RigPose(0, 0, 0, 0)])
    assert sure.unobservable == ()


def test_seen_views_are_counted_whatever_their_order() -> None:
    views: list[Seen] = [VIEWS[0], seen_from(BASE, None, CAMERAS[1], group=1), *VIEWS[1:], *VIEWS]
    nothing = Belief(Hypotheses.empty(), np.empty(0), 1.0)
    assert judge(WORLD, nothing, views, SETTINGS) is not None
