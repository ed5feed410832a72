"""The inner problem of variable projection: internals that fit best when the pose, hence x = X/Z and y = Y/Z, is given.

u = fx x + u0 and v = fy y + v0 are linear in the internals; the priors are extra rows. Shape legend, here and in
``varpro``: H hypotheses, N points (padded), G groups of views that share internals, P pose parameters. Internals are
in the order (fx, fy, u0, v0).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import inner
from recognition.priors import Priors

FloatArray = npt.NDArray[np.float64]


def prior_numbers(priors: Priors | None) -> FloatArray:
    """Priors as the kernels take them, ``(6,)``."""
    numbers = np.zeros(6)
    if priors is None:
        return numbers
    numbers[0] = priors.aspect_sd or 0.0
    if priors.principal_point_sd is not None and priors.image_size is not None:
        width, height = priors.image_size
        numbers[1:4] = priors.principal_point_sd * width, (width - 1) / 2, (height - 1) / 2
    if priors.focal_range_px is not None:
        numbers[4:] = np.log(priors.focal_range_px)
    return numbers


def prior_cost(internals: FloatArray, priors: Priors | None) -> FloatArray:
    """-2 log prior, up to a constant, ``(H, G)``."""
    return inner.prior_cost(np.ascontiguousarray(internals), prior_numbers(priors))


def add_priors(hessian: FloatArray, gradient: FloatArray, internals: FloatArray, priors: Priors | None) -> None:
    """Add the priors' Gauss-Newton rows, in place, to ``(H, G, 4, 4)`` and ``(H, G, 4)`` at the given internals."""
    inner.add_priors(hessian, gradient, internals, prior_numbers(priors))


def solve_pairs(hessian: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve ``(H, G, 4, 4) @ x = (H, G, 4, K)`` in closed form; only fx-u0, fy-v0 and fx-fy are coupled.

    LAPACK on thousands of 4 x 4 systems costs more than all the rest of a step. Singular systems give zeros in the
    directions that nothing determines.
    """
    return inner.solve_pairs(np.ascontiguousarray(hessian), np.ascontiguousarray(rhs))


def settle(data: FloatArray, rhs: FloatArray, start: FloatArray, priors: Priors, steps: int) -> FloatArray:
    """Internals ``(H, G, 4)`` after some Newton steps on data ``(H, G, 4, 4)``, ``(H, G, 4)`` and priors together."""
    return inner.settle(data, rhs, start, prior_numbers(priors), steps)


def log_determinant(information: FloatArray, outer: FloatArray) -> FloatArray:
    """log det ``(H,)`` of the joint information: internals ``(H, G, 4, 4)`` and what is left of it, ``(H, P, P)``.

    Directions without information are floored, so that two hypotheses on the same views stay comparable.
    """
    values = np.linalg.eigvalsh(information).reshape(len(information), -1)
    rest = np.linalg.eigvalsh(np.where(np.isfinite(outer), outer, 0.0))
    return np.asarray(np.log(np.maximum(values, 1e-12)).sum(axis=1) + np.log(np.maximum(rest, 1e-12)).sum(axis=1))
