"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="session", autouse=True)
def away_from_real_benches(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No test meets a process of whoever runs it, or a STOP that he has latched."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("RIG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real photographs; the test is skipped where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("RIG_REAL_DATA", default))
    if not (folder / "castle" / "frames.jsonl").is_file():
        # A bare clone has no photographs; ``.ci/run`` says so loudly, too.
        pytest.skip(f"real data not found at {folder}: set RIG_REAL_DATA to the folder that holds castle/")
    return folder
