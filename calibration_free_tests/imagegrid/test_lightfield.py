"""A light field becomes a full lattice, its columns along +X and its rows along +Y."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration_free_tests.imagegrid.sample import encoded, picture
from rig.bench import load_bench, open_rig
from rig.errors import ImageError, ImageGridError, InputError
from rig.gridconvert import import_lightfield
from rig.hal import RigPose

BENCH = Path(__file__).parents[2] / "examples" / "lightfield.yaml"


@pytest.fixture
def source(tmp_path: Path) -> Path:
    folder = tmp_path / "field"
    folder.mkdir()
    for row in (0, 2, 4):
        for column in (0, 2):
            data = encoded(picture(row * 10 + column), ".jpg")
            (folder / f"r{row:02d}_c{column:02d}.jpg").write_bytes(data)
    (folder / "LICENSE.md").write_text("none of ours")
    return folder


def test_rows_go_down_and_columns_to_the_right(source: Path, tmp_path: Path) -> None:
    grid = import_lightfield(source, tmp_path / "grid", step_mm=2.5)
    assert grid.is_full_lattice
    assert grid.info.internals == "change_every_view"
    assert "2.5 mm" in grid.info.provenance
    assert grid.frame("r04_c02").pose == RigPose(5.0, 10.0, 0.0, 0.0, 0.0)
    assert not open_rig(load_bench(BENCH), tmp_path / "grid").internals_fixed_by_zoom


def test_pictures_are_copied_byte_for_byte(source: Path, tmp_path: Path) -> None:
    import_lightfield(source, tmp_path / "grid")
    for file in source.glob("*.jpg"):
        assert (tmp_path / "grid" / "images" / file.name).read_bytes() == file.read_bytes()


def test_a_missing_place_is_named(source: Path, tmp_path: Path) -> None:
    (source / "r02_c02.jpg").unlink()
    with pytest.raises(ImageGridError, match="row 2, column 2 is missing"):
        import_lightfield(source, tmp_path / "grid")
    assert not (tmp_path / "grid").exists()


def test_two_pictures_of_one_place_are_refused(source: Path, tmp_path: Path) -> None:
    (source / "r2_c2.jpg").write_bytes((source / "r02_c02.jpg").read_bytes())
    with pytest.raises(ImageGridError, match=r"r2_c2\.jpg: is of the same row and column as r02_c02\.jpg"):
        import_lightfield(source, tmp_path / "grid")


def test_a_damaged_picture_is_named(source: Path, tmp_path: Path) -> None:
    path = source / "r02_c02.jpg"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ImageError, match=r"r02_c02\.jpg: the picture is cut off"):
        import_lightfield(source, tmp_path / "grid")


@pytest.mark.parametrize("step_mm", [0.0, -1.0, float("nan"), float("inf")])
def test_a_step_that_is_no_length_is_refused(source: Path, tmp_path: Path, step_mm: float) -> None:
    with pytest.raises(InputError, match="step_mm"):
        import_lightfield(source, tmp_path / "grid", step_mm)


def test_other_folders_are_refused(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError, match="no pictures of a light field"):
            import_lightfield(folder, tmp_path / "grid")


def shift_px(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(dx, dy) by which the content of ``before`` has moved in ``after``."""
    grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32) for image in (before, after)]
    window = cv2.createHanningWindow((before.shape[1], before.shape[0]), cv2.CV_32F)
    return np.array(cv2.phaseCorrelate(grey[0], grey[1], window)[0])


@pytest.mark.realdata
def test_a_real_gantrys_grid_has_the_signs_of_the_rig_frame(real_data: Path, tmp_path: Path) -> None:
    """The near edge of the board is at the bottom of the picture: seen against the far edge, it must move to the left
    when the camera moves to the right (+X), and up when the camera moves down (+Y), evenly."""
    import_lightfield(real_data / "grid_chess9x9", tmp_path / "grid")
    rig = open_rig(load_bench(BENCH), tmp_path / "grid")
    assert rig.grid.is_full_lattice
    assert len(rig.reachable()) == 81

    def seen(x_mm: float, y_mm: float) -> np.ndarray:
        rig.move_to(rig.nearest(RigPose(x_mm, y_mm, 0.0, 0.0)))
        return rig.capture().image

    def parallax_px(dx_mm: float, dy_mm: float) -> np.ndarray:
        here, there = seen(8.0, 8.0), seen(8.0 + dx_mm, 8.0 + dy_mm)
        height = here.shape[0]
        near, far = slice(2 * height // 3, height), slice(0, height // 3)
        return np.asarray(shift_px(here[near], there[near]) - shift_px(here[far], there[far]))

    one, two, back = parallax_px(2.0, 0.0), parallax_px(4.0, 0.0), parallax_px(-2.0, 0.0)
    assert one[0] < -2.5
    np.testing.assert_allclose([two[0], back[0]], [2 * one[0], -one[0]], rtol=0.15)
    one_down, two_down = parallax_px(0.0, 2.0), parallax_px(0.0, 4.0)
    assert one_down[1] < -2.5
    assert two_down[1] == pytest.approx(2 * one_down[1], rel=0.15)
    assert max(abs(one[1]), abs(one_down[0])) < 0.5
