"""How the detector behaves on a bench, in a few numbers that the graded likelihood uses."""

from __future__ import annotations

from dataclasses import dataclass

from rig.errors import InputError


@dataclass(frozen=True, slots=True)
class DetectionRates:
    """How the detector behaves on this bench, in a few numbers.

    Attributes:
        found: share of the visible parts that are found.
        clutter: false detections expected in a view.
        corner_sd_px: sd of a corner coordinate where the detection's own is smaller: model errors, lens.
        measured: whether they were fitted to views with truth, not guessed: only then are objects that are much like
            a known one told from it.
    """

    found: float = 0.9
    clutter: float = 1.0
    corner_sd_px: float = 0.7
    measured: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.found < 1.0:
            raise InputError(f"{self.found} is not a rate between 0 and 1", where="detection.found")
        if not self.clutter > 0.0:
            raise InputError(f"{self.clutter} is not a positive number", where="detection.clutter")
        if not self.corner_sd_px > 0.0:
            raise InputError(f"{self.corner_sd_px} is not a positive sd", where="detection.corner_sd_px")

    @property
    def part_cap(self) -> float:
        """Most log odds, nats, that one part can bring: less among clutter, which is not independent."""
        return 6.0 + 3.0 / (1.0 + self.clutter / 5.0)

    @property
    def view_cap(self) -> float:
        """Most log odds, nats, that one view can bring: among clutter some lattice always fits one view well."""
        return 12.0 + 28.0 / (1.0 + self.clutter / 5.0)
