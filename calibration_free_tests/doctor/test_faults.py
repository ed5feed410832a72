"""The doctor names each planted fault with its remedy, complains of nothing else, and touches nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibration_free_tests.doctor.planted import ALL, FAULTS, Planted
from calibration_free_tests.doctor.sample import Workbench, text_of
from rig.doctor import Verdict, healthy
from sim_backends.grbl_emulator.dialects import Dialect

CASES = [
    pytest.param(fault, dialect, id=f"{fault.name}, {dialect.name}") for fault in FAULTS for dialect in fault.dialects
]


@pytest.mark.parametrize("dialect", ALL, ids=lambda dialect: dialect.name)
def test_a_healthy_bench_passes_every_line(tmp_path: Path, dialect: Dialect) -> None:
    bench = Workbench(tmp_path, dialect)
    with bench.untouched():
        findings = bench.findings()
    assert {f.ok for f in findings} == {Verdict.PASS}, text_of(findings)


@pytest.mark.parametrize(("fault", "dialect"), CASES)
def test_a_planted_fault_is_named_with_its_remedy_and_nothing_else_is_blamed(
    tmp_path: Path, fault: Planted, dialect: Dialect
) -> None:
    findings = fault.findings(tmp_path, dialect)
    assert fault.named(findings), text_of(findings)
    assert fault.remedied(findings), text_of(findings)
    assert not fault.false_alarms(findings), text_of(fault.false_alarms(findings))
    assert all(finding.remedy for finding in findings if finding.ok in (Verdict.WARN, Verdict.FAIL))
    assert healthy(findings) is (fault.verdict is Verdict.WARN)
