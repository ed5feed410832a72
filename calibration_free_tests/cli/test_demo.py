"""The demonstration runs from end to end, soon enough to be watched."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rig.cli.app import app


def test_demo_recognises_from_an_ambiguous_view(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app(["demo", "--json", "--out", str(tmp_path / "run")], prog_name="rig")
    streams = capsys.readouterr()
    result = json.loads(streams.out)
    assert end.value.code == 0, streams.err
    assert "it fits 374 places" in streams.err
    assert f"In truth it was {result['object']}, and the camera" in streams.err
    assert "wrong" not in streams.err
    assert result["views"][0]["hypotheses_left"] > 100
    assert (tmp_path / "run" / "report.html").is_file()
