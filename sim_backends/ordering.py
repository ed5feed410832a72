"""Which facet can hide which, and the order in which to paint them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sim_backends.walls import Wall

FloatArray = npt.NDArray[np.float64]


def hiding_matrix(walls: Sequence[Wall], bodies: FloatArray) -> npt.NDArray[np.bool_]:
    """``(n, n)``: [i, j] if wall or body i can hide j from some camera that sees the fronts of both.

    Args:
        walls: n walls, each seen from its front only.
        bodies: ``(m, 3)`` centres of bodies, numbered after the walls.

    A camera in front of wall i sees j past i only where j reaches behind i's plane, and i can stand between the camera
    and j only where it reaches in front of j's plane; so the answer does not depend on the camera.
    """
    shapes = [w.corners_mm for w in walls] + [b[None] for b in bodies]
    reach = max(float(np.ptp(np.concatenate(shapes), axis=0).max()), 1.0)
    n = len(walls)
    in_front = np.ones((len(shapes), n), dtype=bool)  # [j, i]: some of j lies in front of wall i
    behind = np.ones((len(shapes), n), dtype=bool)
    for i, wall in enumerate(walls):
        for j, shape in enumerate(shapes):
            side = (shape - wall.corners_mm[0]) @ wall.normal
            in_front[j, i], behind[j, i] = side.max() > 1e-6 * reach, side.min() < -1e-6 * reach
    hides = np.zeros((len(shapes), len(shapes)), dtype=bool)
    hides[:n, :n] = behind[:n].T & in_front[:n]
    hides[:n, n:] = behind[n:].T
    hides[n:, :n] = in_front[n:]
    np.fill_diagonal(hides, False)
    return hides


def paint_order(indices: Sequence[int], hides: npt.NDArray[np.bool_], distances: FloatArray) -> list[int]:
    """The facets ``indices`` from far to near.

    A facet is painted when nothing that it can hide is left; among those, and wherever facets hide each other in a
    ring, the most distant (``distances``, one per facet) goes first.
    """
    left = sorted(indices, key=lambda i: -distances[i])
    mutual = hides & hides.T
    blocking = hides & ~mutual
    order: list[int] = []
    while left:
        grid = blocking[np.ix_(left, left)]
        free = np.flatnonzero(~grid.any(axis=1))
        order.append(left.pop(int(free[0]) if len(free) else 0))
    return order
