"""A grid grows over many sittings: what a kill left is mended, and one writer at a time holds the folder."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.imagegrid.sample import encoded, frame_at, lattice, lines_of, picture, write_grid
from rig.errors import ImageGridError, InputError, RigError
from rig.imagegrid import GridInfo, GridWriter, read_grid
from rig.imagegrid.lock import LOCK

POSES = lattice()
HOLDER = """
import sys
from pathlib import Path
from rig.imagegrid import GridInfo, GridWriter
writer = GridWriter(Path(sys.argv[1]), GridInfo(), grow=True)
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_grid(tmp_path / "grid", POSES[:3])


def grow(folder: Path, **how: Any) -> GridWriter:
    return GridWriter(folder, GridInfo(), grow=True, **how)


def killed_with(folder: Path, line: Mapping[str, Any]) -> None:
    """Leave the folder as a writer does that is killed with a picture in hand."""
    (folder / LOCK).write_text(json.dumps({"pid": 1, "line": line}))


def a_line(number: int, **more: Any) -> dict[str, Any]:
    """The line of a picture, as another writer would have noted it."""
    import hashlib
    from dataclasses import asdict

    data = encoded(picture(number), ".png")
    digest = hashlib.sha256(data).hexdigest()
    return {"file": f"images/{number:03d}.png", "sha256": digest, **asdict(POSES[number]), **more}


def test_a_grid_grows_by_later_sittings(folder: Path) -> None:
    for number in (3, 4):
        with grow(folder) as writer:
            assert not writer.mended
            frame = writer.add(frame_at(POSES[number], number), writer.free_name())
            assert frame.line == number + 1
    grid = read_grid(folder)
    assert [frame.pose for frame in grid.frames] == POSES[:5]
    assert grid.frames[4].file == "images/00005.png"
    assert grid.info.provenance == "a test"


def test_growing_begins_a_grid_where_there_is_none(tmp_path: Path) -> None:
    with grow(tmp_path / "deep" / "new") as writer:
        writer.add(frame_at(POSES[0]), writer.free_name())
    assert len(read_grid(tmp_path / "deep" / "new").frames) == 1


def test_places_and_names_of_earlier_sittings_are_taken(folder: Path) -> None:
    with grow(folder) as writer:
        with pytest.raises(ImageGridError, match=r"same pose as images/000\.png"):
            writer.add(frame_at(POSES[0]), "b.png")
        with pytest.raises(ImageGridError, match="in the grid already"):
            writer.add(frame_at(POSES[5]), "images/000.png")


def test_a_free_name_is_nobodys_picture(folder: Path) -> None:
    (folder / "images" / "00004.png").write_bytes(b"mine")
    with grow(folder) as writer:
        assert writer.free_name() == "images/00005.png"


def test_a_grid_of_other_internals_is_not_mixed(tmp_path: Path) -> None:
    write_grid(tmp_path, POSES[:1], GridInfo(internals="fixed_by_zoom"))
    with pytest.raises(InputError, match="fixed_by_zoom, the rig's change_every_view"):
        GridWriter(tmp_path, GridInfo(internals="change_every_view"), grow=True)


@pytest.mark.parametrize("tail", [b'{"file": "images/00', b'{"file"', b"\0\0\0", b"\xff"])
def test_a_torn_last_line_is_cut_and_told(folder: Path, tail: bytes) -> None:
    manifest = folder / "frames.jsonl"
    whole = manifest.read_bytes()
    manifest.write_bytes(whole + tail)
    with grow(folder) as writer:
        assert [m for m in writer.mended if "frames.jsonl:4" in m and "torn off" in m]
    assert manifest.read_bytes() == whole


def test_a_last_line_without_its_end_is_kept_if_its_picture_is_whole(folder: Path) -> None:
    manifest = folder / "frames.jsonl"
    whole = manifest.read_bytes()
    manifest.write_bytes(whole[:-1])
    with grow(folder) as writer:
        assert "ended" in writer.mended[0]
    assert manifest.read_bytes() == whole
    manifest.write_bytes(whole[:-1])
    (folder / "images" / "002.png").write_bytes(b"half")
    with grow(folder) as writer:
        assert len(writer.frames) == 2


def test_a_whole_picture_in_a_killed_writers_hand_is_adopted(folder: Path) -> None:
    line = a_line(3)
    (folder / line["file"]).write_bytes(encoded(picture(3), ".png"))
    killed_with(folder, line)
    with grow(folder) as writer:
        assert "added to the manifest" in writer.mended[0]
        assert [frame.pose for frame in writer.frames] == POSES[:4]
    assert len(read_grid(folder).frames) == 4


