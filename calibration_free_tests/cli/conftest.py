"""The person at the bench."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibration_free_tests.bench.plugins import install
from calibration_free_tests.cli.person import Person


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    plugins = install(tmp_path / "drivers")
    monkeypatch.syspath_prepend(str(plugins))
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "rig"))
    return Person(tmp_path, plugins)
