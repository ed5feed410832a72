"""Soft, heavy-tailed knowledge of any camera, which data overrules (design §3). None of it is a calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.errors import InputError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Priors:
    """What may be assumed of a camera that nobody calibrated. Each item is dropped by setting it to ``None``.

    The aspect and the principal point are held by Cauchy losses: near the expected value they act as Gaussians of the
    given sd, but far from it they lose their pull, so a lens shift of 10 sd costs little and data wins.

    Attributes:
        image_size: ``(width, height)`` px; the principal point is expected at the image centre ((w-1)/2, (h-1)/2).
        aspect_sd: sd of log(fy/fx), expected 0 (square pixels).
        principal_point_sd: sd of u0 and of v0, as a fraction of the width.
        focal_range_px: ``(low, high)`` of fx, fy: a Gaussian on log f as wide as the range, with a wall at either end.
        tilt_sd_deg: sd of the mount's roll and pitch, degrees, shared by all views; ``None``: perfectly upright.
        radial_sd: sd of one radial term k (x_d = x (1 + k r^2), r in normalised coordinates), shared by all views;
            ``None``: a straight lens.
    """

    image_size: tuple[float, float] | None = None
    aspect_sd: float | None = 0.005
    principal_point_sd: float | None = 0.03
    focal_range_px: tuple[float, float] | None = None
    tilt_sd_deg: float | None = None
    radial_sd: float | None = None

    def __post_init__(self) -> None:
        for name in ("aspect_sd", "principal_point_sd", "tilt_sd_deg", "radial_sd"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"a standard deviation must be positive, not {value}", where=f"priors.{name}")
        size = self.image_size
        if size is not None and not (np.all(np.isfinite(size)) and min(size) >= 1):
            raise InputError(f"an image size must be positive, not {size}", where="priors.image_size")
        span = self.focal_range_px
        if span is not None and not (np.all(np.isfinite(span)) and 0 < span[0] < span[1]):
            raise InputError(f"a focal range must be (low, high) in pixels, not {span}", where="priors.focal_range_px")
