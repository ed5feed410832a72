"""Detectors are found by name, and a wrong name says which there are."""

from __future__ import annotations

import pytest

from recognition.detectors import detector_names, load_detector
from recognition.detectors.segmentation import SegmentationDetector
from recognition.modelbase import PartClass
from recognition.part_classes import BUILT_IN_CLASSES
from rig.errors import InputError


def test_the_papers_detector_is_installed_and_loads() -> None:
    assert "segmentation" in detector_names()
    assert isinstance(load_detector("segmentation", [BUILT_IN_CLASSES["DW4"]]), SegmentationDetector)


def test_an_unknown_detector_is_refused_naming_those_that_exist() -> None:
    with pytest.raises(InputError, match=r"no detector 'segmentaton'.*segmentation"):
        load_detector("segmentaton", [BUILT_IN_CLASSES["DW4"]])


def test_a_class_without_canonical_corners_is_refused() -> None:
    with pytest.raises(InputError, match="DW5"):
        load_detector("segmentation", [PartClass("DW5", 5)])


def test_no_classes_are_refused() -> None:
    with pytest.raises(InputError, match="no part-class"):
        load_detector("segmentation", [])
