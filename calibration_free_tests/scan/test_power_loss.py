"""The power fails after any call to the disk: each acknowledged picture survives, and the scan goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibration_free_tests.scan.power import Event, RememberingDisk, Replayed
from calibration_free_tests.scan.sample import FakeRig, QuickDisk, digest_at, rng, row, scan_into
from rig.imagegrid import GridWriter, read_grid
from rig.scan import Finish

POSES = row(3)
ALL = {pose: digest_at(pose) for pose in POSES}


@pytest.fixture
def trace(tmp_path: Path) -> list[Event]:
    """All that a scan tells the disk, and when which picture was acknowledged."""
    (tmp_path / "real").mkdir()
    disk = RememberingDisk()
    scan_into(
        tmp_path / "real" / "grids" / "new",
        POSES,
        disk=disk,
        acknowledged=lambda f: disk.note("safe", f.file, f.sha256),
    )
    return disk.trace


def survivors(folder: Path) -> dict[str, str]:
    """What a scan that goes on in the folder takes for good; then it goes on, to its end."""
    kept: dict[str, str] = {}
    rig = FakeRig()

    def opened(writer: GridWriter) -> None:
        kept.update({frame.file: frame.sha256 for frame in writer.frames})

    assert scan_into(folder, POSES, rig, disk=QuickDisk(), opened=opened).finish is Finish.DONE
    assert len(rig.captured) == len(POSES) - len(kept)
    assert {frame.pose: frame.sha256 for frame in read_grid(folder).frames} == ALL
    return kept


@pytest.mark.parametrize("luck", ["only what was flushed", "everything", 1, 2, 3])
def test_power_loss_after_any_call_keeps_what_was_acknowledged(
    tmp_path: Path, trace: list[Event], luck: str | int
) -> None:
    replayed = Replayed(tmp_path / "real")
    safe: dict[str, str] = {}
    for number, event in enumerate(trace):
        replayed.play(event)
        if event[0] == "safe":
            safe[event[1]] = event[2]
        left = tmp_path / f"after{number}"
        replayed.left_after_power_loss(
            left, rng(luck, number) if isinstance(luck, int) else None, whole=luck == "everything"
        )
        assert safe.items() <= survivors(left / "grids" / "new").items()
    assert len(safe) == len(POSES)


def test_power_loss_after_a_kill_keeps_what_the_second_start_took_for_good(tmp_path: Path, trace: list[Event]) -> None:
    """What the first did not flush before it was killed, the second has to: it does not take those pictures again."""
    for number in range(len(trace)):
        replayed = Replayed(tmp_path / "real")
        for event in trace[: number + 1]:
            replayed.play(event)
        killed, safe = tmp_path / f"killed{number}", dict[str, str]()
        replayed.left_after_power_loss(killed, None, whole=True)

        def opened(writer: GridWriter, safe: dict[str, str] = safe) -> None:
            safe.update({frame.file: frame.sha256 for frame in writer.frames})

        disk = RememberingDisk()
        scan_into(
            killed / "grids" / "new",
            POSES,
            disk=disk,
            opened=opened,
            acknowledged=lambda frame, safe=safe: safe.update({frame.file: frame.sha256}),
        )
        for event in disk.trace:
            replayed.play(tuple(tmp_path / "real" / p.relative_to(killed) if isinstance(p, Path) else p for p in event))
        left = tmp_path / f"left{number}"
        replayed.left_after_power_loss(left, None)
        assert len(safe) == len(POSES)
        assert safe.items() <= survivors(left / "grids" / "new").items()
