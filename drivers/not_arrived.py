"""The error of a gantry that does not get to where it was sent; whoever knows another frame can tell it in that one."""

from __future__ import annotations

from collections.abc import Callable

from rig.devices import Triple
from rig.errors import HardwareError


class NotArrivedError(HardwareError):
    """A gantry does not get to where it was sent. Motion has been stopped.

    Args:
        where: the device.
        what: became of it.
        target_mm: where it was sent.
        place_mm: where it is.
        frame: of the two places.
    """

    def __init__(
        self, where: str, what: str, target_mm: Triple, place_mm: Triple, frame: str = "machine coordinates"
    ) -> None:
        self._where, self._what, self._places = where, what, (target_mm, place_mm)
        target, place = (", ".join(f"{value:.3f}" for value in values) for values in self._places)
        super().__init__(
            f"{where}: not arrived at ({target}) mm: {what}, at ({place}) mm ({frame}). "
            "Look for an obstacle, check the cable, then try again"
        )

    def told_in(self, frame: str, to_frame: Callable[[Triple], Triple]) -> NotArrivedError:
        """The same, with its places in another frame."""
        target, place = self._places
        return NotArrivedError(self._where, self._what, to_frame(target), to_frame(place), frame)
