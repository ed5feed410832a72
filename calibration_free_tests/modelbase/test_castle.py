"""The surveyed castle loads as it is, and fits the published schema."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recognition.modelbase_io import describe, load_model_base

pytestmark = pytest.mark.realdata


def test_the_castle_loads_as_it_is(real_data: Path) -> None:
    base = load_model_base(real_data / "castle" / "modelbase.yaml")
    assert describe(base).by_object == {"castle": 86, "castle_mirrored": 86, "castle_restacked": 86}
    assert describe(base).by_class == {"DW4": 258}


def test_real_windows_may_be_brighter_or_darker_than_their_wall(real_data: Path) -> None:
    base = load_model_base(real_data / "castle" / "modelbase.yaml")
    assert [known.bright for known in base.classes] == [None]


def test_castle_windows_face_the_courtyard(real_data: Path) -> None:
    base = load_model_base(real_data / "castle" / "modelbase.yaml")
    for thing in base.objects:
        middle = np.mean([part.centre_mm for part in thing.parts], axis=0)
        assert all(part.normal @ (middle - part.centre_mm) > 0 for part in thing.parts if part.face != "D_west_wing")
