"""Whatever strikes the wires and devices during scans: no wrong pose is stored, nothing forbidden moves, all ends."""

from __future__ import annotations

import pytest

from calibration_free_tests.emulation.faulty_scans import Person, check


@pytest.mark.parametrize("seed", [1, 2])
def test_no_fault_during_scans_lets_a_wrong_pose_be_stored_or_anything_forbidden_move(seed: int) -> None:
    tally = Person(seed, faults=100, every_s=1.5).work()
    check(tally)
    assert tally.faults >= 90
    assert tally.frames >= 10
    assert tally.ended_early >= 3


@pytest.mark.soak
@pytest.mark.timeout(0)
@pytest.mark.parametrize("seed", range(5))
def test_ten_thousand_faults_during_scans_let_no_wrong_pose_be_stored(seed: int) -> None:
    tally = Person(100 + seed, faults=10_000, every_s=3.0).work()
    check(tally)
    assert tally.faults >= 9900
