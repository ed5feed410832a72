"""A person at a computer with drivers, a runtime folder and a bench file, and what commands make of them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.bench.plugins import ROOT
from rig.bench import load_bench
from rig.cli.app import app
from rig.runtime import Attendance

SOON_S = 20.0
BENCH = """\
schema: 1
kind: live
devices:
  gantry: {driver: simple, upper_mm: [500.0, 400.0, 300.0], speed_mm_per_s: 100.0, home_s: 0.05}
  pan: {driver: simple, speed_per_s: 90.0}
  camera: {driver: simple}
axes:
  x_mm: {lower: 0, upper: 500, speed_mm_per_s: 100}
  y_mm: {lower: 0, upper: 400, speed_mm_per_s: 100}
  z_mm: {lower: 0, upper: 300, speed_mm_per_s: 100}
  theta_deg: {lower: -90, upper: 90, speed_deg_per_s: 90}
"""


class Person:
    """Sits at a computer with drivers, a runtime folder and a bench file."""

    def __init__(self, folder: Path, plugins: Path) -> None:
        self.folder = folder
        self.bench = folder / "bench.yaml"
        self.bench.write_text(BENCH)
        self.environment: Mapping[str, str] = os.environ | {
            "PYTHONPATH": f"{ROOT}{os.pathsep}{plugins}",
            "RIG_RUNTIME_DIR": str(self.runtime),
        }

    @property
    def runtime(self) -> Path:
        return self.folder / "rig"

    @property
    def attendance(self) -> Attendance:
        return Attendance(self.runtime, load_bench(self.bench).key, "bench")

    @contextmanager
    def running(self, *arguments: object) -> Iterator[subprocess.Popen[str]]:
        """`rig` in a process of its own."""
        command = [sys.executable, "-m", "rig.cli.app", *map(str, arguments)]
        streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen(command, cwd=self.folder, env=self.environment, **streams) as process:
            try:
                yield process
            finally:
                process.kill()

    def wait_until(self, true_of: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Until the process that holds the bench says so."""
        deadline_s = time.monotonic() + SOON_S
        while time.monotonic() < deadline_s:
            told = self.attendance.ask("status")
            if told is not None and true_of(told):
                return told
            time.sleep(0.02)
        raise AssertionError("it never was so")


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        app([*map(str, arguments)], prog_name="rig")
    return int(end.value.code or 0)


def moving(told: dict[str, Any]) -> bool:
    return bool(told["state"] == "moving" and "a move" in told["running"])
