"""The mock rig serves what was captured, says where, and refuses what it cannot do."""

from __future__ import annotations

import shutil
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.imagegrid.sample import lattice, picture, write_grid
from rig.bench import load_bench, open_rig
from rig.errors import ImageGridError, InputError, UnreachableError
from rig.hal import AxisLimits, RigPose
from rig.imagegrid import read_grid
from sim_backends.image_grid_rig import ImageGridRig, Speeds, limits_of

CASTLE_BENCH = Path(__file__).parents[2] / "examples" / "castle.yaml"
POSES = lattice()


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_grid(tmp_path_factory.mktemp("original") / "grid", POSES)


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    return shutil.copytree(original, tmp_path / "grid")


def rig_on(folder: Path, **noise: float) -> ImageGridRig:
    grid = read_grid(folder)
    limits = limits_of(grid, Speeds(10.0, 5.0, 0.5), settle_s=0.5, exposure_s=0.1)
    rng = np.random.default_rng(3) if noise else None
    return ImageGridRig(
        grid,
        limits,
        internals_fixed_by_zoom=True,
        repeatability_mm=noise.get("mm", 0.0),
        repeatability_deg=noise.get("deg", 0.0),
        rng=rng,
        distance_mm=100.0,
    )


def test_every_cell_shows_its_own_picture(folder: Path) -> None:
    rig = rig_on(folder)
    assert list(rig.reachable()) == POSES
    for number, pose in enumerate(POSES):
        rig.move_to(pose)
        frame = rig.capture()
        assert frame.name == f"images/{number:03d}.png"
        assert np.array_equal(frame.image, picture(number))
        assert frame.rig_pose == frame.commanded == pose


def test_the_digest_is_checked_when_the_picture_is_taken(folder: Path) -> None:
    rig = rig_on(folder)
    path = folder / "images/003.png"
    data = bytearray(path.read_bytes())
    data[40] ^= 1
    path.write_bytes(data)
    rig.move_to(POSES[3])
    with pytest.raises(ImageGridError, match=r"images/003\.png: the picture is damaged"):
        rig.capture()
    path.unlink()
    with pytest.raises(ImageGridError, match=r"images/003\.png"):
        rig.capture()
    rig.move_to(POSES[2])
    assert np.array_equal(rig.capture().image, picture(2))


@pytest.mark.parametrize(
    ("wish", "cell"),
    [
        ((4.0, 0.0, 5.0, 0.0, 0.25), (0.0, 0.0, 5.0, 0.0, 0.25)),
        ((6.0, 6.0, 5.0, 8.0, 0.6), (10.0, 10.0, 5.0, 15.0, 0.75)),
        ((20.0, 10.0, 5.0, -15.0, 0.25), (20.0, 10.0, 5.0, -15.0, 0.25)),
    ],
)
def test_a_wish_snaps_to_the_nearest_cell(folder: Path, wish: tuple[float, ...], cell: tuple[float, ...]) -> None:
    assert rig_on(folder).nearest(RigPose(*wish)) == RigPose(*cell)


def test_a_pan_counts_as_the_millimetres_that_it_sweeps(tmp_path: Path) -> None:
    # At 100 mm a degree sweeps 1.7 mm: the cell that is 10 mm aside is nearer than the one that is 10 degrees aside.
    aside, turned = RigPose(10.0, 0.0, 0.0, 0.0), RigPose(0.0, 0.0, 0.0, 10.0)
    grid = read_grid(write_grid(tmp_path, [aside, turned]))
    for distance_mm, near in ((50.0, turned), (100.0, aside), (1000.0, aside)):
        rig = ImageGridRig(grid, limits_of(grid), internals_fixed_by_zoom=True, distance_mm=distance_mm)
        assert rig.nearest(RigPose(0.0, 0.0, 0.0, 0.0)) == near


def test_between_cells_is_refused_and_the_axis_named(folder: Path) -> None:
    rig = rig_on(folder)
    with pytest.raises(UnreachableError, match=r"x_mm = 12 \(there 10\).*nearest\(\)") as caught:
        rig.move_to(replace(POSES[0], x_mm=12.0))
    assert "y_mm" not in str(caught.value)
    assert rig.pose == POSES[0]


def test_the_pan_wraps_on_a_full_circle_only(tmp_path: Path) -> None:
    poses = [RigPose(0.0, 0.0, 0.0, theta) for theta in (-170.0, -90.0, 0.0, 90.0, 170.0)]
    folder = write_grid(tmp_path, poses)
    rig = rig_on(folder)
    assert (rig.limits.theta_deg.lower, rig.limits.theta_deg.upper) == (-180.0, 180.0)
    assert rig.nearest(RigPose(0.0, 0.0, 0.0, 190.0)).theta_deg == -170.0
    assert rig.nearest(RigPose(0.0, 0.0, 0.0, 179.0)).theta_deg == 170.0
    assert rig.nearest(RigPose(0.0, 0.0, 0.0, -179.0)).theta_deg == -170.0
    assert rig.move_to(RigPose(0.0, 0.0, 0.0, 190.0)).theta_deg == -170.0
    assert rig.travel_s(poses[0], poses[4]) == pytest.approx(20.0 / 5.0 + 0.6)
    stops = replace(rig.limits, theta_deg=AxisLimits(-175.0, 175.0, 5.0))
    stopped = ImageGridRig(read_grid(folder), stops, internals_fixed_by_zoom=True)
    assert stopped.travel_s(poses[0], poses[4]) == pytest.approx(340.0 / 5.0 + 0.6)
    with pytest.raises(UnreachableError, match="theta_deg = 190"):
        stopped.nearest(RigPose(0.0, 0.0, 0.0, 190.0))


