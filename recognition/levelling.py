"""Undoes the mount's roll in a picture, so that the recogniser may go on taking cameras for upright."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from recognition.geometry import Mount
from rig.hal import Frame


def levelled(frame: Frame, mount: Mount) -> Frame:
    """The frame as a camera without roll would have taken it; the very same frame where the mount has no roll.

    A roll can be undone without knowing the internals: turning the picture about any point is turning it about the
    principal point and shifting that (fx and fy are nearly equal). A pitch cannot; but a small one is a shift of the
    principal point but for a keystone of f x y pitch, 0.6 px at the corners of a usual picture for 0.5 degrees.
    """
    if not mount.roll_deg:
        return frame
    import cv2

    height, width = frame.image.shape[:2]
    turn = Mount(roll_deg=mount.roll_deg).tilt[:2, :2]
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    # Level pixel -> pixel of the picture as taken.
    back = np.column_stack([turn, centre - turn @ centre])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    image = cv2.warpAffine(frame.image, back, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return replace(frame, image=np.asarray(image, dtype=np.uint8))
