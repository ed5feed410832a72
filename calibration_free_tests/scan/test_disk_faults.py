"""A full or failing disk, at each single call: nothing torn, one clear message, and the scan goes on afterwards."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.scan.sample import FakeRig, QuickDisk, digest_at, row, scan_into
from rig.errors import RigError
from rig.imagegrid import GridFrame, read_grid
from rig.scan import Finish, ScanPlan

POSES = row(3)
FAULTS = {errno.ENOSPC: "No space left on device", errno.EIO: "Input/output error"}
FREEING = ("unlink", "ftruncate")


class FailingDisk(QuickDisk):
    """Fails at the call of the given number, and from then on too if it ``stays``; a write gets half of it done.

    A disk that is full still lets files be removed and shortened.
    """

    def __init__(self, fail_at: int = -1, code: int = errno.EIO, stays: bool = False) -> None:
        self.calls: list[str] = []
        self.failed: list[str] = []
        self._fail_at, self._code, self._stays = fail_at, code, stays

    def __getattribute__(self, name: str) -> Any:
        made = super().__getattribute__(name)
        if name not in ("open", "write", "fsync", "ftruncate", "replace", "mkdir", "unlink"):
            return made

        def call(*arguments: Any) -> Any:
            number = len(self.calls)
            self.calls.append(name)
            due = number >= self._fail_at >= 0 if self._stays else number == self._fail_at
            if due and not (self._code == errno.ENOSPC and name in FREEING):
                self.failed.append(name)
                if name == "write":
                    os.write(arguments[0], arguments[1][: len(arguments[1]) // 2])
                raise OSError(self._code, FAULTS[self._code])
            return made(*arguments)

        return call


def scan_with(disk: FailingDisk, folder: Path) -> tuple[list[GridFrame], RigError | None]:
    """What was acknowledged before the end, and the error it ended with."""
    kept: list[GridFrame] = []
    try:
        scan_into(folder, POSES, disk=disk, acknowledged=kept.append)
    except RigError as error:
        return kept, error
    return kept, None


def judge(folder: Path, kept: list[GridFrame]) -> None:
    """What was acknowledged is listed and whole, and so is all else that is listed."""
    manifest = folder / "frames.jsonl"
    whole = manifest.read_bytes().split(b"\n")[:-1] if manifest.exists() else []
    listed = {line["file"]: line["sha256"] for line in map(json.loads, whole)}
    assert len(listed) == len(whole)
    assert {frame.file: frame.sha256 for frame in kept}.items() <= listed.items()
    for frame in kept:
        assert frame.sha256 == digest_at(frame.pose)
    for file, sha256 in listed.items():
        assert hashlib.sha256((folder / file).read_bytes()).hexdigest() == sha256


def calls_of_a_whole_scan(tmp_path: Path) -> list[str]:
    disk = FailingDisk()
    assert scan_with(disk, tmp_path / "counted") == (list(read_grid(tmp_path / "counted").frames), None)
    return disk.calls


def test_a_scan_makes_every_kind_of_call(tmp_path: Path) -> None:
    calls = calls_of_a_whole_scan(tmp_path)
    assert set(calls) == {"open", "write", "fsync", "ftruncate", "replace", "mkdir", "unlink"}
    assert calls.count("replace") == 3 + len(POSES)
    assert calls.count("fsync") >= 4 * len(POSES)


@pytest.mark.parametrize("stays", [False, True], ids=["once", "from then on"])
@pytest.mark.parametrize("code", FAULTS, ids=["ENOSPC", "EIO"])
def test_a_fault_at_any_call_tears_nothing_and_the_scan_goes_on_later(tmp_path: Path, code: int, stays: bool) -> None:
    calls = calls_of_a_whole_scan(tmp_path)
    stopped = 0
    for number, name in enumerate(calls):
        folder = tmp_path / f"at{number}"
        disk = FailingDisk(number, code, stays)
        kept, error = scan_with(disk, folder)
        if error is None:
            # The only call that may fail unnoticed is the removal of the lock, when all is done.
            assert name == "unlink" or not disk.failed
            assert len(kept) == len(POSES)
        else:
            stopped += 1
            assert FAULTS[code] in str(error)
            assert str(folder) in str(error)
            assert "\n" not in str(error)
        judge(folder, kept)
        rig = FakeRig()
        later: list[GridFrame] = []
        scan = scan_into(folder, POSES, rig, disk=QuickDisk(), acknowledged=later.append)
        assert scan.finish is Finish.DONE
        assert len(rig.captured) <= len(POSES) - len(kept)
        grid = read_grid(folder)
        assert {frame.pose: frame.sha256 for frame in grid.frames} == {pose: digest_at(pose) for pose in POSES}
        judge(folder, kept + later)
        assert sorted(path.name for path in folder.iterdir()) == ["frames.jsonl", "grid.yaml", "images", "scan.yaml"]
        assert sorted(path.name for path in (folder / "images").iterdir()) == sorted(
            Path(frame.file).name for frame in grid.frames
        )
    assert stopped >= len(calls) - calls.count("unlink") - calls.count("ftruncate")


@pytest.mark.parametrize("code", FAULTS, ids=["ENOSPC", "EIO"])
def test_a_fault_at_any_call_of_a_repair_leaves_what_can_be_repaired(tmp_path: Path, code: int) -> None:
    """The second start meets a bad disk as well, on a folder where everything is to be mended."""

    def in_need(folder: Path) -> None:
        scan_into(folder, POSES[:2], disk=QuickDisk())
        with (folder / "scan.yaml").open("r+") as record:
            text = record.read().replace(record_digest(POSES[:2]), record_digest(POSES))
            record.seek(0)
            record.write(text)
        manifest = folder / "frames.jsonl"
        manifest.write_bytes(manifest.read_bytes() + b'{"file": "ima')
        (folder / "images" / "00001.png").write_bytes(b"damaged")
        (folder / "images" / ".00003.png.part").write_bytes(b"half")

    in_need(tmp_path / "counted")
    counting = FailingDisk()
    assert len(scan_with(counting, tmp_path / "counted")[0]) == 2
    for number in range(len(counting.calls)):
        folder = tmp_path / f"at{number}"
        in_need(folder)
        kept, error = scan_with(FailingDisk(number, code), folder)
        assert error is None or FAULTS[code] in str(error)
        scan_into(folder, POSES, disk=QuickDisk())
        judge(folder, kept)
        found = {frame.pose: frame.sha256 for frame in read_grid(folder).frames}
        assert found == {pose: digest_at(pose) for pose in POSES}


def record_digest(poses: tuple[Any, ...]) -> str:
    return ScanPlan("", poses).sha256
