"""The demonstration runs from end to end, soon enough to be watched."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from recognition.modelbase_io import load_model_base
from rig.cli.app import app
from rig.demo import Demonstration
from rig.hal import RigPose
from sim_backends.simulate import draw_scene, rendered_rig


@pytest.fixture(scope="module")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    models = load_model_base("architecture")
    rig = rendered_rig(draw_scene(models, "LH", 0), zooms=(0.0,))
    return Demonstration(tmp_path_factory.mktemp("grid"), models, RigPose(0, 0, 0, 0), "LH", Counter(), rig)


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


@pytest.mark.parametrize(
    ("in_view", "told"),
    [
        ({"DW4": 1}, "1 DW4: it fits 374 places"),
        ({"DW4": 3}, "3 DW4: it fits at most 374 places"),
        ({"DW4": 2, "OPEN": 1}, "2 DW4, 1 OPEN: it fits at most 21 places"),
        ({"OPEN": 1, "DW12": 1}, "1 OPEN, 1 DW12: it fits at most 4 places"),
    ],
)
def test_places_that_fit_are_those_of_the_rarest_class_in_view(
    demonstration: Demonstration, in_view: dict[str, int], told: str
) -> None:
    assert told in replace(demonstration, in_view=Counter(in_view)).first_view
