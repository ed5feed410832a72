"""What is written comes back, and no crash or full disk leaves a frame torn."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_free_tests.imagegrid.sample import encoded, frame_at, lattice, lines_of, picture, write_grid
from rig.errors import ImageGridError, InputError, RigError
from rig.hal import Frame, RigPose
from rig.imagegrid import GridInfo, GridWriter, read_grid
from rig.imagegrid.entry import pose_key

PICTURE = encoded(picture(0), ".png")
poses = st.builds(
    RigPose,
    x_mm=st.floats(-1e9, 1e9),
    y_mm=st.floats(-1e9, 1e9),
    z_mm=st.floats(-1e9, 1e9),
    theta_deg=st.floats(-36_000.0, 36_000.0),
    zoom=st.floats(0.0, 1.0),
)
characters = st.characters(codec="utf-8", exclude_characters='/\\:*?"<>|', exclude_categories=("Cc", "Cs"))
names = st.text(characters, min_size=1, max_size=20).map(lambda name: f"i{name}.png")


def entry(file: str, pose: RigPose, **more: Any) -> dict[str, Any]:
    return {"file": file, **{axis: getattr(pose, axis) for axis in RigPose.__slots__}, **more}


@given(
    st.lists(st.tuples(names, poses), min_size=1, max_size=4, unique_by=(lambda p: p[0], lambda p: pose_key(p[1]))),
    st.none() | poses,
    st.floats(0.0, 1e12),
    st.text(characters, max_size=60),
)
@settings(max_examples=40, deadline=None)
def test_every_manifest_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory,
    places: list[tuple[str, RigPose]],
    commanded: RigPose | None,
    at_s: float,
    provenance: str,
) -> None:
    folder, info = tmp_path_factory.mktemp("grid"), GridInfo(provenance=provenance)
    writer = GridWriter(folder, info)
    told = None if commanded is None else {axis: getattr(commanded, axis) for axis in RigPose.__slots__}
    details = {"commanded": told, "measured": told, "exposure_s": at_s, "exposed_at_s": at_s, "taken_at": "today"}
    written = [writer.add_bytes(PICTURE, entry(file, pose, **details)) for file, pose in places]
    grid = read_grid(folder)
    assert grid.frames == tuple(written)
    assert grid.info == info
    assert [(f.file, f.pose) for f in grid.frames] == places
    assert grid.frames[0].commanded == grid.frames[0].measured == commanded


@pytest.mark.parametrize(
    "text", ["", "INFINITY", "off", "010", "1:30", "a: b # c", "'", '"', "\n x\n", "😀", "\ufffe\x85"]
)
def test_whatever_is_said_of_the_provenance_comes_back(tmp_path: Path, text: str) -> None:
    GridWriter(tmp_path, GridInfo(provenance=text)).add(frame_at(lattice()[0]), "a.png")
    assert read_grid(tmp_path).info.provenance == text


def test_pictures_and_all_details_come_back(tmp_path: Path) -> None:
    pose, wish = RigPose(1.5, -2.0, 3.0, 4.0, 0.5), RigPose(1.0, -2.0, 3.0, 4.0, 0.5)
    writer = GridWriter(tmp_path, GridInfo(image_size=(24, 16)))
    written = writer.add(frame_at(pose, 3, wish), "a.png", exposure_s=0.01, taken_at="2026-01-31T12:00:00Z")
    writer.add(frame_at(wish, 4), "deep/er/b.jpg", quality=90)
    grid = read_grid(tmp_path)
    assert grid.frames[0] == written
    assert (written.pose, written.commanded, written.exposed_at_s, written.exposure_s) == (pose, wish, 15.5, 0.01)
    assert np.array_equal(grid.load(grid.frames[0]), picture(3))
    assert grid.load(grid.frames[1]).shape == (16, 24, 3)
    assert grid.frames[1].commanded is None


def test_the_truth_goes_into_its_own_file(tmp_path: Path) -> None:
    GridWriter(tmp_path, GridInfo()).add(frame_at(lattice()[0]), "a.png", truth={"fx": 800.0})
    assert json.loads((tmp_path / "truth.jsonl").read_text()) == {"file": "a.png", "fx": 800.0}
    assert "fx" not in (tmp_path / "frames.jsonl").read_text()


def test_an_existing_grid_is_not_written_over(tmp_path: Path) -> None:
    folder = write_grid(tmp_path / "grid", lattice()[:2])
    with pytest.raises(InputError, match="an image grid already"):
        GridWriter(folder, GridInfo())
    assert len(read_grid(folder).frames) == 2


@pytest.mark.parametrize(
    ("pose", "file", "what"),
    [
        (RigPose(float("nan"), 0.0, 0.0, 0.0), "a.png", "x_mm"),
        (RigPose(0.0, 0.0, 0.0, 0.0, 1.5), "a.png", "zoom"),
        (RigPose(0.0, 0.0, 0.0, 0.0), "../a.png", "file"),
        (RigPose(0.0, 0.0, 0.0, 0.0), "/tmp/a.png", "file"),
        (RigPose(0.0, 0.0, 0.0, 0.0), "a.tif", "Write .png or .jpg"),
        (lattice()[1], "images/000.png", "is in the grid already"),
        (lattice()[0], "images/001.png", "same pose as images/000.png"),
    ],
)
def test_what_could_not_be_read_is_not_written(tmp_path: Path, pose: RigPose, file: str, what: str) -> None:
    writer = GridWriter(tmp_path / "grid", GridInfo())
    writer.add(frame_at(lattice()[0]), "images/000.png")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(ImageGridError) as caught:
        writer.add(frame_at(pose, 1), file)
    assert what in str(caught.value)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_picture_of_another_size_is_not_written(tmp_path: Path) -> None:
    writer = GridWriter(tmp_path, GridInfo(image_size=(24, 16)))
    pose = lattice()[0]
    with pytest.raises(ImageGridError, match="is 20 x 10 pixels"):
        writer.add(Frame(picture(0, (20, 10)), pose, pose, "", 0), "a.png")


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_leaves_the_grid_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    """The disk is full at each call in turn: each frame is in the grid whole or not at all, and the writer goes on."""
    writer = GridWriter(tmp_path, GridInfo())
    kept = 0
    for fail_at, pose in enumerate(lattice()[:8]):
        calls = iter(range(100))
        real = getattr(os, call)

        def failing(*args: Any, calls: Any = calls, fail_at: int = fail_at, real: Any = real) -> Any:
            if next(calls) == fail_at:
                raise OSError(errno.ENOSPC, "No space left on device")
            return real(*args)

        with monkeypatch.context() as patch:
            patch.setattr(os, call, failing)
            raised = None
            try:
                writer.add(frame_at(pose, fail_at), f"images/{fail_at}.png", truth={"n": fail_at})
                kept += 1
            except RigError as failure:
                raised = failure
        assert raised is None or ("No space left" in str(raised) and raised.exit_code == 1)
        assert len(list(tmp_path.rglob("*.png"))) == kept
        assert not list(tmp_path.rglob("*.part"))
        if kept:
            grid = read_grid(tmp_path)
            assert len(grid.frames) == kept
            for frame in grid.frames:
                grid.load(frame)
    assert 0 < kept < 8


def test_half_a_line_is_taken_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = GridWriter(tmp_path, GridInfo())
    writer.add(frame_at(lattice()[0]), "0.png")
    fsync, manifest = os.fsync, tmp_path / "frames.jsonl"
    whole = manifest.read_bytes()
    faults = iter([True])

    def torn(handle: int) -> None:
        if os.path.samestat(os.fstat(handle), manifest.stat()) and next(faults, False):
            os.truncate(manifest, len(whole) + 20)
            raise OSError(errno.EIO, "Input/output error")
        fsync(handle)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", torn)
        with pytest.raises(RigError, match="Input/output"):
            writer.add(frame_at(lattice()[1], 1), "1.png")
    assert manifest.read_bytes() == whole
    writer.add(frame_at(lattice()[1], 1), "1.png")
    assert len(read_grid(tmp_path).frames) == len(lines_of(tmp_path)) == 2


def test_the_picture_is_on_the_disk_before_its_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trace: list[str] = []
    fsync, replace = os.fsync, os.replace

    def traced_fsync(handle: int) -> None:
        trace.append(f"fsync {Path(f'/proc/self/fd/{handle}').readlink().name}")
        fsync(handle)

    def traced_replace(source: Path, target: Path) -> None:
        trace.append(f"rename {target.name}")
        replace(source, target)

    writer = GridWriter(tmp_path / "grid", GridInfo())
    monkeypatch.setattr(os, "fsync", traced_fsync)
    monkeypatch.setattr(os, "replace", traced_replace)
    writer.add(frame_at(lattice()[0]), "images/a.png")
    assert trace == ["fsync grid", "fsync .a.png.part", "rename a.png", "fsync images", "fsync frames.jsonl"]
    trace.clear()
    writer.add(frame_at(lattice()[1]), "images/b.png")
    assert trace == ["fsync .b.png.part", "rename b.png", "fsync images", "fsync frames.jsonl"]


def test_a_folder_that_cannot_be_made_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be made"):
        GridWriter(tmp_path / "file" / "grid", GridInfo())
