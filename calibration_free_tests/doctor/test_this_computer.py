"""What is looked at on a real computer: locks, permissions, links, disks."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from drivers import port_lock
from drivers.port_lock import lock_port
from rig.doctor import Verdict, this_computer
from rig.doctor.computer import check_disk
from rig.doctor.surroundings import look_at_disk, may_use, take_and_release
from rig.errors import HardwareError


def test_the_trial_file_is_measured_and_gone(tmp_path: Path) -> None:
    look = look_at_disk(tmp_path)
    assert look.free_bytes > 0
    assert look.bytes_per_s > 0
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_no_disk(tmp_path: Path) -> None:
    finding = check_disk(tmp_path / "nowhere", this_computer())
    assert finding.ok is Verdict.FAIL
    assert "cannot be written" in finding.told


def test_a_port_that_is_held_is_seen_and_a_free_one_is_left_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_lock, "SHARED", tmp_path)
    take_and_release("/dev/ttyUSB7")
    lock = lock_port("/dev/ttyUSB7")
    with pytest.raises(HardwareError, match=f"in use by process {os.getpid()}"):
        take_and_release("/dev/ttyUSB7")
    lock.release()
    take_and_release("/dev/ttyUSB7")


def test_a_device_may_be_used_only_if_it_is_there() -> None:
    assert may_use("/dev/null")
    assert not may_use("/dev/no-such-device")
