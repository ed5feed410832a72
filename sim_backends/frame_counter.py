"""Draws a number into a picture as black and white blocks, and reads it back, also after JPEG."""

from __future__ import annotations

import numpy as np

from rig.hal import Image

BLOCK_PX = 8
LARGEST = (1 << 24) - 1
_BITS, _COLUMNS = 32, 8


def draw_counter(image: Image, number: int, block_px: int = BLOCK_PX) -> None:
    """Draw a number into the top left corner, 8 by 4 blocks, in place.

    Raises:
        ValueError: the number is negative or above `LARGEST`, or the picture too small.
    """
    if not 0 <= number <= LARGEST:
        raise ValueError(f"the frame counter {number} is outside 0 .. {LARGEST}")
    rows = _BITS // _COLUMNS
    if image.shape[0] < rows * block_px or image.shape[1] < _COLUMNS * block_px:
        raise ValueError(f"a picture of {image.shape[1]}x{image.shape[0]} has no room for blocks of {block_px} pixels")
    word = number << 8 | _check(number)
    bits = np.array([word >> k & 1 for k in range(_BITS)], dtype=np.uint8).reshape(rows, _COLUMNS) * np.uint8(255)
    blocks = bits.repeat(block_px, axis=0).repeat(block_px, axis=1)
    corner = image[: blocks.shape[0], : blocks.shape[1]]
    corner[...] = blocks if image.ndim == 2 else blocks[..., None]


def read_counter(image: Image, block_px: int = BLOCK_PX) -> int | None:
    """The number that was drawn; ``None``: there is none that can be read."""
    rows = _BITS // _COLUMNS
    corner = image[: rows * block_px, : _COLUMNS * block_px]
    if corner.shape[:2] != (rows * block_px, _COLUMNS * block_px):
        return None
    means = corner.reshape(rows, block_px, _COLUMNS, -1).mean(axis=(1, 3))
    word = int(sum(1 << k for k, mean in enumerate(means.ravel()) if mean > 127.5))
    number = word >> 8
    return number if word & 0xFF == _check(number) else None


def _check(number: int) -> int:
    """A sum that neither an all-black nor an all-white corner has."""
    return (sum(number.to_bytes(3, "big")) + 85) & 0xFF
