"""SIGKILL at random instants of a scan: what was acknowledged is there, at most one picture a kill is taken again."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_kills_lose_tear_and_double_nothing_and_cost_one_picture_at_most(tmp_path: Path) -> None:
    """The long version is benchmarks/bench_crash.py."""
    arguments = ["--frames", "40", "--kills", "15", "--kills-per-scan", "8", "--seed", "5"]
    command = [sys.executable, "-m", "calibration_free_tests.scan.crash", str(tmp_path), *arguments]
    tally = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
    assert tally["kills"] >= 15
    assert tally["acknowledged"] > 0
    assert tally["lost"] == tally["torn"] == tally["duplicates"] == tally["wrong_at_end"] == 0
    assert max(int(pictures) for pictures in tally["retaken"]) <= 1
