"""The first view of a recognition is not the one that waits for the compiler."""

from __future__ import annotations

import importlib
import pkgutil

import recognition.kernels
from calibration_free_tests.recognition.synthetic import (
    SETTINGS,
    Faults,
    SyntheticRig,
    around_the_corner,
    changing,
    run,
    three_buildings,
)
from recognition.warming import warm_up


def compiled() -> dict[str, int]:
    """Of every kernel, for how many kinds of arguments it has been compiled."""
    found = {}
    for module in pkgutil.iter_modules(recognition.kernels.__path__):
        loaded = importlib.import_module(f"recognition.kernels.{module.name}")
        for name, thing in vars(loaded).items():
            if hasattr(thing, "signatures"):
                found[f"{module.name}.{name}"] = len(thing.signatures)
    return found


def test_what_a_recognition_needs_is_compiled_beforehand() -> None:
    warm_up()
    before = compiled()
    assert sum(before.values()) > 5
    base = three_buildings()
    rig = SyntheticRig(base.objects[0], around_the_corner(), changing(0), Faults(0.5, 0.1, 2), seed=0)
    run(rig, base, SETTINGS)
    assert compiled() == before
