"""`rig align` from a scan on the disk to the bench file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration_free_tests.alignment.synthetic import HUNG, LENS, lattice
from calibration_free_tests.alignment.textured_wall import pictures, textured_wall, write_scan
from recognition.alignment.estimate import MOUNT
from rig.bench import load_bench
from rig.cli.app import app
from rig.imagegrid import GridInfo

POSES = lattice(zs=(0.0,))
BENCH = "schema: 1\nkind: mock\nmotion: {sd_mm: 0.05, sd_deg: 0.02}  # as the maker says\nmount: {y_mm: -7}\n"

Align = Callable[..., int | str | None]


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """18 views at zoom 0, of a rig that repeats to 0.05 mm and 0.02 degrees, and one at zoom 1."""
    rng = np.random.default_rng(1)
    images = list(pictures(textured_wall(1), POSES, HUNG, LENS, rng, sd_mm=0.05, sd_deg=0.02))
    poses = [*POSES, replace(POSES[0], zoom=1.0)]
    return write_scan(tmp_path_factory.mktemp("scans") / "wall", poses, iter([*images, images[0]]))


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan without pans."""
    poses = lattice(zs=(0.0,), pans=(0.0,))
    images = pictures(textured_wall(2), poses, HUNG, LENS, np.random.default_rng(2))
    return write_scan(tmp_path_factory.mktemp("scans") / "still", poses, images)


@pytest.fixture
def align(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Align:
    """Run ``rig align`` in a folder that holds a bench file; returns the exit code."""
    monkeypatch.chdir(tmp_path)
    Path("bench.yaml").write_text(BENCH)

    def run(*arguments: str | Path) -> int | str | None:
        with pytest.raises(SystemExit) as end:
            app(["align", *map(str, arguments)], prog_name="rig")
        return end.value.code

    return run


def test_the_mount_goes_from_the_scan_into_a_new_bench_file(
    scan: Path, align: Align, capsys: pytest.CaptureFixture[str]
) -> None:
    assert align(scan, "--bench", "bench.yaml", "--out", "aligned.yaml", "--json") == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert said.err.strip().endswith("written: aligned.yaml")
    assert set(found) == {
        *("zoom", "views", "points", "observations", "agreeing", "motion", "residual_px", "estimate", "sd"),
        *("covariance", "unobservable", "advice", "mount"),
    }
    assert (found["zoom"], found["views"], found["unobservable"]) == (0.0, 18, {"y_mm": []})
    assert 0.05 <= found["motion"]["sd_mm"] < 0.1
    for k, name in enumerate(MOUNT):
        assert abs(found["estimate"][name] - getattr(HUNG, name)) < 3.5 * found["sd"][name]
        assert found["covariance"][k][k] == pytest.approx(found["sd"][name] ** 2, rel=1e-3)
    assert found["sd"]["x_mm"] < 1.0
    mount = load_bench(Path("aligned.yaml")).mount
    assert mount.y_mm == -7.0
    assert {name: getattr(mount, name) for name in MOUNT} == {name: found["mount"][name] for name in MOUNT}
    assert "# as the maker says\n" in Path("aligned.yaml").read_text()
    assert Path("bench.yaml").read_text() == BENCH
    # Once more: what is there stays.
    before = Path("aligned.yaml").read_text()
    assert align(scan, "--bench", "bench.yaml", "--out", "aligned.yaml", "--views", "9") == 2
    assert "aligned.yaml: is there already" in capsys.readouterr().err
    assert Path("aligned.yaml").read_text() == before


def test_the_report_tells_values_sds_the_line_and_what_was_left(
    scan: Path, align: Align, capsys: pytest.CaptureFixture[str]
) -> None:
    assert align(scan, "--views", "12") == 0
    said = capsys.readouterr().out
    assert said.startswith("12 views at zoom 0:")
    rows = {line.split()[0]: line.split()[1:] for line in said.splitlines() if line.startswith(MOUNT)}
    assert list(rows) == list(MOUNT)
    assert float(rows["z_mm"][0]) == pytest.approx(45.0, abs=4 * float(rows["z_mm"][1]))
    line = yaml.safe_load(next(line for line in said.splitlines() if line.startswith("  mount: ")))
    assert [line["mount"][name] for name in MOUNT] == pytest.approx([float(rows[name][0]) for name in MOUNT], abs=6e-4)
    assert "y_mm cannot be seen from pans" in said
    assert "12 of 18 pictures were used" in said


def test_without_pans_the_arm_is_not_seen_and_the_bench_keeps_its_own(
    still: Path, align: Align, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("bench.yaml").write_text(BENCH.replace("y_mm: -7", "x_mm: 3, pan_zero_deg: 9"))
    assert align(still, "--bench", "bench.yaml", "--out", "new.yaml") == 0
    said = capsys.readouterr().out
    assert [line.split()[1:] for line in said.splitlines() if line.startswith(("x_mm", "z_mm"))] == [
        ["not", "seen"]
    ] * 2
    assert "x_mm and z_mm of the lever arm: the scan has no pan moves" in said
    mount = load_bench(Path("new.yaml")).mount
    assert (mount.x_mm, mount.z_mm) == (3.0, 0.0)
    assert mount.pan_zero_deg == pytest.approx(1.5, abs=1.0)


def test_what_cannot_be_is_refused(
    scan: Path, tmp_path: Path, align: Align, capsys: pytest.CaptureFixture[str]
) -> None:
    assert align(scan, "--zoom", "0.5") == 2
    assert "no picture was taken at zoom 0.5. The scan has 0, 1" in capsys.readouterr().err
    assert align(scan, "--zoom", "1") == 1
    assert "1 views are too few" in capsys.readouterr().err
    assert align(scan, "--out", "new.yaml") == 2
    assert "Name it with --bench" in capsys.readouterr().err
    poses = POSES[:3]
    info = GridInfo(internals="change_every_view")
    images = (np.zeros((48, 64, 3), dtype=np.uint8) for _ in poses)
    changing = write_scan(tmp_path / "changing", poses, images, info)
    assert align(changing) == 2
    assert "internals change with every view" in capsys.readouterr().err
    assert not Path("new.yaml").exists()


def test_pictures_without_texture_and_of_other_sizes_are_refused(
    tmp_path: Path, align: Align, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = write_scan(tmp_path / "flat", POSES[:4], (np.full((48, 64, 3), 99, dtype=np.uint8) for _ in range(4)))
    assert align(flat) == 1
    assert "only 0 points" in capsys.readouterr().err
    sizes = ((48, 64 + k, 3) for k in range(4))
    mixed = write_scan(tmp_path / "mixed", POSES[:4], (np.zeros(size, dtype=np.uint8) for size in sizes))
    assert align(mixed) == 2
    assert "different sizes. Scan with one size" in capsys.readouterr().err
