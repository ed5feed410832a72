"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real photographs; the test is skipped where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("RIG_REAL_DATA", default))
    if not (folder / "castle" / "frames.jsonl").is_file():
        # A bare clone has no photographs; ``.ci/run`` says so loudly, too.
        pytest.skip(f"real data not found at {folder}: set RIG_REAL_DATA to the folder that holds castle/")
    return folder
