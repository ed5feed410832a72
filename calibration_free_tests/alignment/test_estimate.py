"""The mount from tracks and known moves: right, as sure as it says, silent of what cannot be seen, deaf to nonsense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration_free_tests.alignment.synthetic import HUNG, LENS, SIZE, lattice, moved_by_chance, seen, wall
from recognition.alignment.advice import advice
from recognition.alignment.bundle import C, Priors, Unknowns, adjust, cost, linearise
from recognition.alignment.estimate import MOUNT, MountEstimate, estimate_mount
from recognition.alignment.moves import Moves
from recognition.alignment.tracks import Tracks
from recognition.geometry import Mount, rotation_y
from rig.errors import DegenerateGeometryError
from rig.hal import RigPose

TRUE = {name: getattr(HUNG, name) for name in MOUNT}


def estimate(tracks: Tracks, poses: list[RigPose], sd_mm: float = 0.02, sd_deg: float = 0.01) -> MountEstimate:
    return estimate_mount(tracks, Moves.of(poses), SIZE, motion_sd_mm=sd_mm, motion_sd_deg=sd_deg)


def noisy(poses: list[RigPose], seed: int = 3, told: list[RigPose] | None = None) -> MountEstimate:
    """Of a scan that is told to go to some poses but really goes to these."""
    rng = np.random.default_rng(seed)
    return estimate(seen(wall(rng), poses, noise_px=0.3, rng=rng), told or poses)


@pytest.mark.parametrize("relief_mm", [15.0, 0.0])
def test_without_noise_the_mount_is_exact(relief_mm: float) -> None:
    points = wall(np.random.default_rng(1), relief_mm=relief_mm)
    found = estimate(seen(points, lattice()), lattice(), 0.0, 0.0)
    assert found.open == {}
    assert found.explained == 1.0
    for name, true in TRUE.items():
        assert found.values[name] == pytest.approx(true, abs=1e-3 if name.endswith("mm") else 1e-4)


@pytest.mark.parametrize("pan_deg", [-100.0, 178.5])
def test_a_camera_that_looks_anywhere_is_found(pan_deg: float) -> None:
    hung = replace(HUNG, pan_zero_deg=pan_deg)
    points = wall(np.random.default_rng(2)) @ rotation_y(np.radians(pan_deg - 1.5))
    found = estimate(seen(points, lattice(), hung), lattice(), 0.0, 0.0)
    assert [found.values[name] for name in MOUNT] == pytest.approx([getattr(hung, name) for name in MOUNT], abs=1e-3)


def test_axes_that_the_bench_tells_are_reckoned_with() -> None:
    crooked = replace(HUNG, x_scale=1.03, z_scale=0.98, xz_deg=1.0, xy_deg=-0.7)
    tracks = seen(wall(np.random.default_rng(1)), lattice(), crooked)
    found = estimate_mount(tracks, Moves.of(lattice(), crooked), SIZE, motion_sd_mm=0.0, motion_sd_deg=0.0)
    assert [found.values[name] for name in MOUNT] == pytest.approx([TRUE[name] for name in MOUNT], abs=1e-3)


@pytest.mark.parametrize(("told", "real"), [((0.05, 0.02), (0.05, 0.02)), ((0.02, 0.01), (0.1, 0.1))])
def test_errors_are_as_large_as_told(told: tuple[float, float], real: tuple[float, float]) -> None:
    poses = lattice(zs=(0.0,))
    off = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        tracks = seen(wall(rng, points=200), moved_by_chance(poses, rng, *real), noise_px=0.3, rng=rng)
        found = estimate(tracks, poses, *told)
        off.append([(found.values[name] - TRUE[name]) / found.sd[name] for name in MOUNT])
    rms = np.sqrt((np.array(off) ** 2).mean(axis=0))
    # 6 draws of a standard normal variable have an rms within these bounds in 99.9 % of all cases.
    assert np.all((rms > 0.22) & (rms < 2.0)), rms
    assert (np.abs(off) < 2.0).mean() > 0.85


def test_wrong_matches_are_thrown_out() -> None:
    rng = np.random.default_rng(4)
    found = estimate(seen(wall(rng), lattice(), noise_px=0.3, wrong=0.1, rng=rng), lattice())
    assert 0.75 < found.explained < 0.92
    for name, true in TRUE.items():
        assert abs(found.values[name] - true) < 4 * found.sd[name]


def test_moves_worse_than_told_are_found_out_and_named() -> None:
    rng = np.random.default_rng(5)
    tracks = seen(wall(rng), moved_by_chance(lattice(), rng, 0.2, 0.1), noise_px=0.3, rng=rng)
    found = estimate(tracks, lattice())
    assert (found.off.mm, found.off.deg) == (pytest.approx(0.2, rel=0.3), pytest.approx(0.1, rel=0.3))
    assert sum("were off by" in text for text in advice(found)) == 2
    trusted = estimate(tracks, lattice(), 0.25, 0.15)
    assert (trusted.off, advice(trusted)) == (trusted.told, ())


def test_without_pans_the_lever_arm_is_named_unseen_and_the_angles_are_found() -> None:
    found = noisy(lattice(pans=(0.0,)))
    assert set(found.open) == {"x_mm", "z_mm"}
    assert any("no pan moves" in text for text in advice(found))
    for name in ("pan_zero_deg", "roll_deg", "pitch_deg"):
        assert abs(found.values[name] - TRUE[name]) < 4 * found.sd[name]


def test_unsteady_pans_do_not_pass_for_pans() -> None:
    rng = np.random.default_rng(6)
    poses = lattice(pans=(0.0,))
    tracks = seen(wall(rng), moved_by_chance(poses, rng, 0.02, 0.3), noise_px=0.1, rng=rng)
    assert {"x_mm", "z_mm"} <= set(estimate(tracks, poses).open)


def test_pans_alone_are_refused() -> None:
    poses = lattice((0.0,), (0.0,), (0.0,), tuple(range(-20, 21, 4)))
    with pytest.raises(DegenerateGeometryError, match=r"never moves in x, y or z.*Scan a lattice"):
        noisy(poses)


def test_the_smaller_the_moves_the_less_sure_until_nothing_tells_millimetres() -> None:
    tiny, small, large = (lattice((-d, 0.0, d), (0.0,), (0.0,)) for d in (0.2, 2.0, 20.0))
    with pytest.raises(DegenerateGeometryError, match="moves very small"):
        noisy(tiny)
    vague, sharp = noisy(small), noisy(large)
    for name, true in TRUE.items():
        assert vague.sd[name] > sharp.sd[name]
        assert abs(vague.values[name] - true) < 4 * vague.sd[name]


@pytest.mark.parametrize("axis", ["x_mm", "y_mm", "z_mm", "theta_deg"])
def test_an_axis_with_the_wrong_sign_is_refused(axis: str) -> None:
    told = [replace(pose, **{axis: -getattr(pose, axis)}) for pose in lattice()]
    with pytest.raises(DegenerateGeometryError, match="wrong sign"):
        noisy(lattice(), told=told)


def test_a_zoom_that_changed_amid_the_scan_is_refused() -> None:
    rng = np.random.default_rng(7)
    poses = lattice()
    lenses = [LENS] * 18 + [replace(LENS, fx=1100.0, fy=1105.0)] * 18
    with pytest.raises(DegenerateGeometryError, match="did zoom, focus"):
        estimate(seen(wall(rng), poses, lens=lenses, noise_px=0.3, rng=rng), poses)


def test_pictures_shifted_afterwards_are_refused() -> None:
    """As in light fields, whose views are registered to a plane: the principal point goes along with the moves."""
    rng = np.random.default_rng(8)
    poses = lattice((-40.0, -10.0, 20.0, 50.0), (-40.0, -10.0, 20.0, 50.0), (0.0,), (0.0,))
    lenses = [replace(LENS, u0=LENS.u0 + 2.0 * pose.x_mm, v0=LENS.v0 + 2.3 * pose.y_mm) for pose in poses]
    with pytest.raises(DegenerateGeometryError, match="registered"):
        estimate(seen(wall(rng), poses, lens=lenses, noise_px=0.3, rng=rng), poses)


def test_too_few_views_and_too_few_points_are_refused() -> None:
    points = wall(np.random.default_rng(9))
    two = lattice()[:2]
    with pytest.raises(DegenerateGeometryError, match="2 views are too few"):
        estimate(seen(points, two), two)
    with pytest.raises(DegenerateGeometryError, match=r"only 7 points.*more texture"):
        estimate(Tracks.of(np.zeros((21, 2)), np.tile([0, 1, 2], 7), np.repeat(np.arange(7), 3)), lattice())


def test_derivatives_are_those_of_the_prediction() -> None:
    rng = np.random.default_rng(10)
    poses = lattice()[:4]
    tracks, moves = seen(wall(rng, 40), poses), Moves.of(poses)
    common = np.array([np.log(900.0), 0.01, 320.0, 240.0, -0.05, 12.0, 45.0, 0.03, 0.01, -0.02])
    at = Unknowns(common, rng.normal(0, 0.01, (4, 4)), wall(rng, tracks.count))
    linear = linearise(at, tracks, moves)

    def change(less: Unknowns, more: Unknowns) -> np.ndarray:
        return (linearise(less, tracks, moves).residuals - linearise(more, tracks, moves).residuals) / 2e-6

    for k in range(C):
        step = np.eye(C)[k] * 1e-6
        slope = change(replace(at, common=common - step), replace(at, common=common + step))
        np.testing.assert_allclose(linear.by_common[:, :, k], slope, rtol=1e-4, atol=1e-3)
    for k in range(4):
        step = np.eye(4)[k] * 1e-6
        slope = change(replace(at, motion=at.motion - step), replace(at, motion=at.motion + step))
        np.testing.assert_allclose(linear.by_motion[:, :, k], slope, rtol=1e-4, atol=1e-3)
    for k in range(3):
        step = np.eye(3)[k] * 1e-6
        slope = change(replace(at, points=at.points - step), replace(at, points=at.points + step))
        np.testing.assert_allclose(linear.by_point[:, :, k], slope, rtol=1e-4, atol=1e-3)


def test_each_step_of_the_fit_lowers_the_cost() -> None:
    rng = np.random.default_rng(11)
    poses = lattice()
    points = wall(rng, 60)
    tracks, moves = seen(points, poses, noise_px=0.3, rng=rng), Moves.of(poses)
    tracked = points[: tracks.count] * 0 + [0.0, 0.0, 400.0] + rng.normal(0, 30, (tracks.count, 3))
    common = np.zeros(C)
    common[:4] = np.log(800.0), 0.0, 320.0, 240.0
    priors = Priors(common, np.full(C, 100.0), np.full(4, 1e-3), tracked, 4000.0)
    values = []
    at = Unknowns(common, np.zeros((len(poses), 4)), tracked)
    for iterations in (0, 3, 10, 30):
        fitted, linear, value = adjust(at, tracks, moves, priors, sigma_px=1.0, tail_sd=3.0, iterations=iterations)
        assert value == pytest.approx(cost(linear, fitted, priors, 1.0, 3.0))
        values.append(value)
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.2 * values[0]


def test_the_mount_is_that_of_the_design() -> None:
    """One point, one view: the estimator's prediction is what `Mount` says."""
    mount = Mount(x_mm=12.0, z_mm=45.0, pan_zero_deg=3.0, roll_deg=2.0, pitch_deg=-1.5)
    pose = RigPose(10.0, -5.0, 20.0, 8.0)
    point = np.array([[30.0, 20.0, 420.0]])
    tracks = seen(np.repeat(point, 3, axis=0), [pose] * 3, mount)
    common = np.array([
        *(np.log(LENS.fx), np.log(LENS.fy / LENS.fx), LENS.u0, LENS.v0, LENS.k1),
        *(12.0, 45.0, *np.radians([3.0, 2.0, -1.5])),
    ])  # fmt: skip
    at = Unknowns(common, np.zeros((3, 4)), np.repeat(point, 3, axis=0))
    assert np.abs(linearise(at, tracks, Moves.of([pose] * 3)).residuals).max() < 1e-9
