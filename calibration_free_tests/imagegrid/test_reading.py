"""Image grids are read strictly: every fault is refused by name, with the line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.imagegrid.sample import lattice, lines_of, picture, write_grid, write_lines
from rig.errors import ImageGridError
from rig.imagegrid import GridInfo, read_grid


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_grid(tmp_path / "grid", lattice()[:6])


def test_a_grid_without_grid_yaml_is_read(folder: Path) -> None:
    (folder / "grid.yaml").unlink()
    grid = read_grid(folder)
    assert grid.info == GridInfo()
    assert [f.pose for f in grid.frames] == lattice()[:6]
    assert np.array_equal(grid.load(grid.frames[2]), picture(2))


def test_what_is_known_of_the_grid_is_read(tmp_path: Path) -> None:
    info = GridInfo(provenance="a test: äöü\nyes", image_size=(24, 16), internals="change_every_view")
    assert read_grid(write_grid(tmp_path / "grid", lattice()[:2], info)).info == info


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("schema: 1\nunits: {length: inch}\n", r"grid\.yaml:2:17: units\.length: should be 'mm'"),
        ("schema: 2\n", r"grid\.yaml:1:9: schema: should be 1"),
        ("schema: 1\nprovenence: me\n", r"grid\.yaml:2:1: provenence: unknown key\. Did you mean 'provenance'"),
        ("", r"grid\.yaml"),
    ],
)
def test_bad_information_is_refused_with_its_place(folder: Path, text: str, what: str) -> None:
    (folder / "grid.yaml").write_text(text)
    with pytest.raises(ImageGridError, match=what):
        read_grid(folder)


def test_another_size_than_the_grid_says_is_refused(folder: Path) -> None:
    (folder / "grid.yaml").write_text("schema: 1\nimage_size: [24, 17]\n")
    with pytest.raises(ImageGridError, match=r"frames\.jsonl:1: images/000\.png is 24 x 16 pixels, grid\.yaml says"):
        read_grid(folder)


def test_the_size_in_grid_yaml_holds_where_lines_tell_none(folder: Path) -> None:
    write_lines(folder, [{k: v for k, v in line.items() if k not in ("width", "height")} for line in lines_of(folder)])
    grid = read_grid(folder)
    assert grid.load(grid.frames[0]).shape == (16, 24, 3)
    (folder / "grid.yaml").write_text("schema: 1\nimage_size: [24, 17]\n")
    grid = read_grid(folder)
    with pytest.raises(ImageGridError, match=r"000\.png: is 16 pixels high, the manifest says 17"):
        grid.load(grid.frames[0])


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"x_mm": "0"}, "x_mm: should be a number"),
        ({"x_mm": True}, "x_mm: should be a number"),
        ({"x_mm": 2e9}, "x_mm"),
        ({"y_mm": None}, "y_mm: should be a number"),
        ({"zoom": 1.5}, "zoom"),
        ({"theta": 3.0}, "theta: unknown key. Did you mean 'theta_deg'?"),
        ({"width": 24.5}, "width"),
        ({"width": 0}, "width"),
        ({"sha256": "0" * 63}, "sha256"),
        ({"file": "/etc/passwd.png"}, "file: should be a path inside"),
        ({"file": "../elsewhere.png"}, "file: should be a path inside"),
        ({"file": "images/../../elsewhere.png"}, "file: should be a path inside"),
        ({"file": "images//000.png"}, "file: should be a path inside"),
        ({"file": "images\\000.png"}, "file: should have no control"),
        ({"file": "C:/000.png"}, "file: should have no control"),
        ({"file": "images/000.png\n"}, "file: should have no control"),
        ({"file": "\ud800.png"}, "file: should be a valid string"),
        ({"file": ""}, "file"),
        ({"commanded": {"x_mm": 1.0}}, "commanded.y_mm: this key is missing"),
        ({"exposure_s": -1.0}, "exposure_s"),
    ],
)
def test_a_bad_value_is_refused_with_file_line_and_key(folder: Path, change: dict[str, Any], what: str) -> None:
    lines = lines_of(folder)
    lines[3] |= change
    write_lines(folder, lines)
    with pytest.raises(ImageGridError) as caught:
        read_grid(folder, allow_partial=True)
    assert "frames.jsonl:4: " in str(caught.value)
    assert what in str(caught.value)


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("{", "this is not JSON"),
        ("[1, 2]", "not a JSON object"),
        ('{"file": "a.png", "file": "b.png"}', "the key 'file' stands there twice"),
        ('{"x_mm": NaN}', "NaN is not a finite number"),
        ('{"x_mm": 1e999}', "x_mm"),
        ('{"x_mm": 1' + "0" * 400 + "}", "x_mm"),
        ('{"width": 1' + "0" * 5000 + "}", "frames.jsonl:3"),
        ("[" * 50_000, "nested too deeply"),
        ('{"file": "' + "a" * 70_000 + '"}', "longer than 64 KiB"),
    ],
)
def test_a_bad_line_is_refused_with_its_number(folder: Path, line: str, what: str) -> None:
    write_lines(folder, [*lines_of(folder)[:2], line, *lines_of(folder)[2:]])
    with pytest.raises(ImageGridError) as caught:
        read_grid(folder, allow_partial=True)
    assert "frames.jsonl:3" in str(caught.value)
    assert what in str(caught.value)


def test_bytes_that_are_no_text_are_refused(folder: Path) -> None:
    with (folder / "frames.jsonl").open("ab") as stream:
        stream.write(b'{"file": "\xff.png"}\n')
    with pytest.raises(ImageGridError, match=r"frames\.jsonl:7: the byte 0xff"):
        read_grid(folder)


@given(st.binary(max_size=200))
@settings(max_examples=200, deadline=None)
def test_no_bytes_whatever_bring_the_reader_down(tmp_path_factory: pytest.TempPathFactory, text: bytes) -> None:
    folder = tmp_path_factory.getbasetemp()
    (folder / "frames.jsonl").write_bytes(text)
    with pytest.raises(ImageGridError, match=r"frames\.jsonl"):
        read_grid(folder)


def test_all_bad_lines_are_told_at_once(folder: Path) -> None:
    lines = lines_of(folder)
    lines[1]["zoom"] = 2.0
    del lines[4]["sha256"]
    write_lines(folder, lines)
    with pytest.raises(ImageGridError) as caught:
        read_grid(folder)
    assert "frames.jsonl:2: zoom" in str(caught.value)
    assert "frames.jsonl:5: sha256: this key is missing" in str(caught.value)


def test_the_same_file_twice_is_refused(folder: Path) -> None:
    lines = lines_of(folder)
    lines[4]["file"] = lines[1]["file"]
    write_lines(folder, lines)
    with pytest.raises(ImageGridError, match=r"frames\.jsonl:5: images/001\.png is listed a second time.*line 2"):
        read_grid(folder, allow_partial=True)


@pytest.mark.parametrize("turns", [0, 1, -1])
def test_the_same_pose_twice_is_refused_also_a_full_turn_apart(folder: Path, turns: int) -> None:
    lines = lines_of(folder)
    for axis in ("x_mm", "y_mm", "z_mm", "theta_deg", "zoom"):
        lines[4][axis] = lines[1][axis]
    lines[4]["theta_deg"] += 360.0 * turns
    write_lines(folder, lines)
    with pytest.raises(
        ImageGridError, match=r"frames\.jsonl:5: images/004\.png .* same pose as images/001\.png \(line 2"
    ):
        read_grid(folder, allow_partial=True)


def test_missing_pictures_are_refused_by_name_and_line(folder: Path) -> None:
    (folder / "images/002.png").unlink()
    (folder / "images/005.png").unlink()
    with pytest.raises(ImageGridError) as caught:
        read_grid(folder)
    assert "frames.jsonl:3: images/002.png is missing" in str(caught.value)
    assert "frames.jsonl:6: images/005.png is missing" in str(caught.value)
    assert "--allow-partial" in str(caught.value)


def test_a_partial_grid_goes_on_and_tells_what_is_missing(folder: Path) -> None:
    (folder / "images/002.png").unlink()
    grid = read_grid(folder, allow_partial=True)
    assert len(grid.left_out) == 1
    assert "images/002.png is missing" in grid.left_out[0]
    assert [f.file for f in grid.frames] == [f"images/{k:03d}.png" for k in (0, 1, 3, 4, 5)]
    with pytest.raises(ImageGridError, match=r"no picture is called 'images/002\.png'"):
        grid.frame("images/002.png")


def test_missing_cells_of_a_lattice_are_refused_by_their_pose(tmp_path: Path) -> None:
    poses = lattice()
    folder = write_grid(tmp_path / "grid", poses[:7] + poses[8:], GridInfo(layout="lattice"))
    with pytest.raises(ImageGridError, match=r"no picture of the cell x_mm = 0, y_mm = 10, .* zoom = 0\.75"):
        read_grid(folder)
    grid = read_grid(folder, allow_partial=True)
    assert len(grid.frames) == len(poses) - 1
    assert len(grid.left_out) == 1
    assert not grid.is_full_lattice


def test_scattered_places_that_call_themselves_a_lattice_are_refused_in_one_line(tmp_path: Path) -> None:
    scattered = lattice([0.0], [0.0], [0.0], [0.5])
    scattered += [type(p)(k * 1.1, k * 2.2, k * 3.3, k * 4.4, 0.5) for k in range(1, 9) for p in scattered[:1]]
    folder = write_grid(tmp_path / "grid", scattered, GridInfo(layout="lattice"))
    with pytest.raises(ImageGridError, match="only 9 of 6561"):
        read_grid(folder)


def test_a_grid_without_any_picture_is_refused_even_if_partial(folder: Path) -> None:
    for path in (folder / "images").iterdir():
        path.unlink()
    with pytest.raises(ImageGridError, match="none of its pictures is there"):
        read_grid(folder, allow_partial=True)


def test_a_damaged_picture_is_never_served_even_if_partial(folder: Path) -> None:
    path = folder / "images/001.png"
    data = bytearray(path.read_bytes())
    data[-20] ^= 4
    path.write_bytes(bytes(data))
    grid = read_grid(folder, allow_partial=True)
    with pytest.raises(ImageGridError, match=r"images/001\.png: the picture is damaged"):
        grid.load(grid.frames[1])


def test_a_link_out_of_the_folder_is_refused(folder: Path) -> None:
    outside = folder.parent / "outside.png"
    (folder / "images/003.png").rename(outside)
    (folder / "images/003.png").symlink_to(outside)
    with pytest.raises(ImageGridError, match=r"frames\.jsonl:4: images/003\.png is a link that leads out"):
        read_grid(folder, allow_partial=True)


def test_a_link_to_the_whole_folder_is_followed(folder: Path) -> None:
    (folder.parent / "link").symlink_to(folder)
    assert len(read_grid(folder.parent / "link").frames) == 6


def test_folders_that_are_no_grids_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageGridError, match="no such folder"):
        read_grid(tmp_path / "nowhere")
    with pytest.raises(ImageGridError, match=r"no frames\.jsonl"):
        read_grid(tmp_path)
    (tmp_path / "frames.jsonl").write_text("\n\n")
    for allow_partial in (False, True):
        with pytest.raises(ImageGridError, match="lists no picture"):
            read_grid(tmp_path, allow_partial=allow_partial)


def test_a_torn_last_line_is_refused_and_left_out_if_partial(folder: Path) -> None:
    manifest = folder / "frames.jsonl"
    whole = manifest.read_bytes()
    last = whole[:-1].rindex(b"\n") + 1
    for cut in range(last + 1, len(whole) - 1, 5):
        manifest.write_bytes(whole[:cut])
        with pytest.raises(ImageGridError, match=r"frames\.jsonl:6: the last line is torn off"):
            read_grid(folder)
        grid = read_grid(folder, allow_partial=True)
        assert len(grid.frames) == 5
        assert "torn" in grid.left_out[0]


def test_line_ends_and_byte_order_marks_do_not_matter(folder: Path) -> None:
    manifest = folder / "frames.jsonl"
    whole = manifest.read_bytes()
    for text in (whole[:-1], whole.replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + whole, whole.replace(b"\n", b"\n\n")):
        manifest.write_bytes(text)
        assert len(read_grid(folder).frames) == 6


def test_frames_are_found_by_path_name_or_stem(folder: Path) -> None:
    grid = read_grid(folder)
    for name in ("images/004.png", "004.png", "004"):
        assert grid.frame(name) is grid.frames[4]
    with pytest.raises(ImageGridError, match=r"Did you mean 'images/004\.png'"):
        grid.frame("image/004.png")


def test_a_name_that_fits_two_frames_is_refused(folder: Path) -> None:
    lines = lines_of(folder)
    (folder / "other").mkdir()
    (folder / "images/001.png").rename(folder / "other/000.png")
    lines[1]["file"] = "other/000.png"
    write_lines(folder, lines)
    with pytest.raises(ImageGridError, match="several pictures are called '000'"):
        read_grid(folder).frame("000")


def test_only_full_lattices_are_called_so(tmp_path: Path) -> None:
    assert read_grid(write_grid(tmp_path / "full", lattice())).is_full_lattice
    assert not read_grid(write_grid(tmp_path / "gap", lattice()[1:])).is_full_lattice


def test_the_truth_is_never_opened(folder: Path) -> None:
    (folder / "truth.jsonl").mkdir()
    assert len(read_grid(folder).frames) == 6


@pytest.mark.realdata
def test_the_castle_is_read(real_data: Path) -> None:
    grid = read_grid(real_data / "castle")
    assert len(grid.frames) == 250
    assert not grid.is_full_lattice
    assert grid.load(grid.frame("p00_w_m0525")).shape == (960, 1280, 3)


@pytest.mark.realdata
def test_one_flipped_byte_in_a_photograph_is_refused_by_name(real_data: Path, tmp_path: Path) -> None:
    castle = read_grid(real_data / "castle")
    frame = castle.frames[17]
    data = bytearray((castle.folder / frame.file).read_bytes())
    data[len(data) // 2] ^= 0xFF
    (tmp_path / "images").mkdir()
    (tmp_path / frame.file).write_bytes(bytes(data))
    line = (castle.folder / "frames.jsonl").read_text().splitlines()[17]
    assert json.loads(line)["file"] == frame.file
    (tmp_path / "frames.jsonl").write_text(line + "\n")
    grid = read_grid(tmp_path)
    with pytest.raises(ImageGridError, match=rf"{frame.file}: the picture is damaged"):
        grid.load(grid.frames[0])