def test_half_a_picture_in_a_killed_writers_hand_is_removed(folder: Path) -> None:
    line = a_line(3)
    (folder / line["file"]).write_bytes(encoded(picture(3), ".png")[:-9])
    (folder / "images" / ".003.png.part").write_bytes(b"half")
    killed_with(folder, line)
    with grow(folder) as writer:
        assert len(writer.mended) == 2
    assert sorted(path.name for path in (folder / "images").iterdir()) == ["000.png", "001.png", "002.png"]
    assert len(read_grid(folder).frames) == 3


def test_a_picture_that_no_writer_noted_stays(folder: Path) -> None:
    (folder / "images" / "mine.png").write_bytes(b"mine")
    with grow(folder, retake_damaged=True) as writer:
        assert not writer.mended
    assert (folder / "images" / "mine.png").read_bytes() == b"mine"


@pytest.mark.parametrize("note", ["", "{", "[]", '{"line": {"file": "../../x"}}', '{"pid": 1, "line": 7}'])
def test_a_note_that_says_nothing_is_no_trouble(folder: Path, note: str) -> None:
    (folder / LOCK).write_text(note)
    with grow(folder) as writer:
        assert len(writer.frames) == 3


def test_damaged_and_missing_pictures_are_refused(folder: Path) -> None:
    (folder / "images" / "000.png").unlink()
    (folder / "images" / "001.png").write_bytes(b"short")
    with pytest.raises(ImageGridError) as caught:
        grow(folder)
    assert "frames.jsonl:1: images/000.png is missing" in str(caught.value)
    assert "frames.jsonl:2: images/001.png has 5 bytes" in str(caught.value)
    assert len(lines_of(folder)) == 3


def test_damaged_and_missing_pictures_are_struck_out_to_be_taken_again(folder: Path) -> None:
    (folder / "images" / "000.png").unlink()
    flipped = bytearray((folder / "images" / "001.png").read_bytes())
    flipped[60] ^= 1
    (folder / "images" / "001.png").write_bytes(flipped)
    seen: list[str] = []
    with grow(folder, retake_damaged=True, progress=lambda f: [seen.append(x.file) or x for x in f]) as writer:
        assert len(writer.mended) == 2
        assert [frame.file for frame in writer.frames] == ["images/002.png"]
        writer.add(frame_at(POSES[0], 0), "images/000.png")
    assert len(seen) == 3
    assert {frame.file for frame in read_grid(folder).frames} == {"images/000.png", "images/002.png"}


def test_a_manifest_that_no_kill_explains_is_refused(folder: Path) -> None:
    manifest = folder / "frames.jsonl"
    lines = manifest.read_text().splitlines()
    manifest.write_text("\n".join([lines[0], "garbage", *lines[1:]]) + "\n")
    before = manifest.read_bytes()
    with pytest.raises(ImageGridError, match="jsonl:2:1: this is not JSON"):
        grow(folder)
    assert manifest.read_bytes() == before


def test_a_second_process_is_refused_and_told_the_holder(folder: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=rf"process {holder.pid} is writing there"):
            grow(folder)
        holder.kill()
    with grow(folder) as writer:
        assert len(writer.frames) == 3


def test_letting_go_leaves_no_lock_behind(folder: Path) -> None:
    with grow(folder), pytest.raises(InputError, match="this process is writing there"):
        grow(folder)
    assert not (folder / LOCK).exists()
    grow(folder).close()


def test_a_line_that_cannot_be_taken_back_ends_the_writer(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line may be there or not: only a fresh look at the file can tell."""
    with grow(folder) as writer:
        with monkeypatch.context() as patch:

            def refuse(handle: int, length: int | None = None) -> None:
                if os.path.samestat(os.fstat(handle), (folder / "frames.jsonl").stat()):
                    raise OSError(errno.EIO, "Input/output error")

            patch.setattr(os, "fsync", refuse)
            patch.setattr(os, "ftruncate", refuse)
            with pytest.raises(RigError, match="Input/output"):
                writer.add(frame_at(POSES[3], 3), "images/003.png")
        with pytest.raises(RigError, match="Open the grid again"):
            writer.add(frame_at(POSES[4], 4), "images/004.png")
    with grow(folder) as writer:
        assert len(writer.frames) == 4
