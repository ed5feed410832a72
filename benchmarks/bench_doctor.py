"""Prints which planted faults ``rig doctor`` names, with the right remedy, and how often it complains of nothing.

Run from the repository: ``python -m benchmarks.bench_doctor``. All time is simulated.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from calibration_free_tests.doctor.planted import ALL, FAULTS
from calibration_free_tests.doctor.sample import Workbench
from rig.doctor import Verdict
from sim_backends.grbl_emulator.dialects import Dialect


def row(name: str, dialect: Dialect, *cells: str) -> None:
    print(f"{name:<56}{dialect.name:<9}" + "".join(f"{cell:>9}" for cell in cells))


def main() -> int:
    print(f"{'planted fault':<56}{'firmware':<9}{'found':>9}{'remedy':>9}{'false':>9}{'seconds':>9}")
    cases = found = remedied = false = 0
    for fault in FAULTS:
        for dialect in fault.dialects:
            with tempfile.TemporaryDirectory() as folder:
                began_s = time.perf_counter()
                findings = fault.findings(Path(folder), dialect)
                seconds = time.perf_counter() - began_s
            named, remedy, alarms = fault.named(findings), fault.remedied(findings), len(fault.false_alarms(findings))
            row(fault.name, dialect, "yes" if named else "NO", "yes" if remedy else "NO", str(alarms), f"{seconds:.2f}")
            cases, found, remedied, false = cases + 1, found + named, remedied + remedy, false + alarms
    for dialect in ALL:
        with tempfile.TemporaryDirectory() as folder:
            findings = Workbench(Path(folder), dialect).findings()
        alarms = sum(finding.ok is not Verdict.PASS for finding in findings)
        row(f"none: {len(findings)} lines of a healthy bench", dialect, "-", "-", str(alarms))
        false += alarms
    print(f"{len(FAULTS)} faults, {cases} cases: {found} found, {remedied} with the right remedy, {false} false alarms")
    return 0 if found == remedied == cases and not false else 1


if __name__ == "__main__":
    sys.exit(main())
