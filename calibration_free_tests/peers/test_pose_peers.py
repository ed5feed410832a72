"""Every solver that is measured recovers a clean pose from its own fair start; errors and bounds are what they say."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.peers import ours
from benchmarks.peers.bound import DRIFT_KNOWN, KNOWN, UNKNOWN, bound, sampled
from benchmarks.peers.rigs import RIGS
from benchmarks.peers.scenes import CENTRE, Scenes, draw, project
from benchmarks.peers.score import Errors, Row, errors, line, verdict
from benchmarks.peers.solvers import ONE_VIEW, PACKAGE
from recognition.geometry import rotation_y
from recognition.varpro import refine_batch

FloatArray = npt.NDArray[np.float64]
MOVES = (0.0, 15.0, -15.0)
FREE = ("OpenCV calibrateCamera, one view", "pycolmap, fx, fy + principal point refined")


def needs(package: str) -> None:
    if package != "opencv" and find_spec(package) is None:
        pytest.skip(f"{package} is not installed: it comes with the extra 'peers'")


def clean(drifting: bool, moves: tuple[float, ...] = (0.0,)) -> Scenes:
    """Eight scenes without noise, of a camera that is the nominal one or has drifted from it."""
    scenes = draw(np.random.default_rng(5), 8, 1.0, moves)
    internals = scenes.internals
    if not drifting:
        focal = np.broadcast_to(scenes.nominal_px[:, None, None], (*internals.shape[:2], 2))
        internals = np.concatenate([focal, np.broadcast_to(CENTRE, focal.shape)], axis=-1)
    at = scenes.rotation, scenes.pose[:, 1:], scenes.cameras, internals
    return replace(scenes, internals=internals, pixels=project(scenes.points_mm, *at))


def off(scenes: Scenes, rotation: FloatArray, shift: FloatArray) -> Errors:
    return errors(np.array(rotation), np.array(shift), scenes.rotation, scenes.pose[:, 1:])


@pytest.mark.parametrize("name", ONE_VIEW)
def test_a_peer_recovers_the_pose_of_clean_points_of_the_camera_it_takes_for_granted(name: str) -> None:
    needs(PACKAGE[name])
    scenes = clean(drifting=name in FREE)
    seen = zip(scenes.points_mm, scenes.pixels[:, 0], scenes.nominal_px, strict=True)
    poses = [ONE_VIEW[name](*one) for one in seen]
    found = off(scenes, [p[0] for p in poses if p], [p[1] for p in poses if p])
    assert found.failures == 0
    assert found.rotation_deg.max() < 0.01
    assert found.centre_mm.max() < 0.1


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_recovers_the_pose_of_clean_points(name: str) -> None:
    needs("pycolmap")
    scenes = clean("principal" in name, MOVES)
    seen = zip(scenes.points_mm, scenes.pixels, scenes.nominal_px, scenes.cameras, strict=True)
    poses = [RIGS[name](*one) for one in seen]
    found = off(scenes, [p[0] for p in poses if p], [p[1] for p in poses if p])
    assert found.rotation_deg.max() < 0.01
    assert found.centre_mm.max() < 0.1


@pytest.mark.parametrize("moves", [(0.0,), MOVES])
def test_ours_recovers_the_pose_of_clean_points_of_a_drifting_camera(moves: tuple[float, ...]) -> None:
    scenes = clean(True, moves)
    for poses in (ours.batch_upright(scenes, None), ours.batch_general(scenes, None)):
        found = off(scenes, *poses)
        assert found.rotation_deg.max() < 0.01
        assert found.centre_mm.max() < 0.1
    told = off(scenes, *ours.told_nominal(scenes))
    assert told.failures == 0
    # Its priors pull, and may: clean points with drifted internals are not what they expect.
    assert np.median(told.rotation_deg) < 0.5


def test_batch_and_one_by_one_end_in_the_same_minimum() -> None:
    scenes = draw(np.random.default_rng(6), 5, 0.5)
    together, alone = ours.batch_upright(scenes, None), ours.single(scenes, 4, None)
    sd = np.sqrt(np.einsum("haa->ha", bound(scenes, 4, UNKNOWN)))
    apart = errors(*together, *alone)
    assert (np.radians(apart.rotation_deg) < 0.1 * sd[:, 0]).all()
    assert (np.abs(together[1] - alone[1]) < 0.1 * sd[:, 1:]).all()


def test_errors_are_the_angle_the_pan_and_the_distance_of_the_centres() -> None:
    quarter, roll = rotation_y(np.radians(90.0)), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    # Turned by 90 degrees about Y, a camera at (10, 0, 0) has t = -R c = (0, 0, 10).
    true = np.stack([quarter, np.eye(3), np.eye(3)]), np.array([[0.0, 0.0, 10.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = np.stack([rotation_y(np.radians(92.0)), roll, np.full((3, 3), np.nan)])
    at = np.array([13.0, 4.0, 0.0])
    shift = np.stack([-found[0] @ at, [0.0, 0.0, 5.0], [np.nan] * 3])
    out = errors(found, shift, *true)
    np.testing.assert_allclose(out.rotation_deg, [2.0, 90.0, np.inf])
    np.testing.assert_allclose(out.pan_deg[0], 2.0)
    np.testing.assert_allclose(out.centre_mm, [5.0, 5.0, np.inf])
    assert out.failures == 1


def test_a_verdict_takes_the_best_peer_of_each_figure_and_the_time_of_the_most_exact() -> None:
    def row(name: str, rotation: float, pan: float, centre: float, microseconds: float) -> Row:
        return Row(name, Errors(np.array([rotation]), np.array([pan]), np.array([centre])), microseconds)

    out = verdict(row("ours", 1.0, 1.0, 1.0, 10.0), [row("a", 2.0, 2.0, 8.0, 500.0), row("b", 4.0, 1.5, 5.0, 100.0)])
    assert (out.rotation, out.rotation_peer) == (0.5, "a")
    assert (out.pan, out.pan_peer) == (1.0 / 1.5, "b")
    assert (out.centre, out.centre_peer) == (0.2, "b")
    assert (out.time, out.time_peer) == (0.02, "a")
    assert (out.fastest, out.fastest_peer) == (0.1, "b")


def test_a_failure_counts_as_the_worst_error() -> None:
    values = np.array([1.0, np.inf, np.inf])
    assert "inf" in line(Row("a", Errors(values, values, values), 5.0))


@pytest.mark.parametrize("moves", [(0.0,), MOVES])
def test_the_bound_is_what_our_estimator_says_of_itself_at_the_truth(moves: tuple[float, ...]) -> None:
    scenes = clean(True, moves)
    t = ours.table(scenes)
    found = refine_batch(scenes.pose, t.points, t.pixels, t.weight, t.view, t.cameras, t.group, iterations=0)
    np.testing.assert_allclose(found.covariance, bound(scenes, 4, UNKNOWN), rtol=1e-3, atol=1e-6)


def test_knowledge_and_fewer_unknowns_never_loosen_the_bound() -> None:
    scenes = draw(np.random.default_rng(7), 20, 0.5)
    centre = {}
    for dof in (4, 6):
        for knowledge in (KNOWN, DRIFT_KNOWN, UNKNOWN):
            centre[dof, knowledge] = np.einsum("haa->h", bound(scenes, dof, knowledge)[:, -3:, -3:])
        assert (centre[dof, KNOWN] < centre[dof, DRIFT_KNOWN]).all()
        assert (centre[dof, DRIFT_KNOWN] < centre[dof, UNKNOWN]).all()
    assert (centre[4, UNKNOWN] < centre[6, UNKNOWN]).all()


def test_ours_in_batch_reaches_the_bound() -> None:
    scenes = draw(np.random.default_rng(8), 400, 0.5)
    mine = off(scenes, *ours.batch_upright(scenes, None))
    best = sampled(np.random.default_rng(9), scenes, bound(scenes, 4, UNKNOWN))
    assert np.median(mine.rotation_deg) < 1.2 * np.median(best.rotation_deg)
    assert np.median(mine.centre_mm) < 1.2 * np.median(best.centre_mm)
