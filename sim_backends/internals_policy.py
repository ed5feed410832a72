"""How a simulated camera's inside depends on the zoom, and how it changes from view to view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim_backends.projection import Internals
from sim_backends.renderer import DEFAULT_SIZE


class InternalsPolicy(Protocol):
    """What the camera's inside is at a zoom setting."""

    @property
    def fixed_by_zoom(self) -> bool:
        """The same zoom setting always gives the same internals."""
        ...

    def internals(self, zoom: float, rng: np.random.Generator) -> Internals:
        """The internals of one view; ``rng`` is the view's own."""
        ...


@dataclass(frozen=True, slots=True)
class FixedByZoom:
    """Internals that only the zoom changes: the focal length grows evenly by ratio from ``f_wide_px`` to ``f_tele_px``.

    The defaults are for 1,280 x 960 pixels: 40 degrees across at zoom 0 and 20 degrees at zoom 1.
    ``aspect`` is fy / fx.
    """

    f_wide_px: float = 1760.0
    f_tele_px: float = 3630.0
    aspect: float = 1.0
    u0_px: float = 639.5
    v0_px: float = 479.5
    k1: float = 0.0

    @property
    def fixed_by_zoom(self) -> bool:
        """Always."""
        return True

    @staticmethod
    def for_size(size: tuple[int, int]) -> FixedByZoom:
        """The default camera with another number of pixels."""
        scale = size[0] / DEFAULT_SIZE[0]
        return FixedByZoom(1760.0 * scale, 3630.0 * scale, u0_px=(size[0] - 1) / 2, v0_px=(size[1] - 1) / 2)

    def internals(self, zoom: float, rng: np.random.Generator) -> Internals:
        """The internals at that zoom; ``rng`` is not used."""
        f = self.f_wide_px * (self.f_tele_px / self.f_wide_px) ** zoom
        return Internals(f, f * self.aspect, self.u0_px, self.v0_px, self.k1)


@dataclass(frozen=True, slots=True)
class ChangingInternals:
    """Internals that differ from view to view around those of ``base``.

    Attributes:
        f_sd: relative spread of the focal length; aspect_sd: of fy / fx.
        centre_sd_px: spread of u0 and of v0; k1_sd: of the radial term.
    """

    base: FixedByZoom
    f_sd: float = 0.05
    aspect_sd: float = 0.02
    centre_sd_px: float = 40.0
    k1_sd: float = 0.0

    @property
    def fixed_by_zoom(self) -> bool:
        """Never."""
        return False

    def internals(self, zoom: float, rng: np.random.Generator) -> Internals:
        """Draw the internals of one view."""
        mean = self.base.internals(zoom, rng)
        draw = rng.standard_normal(5)
        f = mean.fx * float(np.exp(self.f_sd * draw[0]))
        return Internals(
            f,
            f * self.base.aspect * float(np.exp(self.aspect_sd * draw[1])),
            mean.u0 + self.centre_sd_px * float(draw[2]),
            mean.v0 + self.centre_sd_px * float(draw[3]),
            mean.k1 + self.k1_sd * float(draw[4]),
        )
