"""The internals of each group, given the data's normal equations in them: soft priors added, and solved in closed form.

Shape legend: H hypotheses, G groups of views that share internals, K right-hand sides. Internals are (fx, fy, u0, v0).
Priors are one array: sd of log(fy/fx), sd of the principal point (px), its expected u0 and v0, and the ends of the
range of log f; an sd of 0, or a range without width, is no prior.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.kernels import kernel

FloatArray = npt.NDArray[np.float64]

_WALL_SD = 0.05
"""Of log f: how hard the ends of a focal range are."""


@kernel
def _log_f(f: float) -> float:
    return float(np.log(max(abs(f), 1e-9)))


@kernel
def _focal_terms(log_f: float, low: float, high: float) -> tuple[float, float, float]:
    """Cost, half derivative and half curvature in log f: a Gaussian as wide as the range, with a wall at either end."""
    half, offset = (high - low) / 2, log_f - (low + high) / 2
    beyond = np.sign(offset) * max(abs(offset) - half, 0.0)
    # fx and fy each carry half of the Gaussian, since they are two readings of one focal length.
    soft, wall = 0.5 / half**2, 0.5 / _WALL_SD**2
    curvature = soft + (wall if beyond != 0.0 else 0.0)
    return soft * offset**2 + wall * beyond**2, soft * offset + wall * beyond, curvature


@kernel
def _cost(internals: FloatArray, priors: FloatArray) -> float:
    log_x, log_y = _log_f(internals[0]), _log_f(internals[1])
    cost = 0.0
    if priors[0] > 0.0:
        cost += np.log1p(((log_y - log_x) / priors[0]) ** 2)
    if priors[1] > 0.0:
        cost += np.log1p(((internals[2] - priors[2]) / priors[1]) ** 2)
        cost += np.log1p(((internals[3] - priors[3]) / priors[1]) ** 2)
    if priors[5] > priors[4]:
        cost += _focal_terms(log_x, priors[4], priors[5])[0] + _focal_terms(log_y, priors[4], priors[5])[0]
    return cost


@kernel
def _add(hessian: FloatArray, gradient: FloatArray, internals: FloatArray, priors: FloatArray) -> None:
    """Add the priors' Gauss-Newton rows; Cauchy losses weigh 1 / (1 + r^2)."""
    fx, fy = max(abs(internals[0]), 1e-9), max(abs(internals[1]), 1e-9)
    if priors[0] > 0.0:
        r = (np.log(fy) - np.log(fx)) / priors[0]
        w, jx, jy = 1.0 / (1.0 + r * r), -1.0 / (fx * priors[0]), 1.0 / (fy * priors[0])
        hessian[0, 0] += w * jx * jx
        hessian[1, 1] += w * jy * jy
        hessian[0, 1] += w * jx * jy
        hessian[1, 0] += w * jx * jy
        gradient[0] += w * jx * r
        gradient[1] += w * jy * r
    if priors[1] > 0.0:
        for k in (2, 3):
            r = (internals[k] - priors[k]) / priors[1]
            w = 1.0 / (1.0 + r * r)
            hessian[k, k] += w / priors[1] ** 2
            gradient[k] += w * r / priors[1]
    if priors[5] > priors[4]:
        for k, f in ((0, fx), (1, fy)):
            _, slope, curvature = _focal_terms(np.log(f), priors[4], priors[5])
            hessian[k, k] += curvature / f**2
            gradient[k] += slope / f


@kernel
def _inverse(value: float) -> float:
    return 1.0 / value if value > 0.0 else 0.0


@kernel
def _solve(h: FloatArray, rhs: FloatArray, out: FloatArray) -> None:
    """Solve ``h`` (4, 4) for right-hand sides ``(4, K)``; only fx-u0, fy-v0 and fx-fy are coupled.

    A singular system gives zeros in the directions that nothing determines.
    """
    cu, cv, bu, bv, c = _inverse(h[2, 2]), _inverse(h[3, 3]), h[0, 2], h[1, 3], h[0, 1]
    a, d = h[0, 0] - bu * bu * cu, h[1, 1] - bv * bv * cv
    # Cancellation leaves dust where all points share one x (or y): it must not pass for information.
    a = 0.0 if a <= 1e-13 * h[0, 0] else a
    d = 0.0 if d <= 1e-13 * h[1, 1] else d
    ia = _inverse(a)
    left = d - c * c * ia
    left = 0.0 if left <= 1e-13 * d else left
    for k in range(rhs.shape[1]):
        rx, ry = rhs[0, k] - bu * cu * rhs[2, k], rhs[1, k] - bv * cv * rhs[3, k]
        fy = (ry - c * ia * rx) * _inverse(left)
        fx = (rx - c * fy) * ia
        out[0, k], out[1, k] = fx, fy
        out[2, k], out[3, k] = (rhs[2, k] - bu * fx) * cu, (rhs[3, k] - bv * fy) * cv


@kernel
def prior_cost(internals: FloatArray, priors: FloatArray) -> FloatArray:
    """-2 log prior ``(H, G)``, up to a constant, at internals ``(H, G, 4)``."""
    cost = np.zeros(internals.shape[:2])
    for h in range(internals.shape[0]):
        for g in range(internals.shape[1]):
            cost[h, g] = _cost(internals[h, g], priors)
    return cost


@kernel
def add_priors(hessian: FloatArray, gradient: FloatArray, internals: FloatArray, priors: FloatArray) -> None:
    """Add the priors' rows, in place, to ``(H, G, 4, 4)`` and ``(H, G, 4)``."""
    for h in range(internals.shape[0]):
        for g in range(internals.shape[1]):
            _add(hessian[h, g], gradient[h, g], internals[h, g], priors)


@kernel
def solve_pairs(hessian: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve ``(H, G, 4, 4) @ x = (H, G, 4, K)``."""
    out = np.zeros(rhs.shape)
    for h in range(rhs.shape[0]):
        for g in range(rhs.shape[1]):
            _solve(hessian[h, g], rhs[h, g], out[h, g])
    return out


@kernel
def settle(data: FloatArray, rhs: FloatArray, start: FloatArray, priors: FloatArray, steps: int) -> FloatArray:
    """Internals ``(H, G, 4)`` after Newton steps from a start; the data give ``(H, G, 4, 4)`` and ``(H, G, 4)``."""
    internals = start.copy()
    hessian, gradient, step = np.empty((4, 4)), np.empty((4, 1)), np.empty((4, 1))
    for h in range(start.shape[0]):
        for g in range(start.shape[1]):
            for _ in range(steps):
                for a in range(4):
                    gradient[a, 0] = -rhs[h, g, a]
                    for b in range(4):
                        hessian[a, b] = data[h, g, a, b]
                        gradient[a, 0] += data[h, g, a, b] * internals[h, g, b]
                _add(hessian, gradient[:, 0], internals[h, g], priors)
                _solve(hessian, gradient, step)
                internals[h, g] -= step[:, 0]
    return internals
