"""What lens and sensor do to a picture: blur, exposure, noise."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rig.hal import Image
from sim_backends.appearance import Sensor


def expose(image: Image, sensor: Sensor, rng: np.random.Generator) -> Image:
    """Blur, exposure, noise and, if asked for, the loss of colour."""
    import cv2

    if sensor.blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), sensor.blur_px), dtype=np.uint8)
    gain = sensor.exposure * max(0.1, 1.0 + sensor.exposure_sd * float(rng.standard_normal()))
    if gain != 1.0:
        image = np.asarray(cv2.convertScaleAbs(image, alpha=gain), dtype=np.uint8)
    if sensor.grey:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    if sensor.noise_sd > 0:
        h, w = image.shape[:2]
        field = _noise((h + _SHIFTS, w + _SHIFTS, *image.shape[2:]), sensor.noise_sd)
        dy, dx = (int(n) for n in rng.integers(_SHIFTS, size=2))
        shifted = field[dy : dy + h, dx : dx + w]
        image = np.asarray(cv2.add(image, shifted, dtype=cv2.CV_8U), dtype=np.uint8)
    return image


_SHIFTS = 128


@lru_cache(maxsize=2)
def _noise(shape: tuple[int, ...], sd: float) -> npt.NDArray[np.int16]:
    """Rounded normal noise. Drawing it anew costs as much as the picture, so views take windows of one field."""
    noise = np.random.default_rng(97).standard_normal(shape, dtype=np.float32) * np.float32(sd)
    return np.asarray(np.rint(noise), dtype=np.int16)