def test_travel_is_that_of_the_slowest_axis_and_the_clock_goes_with_it(folder: Path) -> None:
    rig = rig_on(folder)
    start, end = POSES[0], RigPose(20.0, 10.0, 5.0, -15.0, 0.25)
    assert rig.travel_s(start, end) == pytest.approx(2.6)
    assert rig.travel_s(start, replace(start, theta_deg=15.0)) == pytest.approx(6.6)
    assert rig.travel_s(start, replace(start, zoom=0.75)) == pytest.approx(1.6)
    before = rig.capture().exposed_at_s
    rig.move_to(end)
    assert rig.capture().exposed_at_s - before == pytest.approx(2.6)


def test_cells_beyond_the_limits_are_not_offered(folder: Path) -> None:
    grid = read_grid(folder)
    narrow = replace(limits_of(grid), x_mm=AxisLimits(5.0, 20.0, 10.0))
    rig = ImageGridRig(grid, narrow, internals_fixed_by_zoom=True)
    assert {pose.x_mm for pose in rig.reachable()} == {10.0, 20.0}
    with pytest.raises(UnreachableError, match=r"x_mm = 0 is outside 5 \.\. 20"):
        rig.move_to(POSES[0])
    with pytest.raises(InputError, match=r"none of the grid's pictures.*x_mm = 0 is outside 50 \.\. 60"):
        ImageGridRig(grid, replace(narrow, x_mm=AxisLimits(50.0, 60.0, 10.0)), internals_fixed_by_zoom=True)


def test_noise_is_on_what_is_read_back_and_the_picture_stays(folder: Path) -> None:
    rig = rig_on(folder, mm=0.2, deg=0.05)
    cell = POSES[7]
    read = np.zeros((400, 5))
    for row in read:
        back = rig.move_to(cell)
        row[:] = [back.x_mm, back.y_mm, back.z_mm, back.theta_deg, back.zoom]
        assert rig.pose == back
    off = read - [cell.x_mm, cell.y_mm, cell.z_mm, cell.theta_deg, cell.zoom]
    np.testing.assert_allclose(off.std(axis=0), [0.2, 0.2, 0.2, 0.05, 0.0], rtol=0.15)
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.05)
    frame = rig.capture()
    assert frame.rig_pose == rig.pose != frame.commanded == cell
    assert np.array_equal(frame.image, picture(7))


def test_the_same_generator_gives_the_same_noise(folder: Path) -> None:
    runs = [[rig_on(folder, mm=0.2).move_to(pose) for pose in POSES[:4]] for _ in range(2)]
    assert runs[0] == runs[1]


@pytest.mark.parametrize("sd", [-1.0, float("nan"), float("inf")])
def test_noise_that_is_no_standard_deviation_is_refused(folder: Path, sd: float) -> None:
    with pytest.raises(InputError, match="repeatability_mm"):
        rig_on(folder, mm=sd)


def test_noise_without_a_generator_is_refused(folder: Path) -> None:
    grid = read_grid(folder)
    with pytest.raises(InputError, match="random generator"):
        ImageGridRig(grid, limits_of(grid), internals_fixed_by_zoom=True, repeatability_deg=0.1)


def test_pictures_do_not_pile_up_in_memory(tmp_path: Path) -> None:
    rig = rig_on(write_grid(tmp_path, POSES))
    held = []
    tracemalloc.start()
    for _ in range(3):
        for pose in POSES:
            rig.move_to(pose)
            rig.capture()
        held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    # One round of pictures is 36 x 1152 bytes; what stays must not grow by even a few of them.
    assert held[2] - held[1] < 4 * 1152


@pytest.mark.realdata
def test_the_castle_is_served_whole(real_data: Path) -> None:
    rig = open_rig(load_bench(CASTLE_BENCH), real_data / "castle")
    assert len(rig.reachable()) == 250
    assert rig.internals_fixed_by_zoom
    assert len({(pose.x_mm, pose.z_mm) for pose in rig.reachable()}) == 30
    for pose in list(rig.reachable())[::50]:
        rig.move_to(pose)
        frame = rig.capture()
        assert frame.image.shape == (960, 1280, 3)
        assert frame.rig_pose == pose


@pytest.mark.realdata
def test_castle_wishes_stay_at_the_place_and_turn(real_data: Path) -> None:
    rig = open_rig(load_bench(CASTLE_BENCH), real_data / "castle")
    here = rig.grid.frame("p00_t_m0375").pose
    assert rig.nearest(replace(here, x_mm=here.x_mm + 300.0, theta_deg=here.theta_deg + 1.0)) == here
    assert rig.nearest(replace(here, theta_deg=here.theta_deg - 7.0)).theta_deg == pytest.approx(here.theta_deg - 7.5)
