"""Bench files are read strictly, and what they leave out comes from the grid."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from calibration_free_tests.imagegrid.sample import lattice, write_grid
from recognition.geometry import Mount
from recognition.rates import DetectionRates
from recognition.settings import BenchBounds, RecogniserSettings
from rig.bench import default_bench_for_grid, load_bench, open_rig
from rig.cli.app import app
from rig.errors import ImageGridError, InputError
from rig.hal import AxisLimits, RigPose
from rig.imagegrid import GridInfo

EXAMPLES = Path(__file__).parents[2] / "examples"
BENCHES = sorted({*EXAMPLES.glob("*.yaml")} - {*EXAMPLES.glob("scan*.yaml")})
HEAD = "schema: 1\nkind: mock\n"


def bench(folder: Path, text: str) -> Path:
    path = folder / "bench.yaml"
    path.write_text(HEAD + text)
    return path


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return write_grid(tmp_path / "grid", lattice())


@pytest.mark.parametrize(
    "path", sorted({*EXAMPLES.glob("*.yaml")} - {*EXAMPLES.glob("scan*.yaml")}), ids=lambda p: p.stem
)
def test_the_examples_are_good_bench_files(path: Path) -> None:
    config = load_bench(path)
    assert config.bounds().distance_min_mm > 0
    assert not str(getattr(config.file, "grid", None) or "").startswith("/")


def test_rates_count_as_measured_where_the_bench_says_so(tmp_path: Path) -> None:
    told = load_bench(bench(tmp_path, "detection: {found: 0.8, clutter: 0.2, measured: true}\n"))
    assert told.rates == DetectionRates(found=0.8, clutter=0.2, measured=True)


def test_the_castle_bench_says_what_was_told_and_no_more() -> None:
    config = load_bench(EXAMPLES / "castle.yaml")
    assert config.bounds() == BenchBounds(4000.0, 60_000.0, 15.0, 60.0)
    assert config.file.camera.internals == "fixed_by_zoom"
    assert config.mount == Mount()
    assert config.grid is None
    assert config.rates == DetectionRates(found=0.6, clutter=80.0, corner_sd_px=1.0)
    assert config.goal.pose_sd_mm is not None
    assert config.goal.pose_sd_deg is not None


def test_what_a_bench_leaves_out_of_the_detector_stays_as_it_was(tmp_path: Path) -> None:
    config = load_bench(bench(tmp_path, "detection: {clutter: 7}\ngoal: {pose_sd_deg: 0.3}\n"))
    assert config.rates == DetectionRates(clutter=7.0)
    assert (config.goal.pose_sd_mm, config.goal.pose_sd_deg) == (None, 0.3)
    plain = load_bench(bench(tmp_path, ""))
    assert plain.rates == DetectionRates() == RecogniserSettings().rates
    assert (plain.goal.pose_sd_mm, plain.goal.pose_sd_deg) == (None, None)


def test_the_example_with_every_key_has_every_key() -> None:
    text = (EXAMPLES / "mock.yaml").read_text()
    file = load_bench(EXAMPLES / "mock.yaml").file
    assert all(f"\n{field.alias or name}:" in f"\n{text}" for name, field in type(file).model_fields.items())


def test_the_mock_example_says_how_the_image_grid_is_made_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "examples").mkdir()
    example = Path(shutil.copy(EXAMPLES / "mock.yaml", tmp_path / "examples"))
    told = re.search(r"`rig (simulate [^`]*)`", example.read_text())
    assert told is not None
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="0"):
        app([*told[1].split(), "--views", "2"], prog_name="rig")
    with open_rig(load_bench(example)) as rig:
        assert rig.pose


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("axis: {}\n", ":3:1: axis: unknown key. Did you mean 'axes'?"),
        ("axes: {x_mm: {lower: 5, upper: 1}}\n", ":3:14: axes.x_mm: lower (5) is above upper (1)"),
        ("axes: {x_mm: {lower: 5}}\n", ":3:14: axes.x_mm: give both lower and upper, or neither"),
        ("axes: {x_mm: {speed_deg_per_s: 5}}\n", ":3:15: axes.x_mm.speed_deg_per_s: unknown key"),
        ("axes: {x_mm: {speed_mm_per_s: 0}}\n", ":3:31: axes.x_mm.speed_mm_per_s: should be greater than 0"),
        ("axes: {zoom: {lower: 0, upper: 2}}\n", ":3:32: axes.zoom.upper: should be less than or equal to 1"),
        ("axes: {x_mm: {lower: .nan, upper: 1}}\n", ":3:22"),
        ("axes: {x_mm: {lower: 1e3, upper: '4'}}\n", ":3:34: axes.x_mm.upper: should be a number"),
        ("camera: {view_angle_deg: [60, 15]}\n", ":3:9: camera: should rise from the smallest to the largest"),
        ("camera: {view_angle_deg: [15, 180]}\n", ":3:31: camera.view_angle_deg[1]: should be less than 180"),
        ("camera: {view_angle_deg: [15]}\n", "camera.view_angle_deg"),
        ("camera: {internals: fixed}\n", ":3:21: camera.internals: should be 'fixed_by_zoom' or 'change_every_view'"),
        ("object: {distance_mm: [0, 5]}\n", ":3:24: object.distance_mm[0]: should be greater than 0"),
        ("motion: {sd_mm: -1}\n", ":3:17: motion.sd_mm: should be greater than or equal to 0"),
        ("detection: {found: 1}\n", ":3:20: detection.found: should be less than 1"),
        ("detection: {found: 0}\n", ":3:20: detection.found: should be greater than 0"),
        ("detection: {clutter: 0}\n", ":3:22: detection.clutter: should be greater than 0"),
        ("detection: {corner_sd_px: .inf}\n", ":3:27: .inf is not a finite number"),
        ("detection: {noise: 1}\n", ":3:13: detection.noise: unknown key"),
        ("goal: {pose_sd_mm: 0}\n", ":3:20: goal.pose_sd_mm: should be greater than 0"),
        ("goal: {pose_sd_deg: .nan}\n", ":3:21: .nan is not a finite number"),
        ("goal: {pose_sd: 3}\n", ":3:8: goal.pose_sd: unknown key. Did you mean 'pose_sd_mm'"),
        ("mount: {x_mm: 1, x_mm: 2}\n", ":3:18"),
        ("grid: 7\n", ":3:7: grid: should be text"),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(InputError) as caught:
        load_bench(bench(tmp_path, text))
    assert caught.value.exit_code == 2
    assert f"bench.yaml{what}" in str(caught.value) or what in str(caught.value)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("kind: mock\n", "schema: this key is missing"),
        ("schema: 2\nkind: mock\n", "bench.yaml:1:9: schema: should be 1"),
        ("schema: 1\nkind: gantry\n", "bench.yaml:2:7: kind: should be 'mock'"),
        ("- 1\n", "bench.yaml:1:1"),
    ],
)
def test_another_kind_of_file_is_refused(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_bench(path)
    assert what in str(caught.value)


def test_limits_and_speeds_come_from_bench_then_grid(tmp_path: Path, grid: Path) -> None:
    text = "axes: {x_mm: {lower: -5, upper: 15, speed_mm_per_s: 7}, theta_deg: {speed_deg_per_s: 9}}\n"
    rig = open_rig(load_bench(bench(tmp_path, text + "timing: {settle_s: 0.5, exposure_s: 0.25}\n")), grid)
    assert rig.limits.x_mm == AxisLimits(-5.0, 15.0, 7.0)
    assert rig.limits.y_mm == AxisLimits(0.0, 10.0, 100.0)
    assert rig.limits.theta_deg == AxisLimits(-15.0, 15.0, 9.0)
    assert (rig.limits.settle_s, rig.limits.exposure_s) == (0.5, 0.25)
    assert {pose.x_mm for pose in rig.reachable()} == {0.0, 10.0}


def test_the_grid_is_found_from_the_bench_file_and_another_takes_its_place(tmp_path: Path, grid: Path) -> None:
    config = load_bench(bench(tmp_path, "grid: grid\n"))
    assert len(open_rig(config).reachable()) == 36
    other = write_grid(tmp_path / "other", lattice()[:5])
    assert len(open_rig(config, other).reachable()) == 5


def test_a_bench_without_a_grid_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"bench\.yaml: the bench names no image grid\. Give one with --grid"):
        open_rig(load_bench(bench(tmp_path, "")))


@pytest.mark.parametrize(
    ("told", "of_grid", "fixed"),
    [
        (None, None, False),
        (None, "fixed_by_zoom", True),
        (None, "change_every_view", False),
        ("fixed_by_zoom", "change_every_view", True),
        ("change_every_view", "fixed_by_zoom", False),
    ],
)
def test_internals_are_as_the_bench_says_or_else_the_grid(
    tmp_path: Path, told: str | None, of_grid: str | None, fixed: bool
) -> None:
    grid = write_grid(tmp_path / "grid", lattice()[:2], GridInfo.model_validate({"internals": of_grid}))
    text = "" if told is None else f"camera: {{internals: {told}}}\n"
    assert open_rig(load_bench(bench(tmp_path, text)), grid).internals_fixed_by_zoom is fixed


def test_a_grid_without_a_bench_gets_wide_bounds_and_promises_nothing(grid: Path) -> None:
    config = default_bench_for_grid(grid)
    assert config.bounds() == BenchBounds()
    rig = open_rig(config)
    assert rig.pose == lattice()[0]
    assert not rig.internals_fixed_by_zoom


def test_a_large_grid_is_crossed_in_bearable_time(tmp_path: Path) -> None:
    grid = write_grid(tmp_path, [RigPose(0.0, 0.0, 0.0, 0.0), RigPose(40_000.0, 0.0, 0.0, 0.0)])
    rig = open_rig(default_bench_for_grid(grid))
    assert rig.travel_s(*rig.reachable()) == pytest.approx(20.0)


def test_what_a_partial_grid_lacks_is_told(grid: Path) -> None:
    (grid / "images/003.png").unlink()
    with pytest.raises(ImageGridError, match=r"images/003\.png is missing"):
        open_rig(default_bench_for_grid(grid))
    told: list[str] = []
    rig = open_rig(default_bench_for_grid(grid), allow_partial=True, notice=told.append)
    assert len(rig.reachable()) == 35
    assert len(told) == 1
    assert "images/003.png is missing" in told[0]


def test_noise_and_trust_are_two_things(tmp_path: Path, grid: Path) -> None:
    config = load_bench(bench(tmp_path, "motion: {sd_mm: 0.5}\nrepeatability: {sd_mm: 0.25, sd_deg: 0.1}\n"))
    assert (config.bounds().motion_sd_mm, config.bounds().motion_sd_deg) == (0.5, 0.0)
    rig = open_rig(config, grid)
    assert 0.0 < abs(rig.pose.x_mm - lattice()[0].x_mm) < 2.0
    assert open_rig(config, grid).pose == rig.pose
