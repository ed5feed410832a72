"""The image of a vertical wall in an upright camera, from one part: six numbers instead of a full homography.

With s along the wall and y down it (mm, from the part's centre), an upright camera sees

    u = (a s + b) / (c s + 1),    v = (d s + e y + g) / (c s + 1)

so that four corners give the six numbers linearly. They hold all that coplanar invariants can tell (design §3):
e = fy / z0, c = sin(alpha) / z0, a = fx cos(alpha) / z0 + u0 c, b = fx x0 / z0 + u0, d = v0 c, g = fy y0 / z0 + v0,
where the part's centre is at (x0, y0, z0) and alpha is the wall's turn away from the image plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WallFit:
    """``(..., 6)`` the numbers a, b, c, d, e, g; ``(...,)`` rms residual, px, and the sd of c, 1/mm."""

    numbers: FloatArray
    rms_px: FloatArray
    c_sd: FloatArray


def fit_wall(local_mm: FloatArray, pixels: FloatArray, sigma_px: FloatArray) -> WallFit:
    """Least squares of the six numbers.

    Args:
        local_mm: ``(N, C, 2)`` corners in the wall, from the part's centre.
        pixels: ``(N, C, 2)`` where they were seen. Repeated (padded) corners do no harm.
        sigma_px: ``(N,)`` sd of one corner coordinate.
    """
    scale = np.abs(local_mm).max(axis=(1, 2))
    s, y = np.moveaxis(local_mm / scale[:, None, None], -1, 0)
    mid = pixels.mean(axis=1, keepdims=True)
    spread = np.maximum(np.abs(pixels - mid).max(axis=(1, 2)), 1e-6)
    u, v = np.moveaxis((pixels - mid) / spread[:, None, None], -1, 0)
    one, zero = np.ones_like(s), np.zeros_like(s)
    rows_u = np.stack([s, one, -u * s, zero, zero, zero], axis=-1)
    rows_v = np.stack([zero, zero, -v * s, s, y, one], axis=-1)
    design = np.concatenate([rows_u, rows_v], axis=1)
    seen = np.concatenate([u, v], axis=1)
    normal = np.einsum("nri,nrj->nij", design, design) + 1e-9 * np.eye(6)
    inverse = np.linalg.inv(normal)
    x = np.einsum("nij,nrj,nr->ni", inverse, design, seen)
    residual = seen - np.einsum("nri,ni->nr", design, x)
    a, b, c, d, e, g = np.moveaxis(x * np.array([1, 1, 0, 1, 1, 1]) * spread[:, None], -1, 0)
    c = x[:, 2]
    # Back from pixels about their mean and lengths in units of the part.
    mu, mv = mid[:, 0, 0], mid[:, 0, 1]
    numbers = np.stack([a + mu * c, b + mu, c, d + mv * c, e, g + mv], axis=-1)
    numbers[:, [0, 2, 3, 4]] /= scale[:, None]
    c_sd = np.sqrt(inverse[:, 2, 2]) * sigma_px / spread / scale
    return WallFit(numbers, np.sqrt((residual**2).mean(axis=1)) * spread, c_sd)


def wall_to_image(numbers: FloatArray, local_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels ``(..., 2)`` and relative depth ``(...,)`` of wall points ``(..., 2)``; numbers ``(..., 6)``."""
    a, b, c, d, e, g = np.moveaxis(numbers, -1, 0)
    s, y = local_mm[..., 0], local_mm[..., 1]
    depth = c * s + 1.0
    safe = np.where(depth > 1e-3, depth, 1e-3)
    return np.stack([(a * s + b) / safe, (d * s + e * y + g) / safe], axis=-1), depth
