"""Detectors of parts, found through the entry-point group ``rig.detectors``."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, cast

from rig.errors import InputError

if TYPE_CHECKING:
    from recognition.modelbase import PartClass
    from recognition.parts import Detector, DetectorFactory

GROUP = "rig.detectors"
DEFAULT = "segmentation"


def detector_names() -> tuple[str, ...]:
    """Names of the detectors that are installed."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def load_detector(name: str, classes: Sequence[PartClass]) -> Detector:
    """Make the detector of that name for the part-classes of a model base.

    Raises:
        InputError: no such detector is installed, or it cannot be imported.
    """
    for point in entry_points(group=GROUP, name=name):
        try:
            factory = cast("DetectorFactory", point.load())
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"detector '{name}' ({point.value}) cannot be loaded: {error}",
                where="detector",
                remedy="Install what it needs, or choose another detector",
            ) from error
        return factory(classes)
    known = ", ".join(detector_names()) or "none"
    raise InputError(
        f"there is no detector '{name}'",
        where="detector",
        remedy=f"Installed are: {known}. Others are added by packages with the entry-point group '{GROUP}'",
    )
