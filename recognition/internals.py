"""The inner problem of variable projection: internals that fit best when the pose, hence x = X/Z and y = Y/Z, is given.

u = fx x + u0 and v = fy y + v0 are linear in the internals; the priors are extra rows. Shape legend, here and in
``varpro``: H hypotheses, N points (padded), G groups of views that share internals, P pose parameters. Internals are
in the order (fx, fy, u0, v0).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.priors import Priors

FloatArray = npt.NDArray[np.float64]

_WALL_SD = 0.05  # of log f: how hard the ends of a focal range are
_FX, _FY, _U0, _V0 = range(4)


def cauchy_weight(r: FloatArray) -> FloatArray:
    """Weight of a residual ``r`` in sd under the loss log(1 + r^2): one at the centre, fading with the square."""
    return np.asarray(1.0 / (1.0 + r * r))


def prior_residuals(internals: FloatArray, priors: Priors) -> dict[str, FloatArray]:
    """Residuals in sd, each ``(H, G)``, of the priors at internals ``(H, G, 4)``."""
    log_f = np.log(np.maximum(np.abs(internals[..., :2]), 1e-9))
    out: dict[str, FloatArray] = {}
    if priors.aspect_sd is not None:
        out["aspect"] = (log_f[..., 1] - log_f[..., 0]) / priors.aspect_sd
    if priors.principal_point_sd is not None and priors.image_size is not None:
        width, height = priors.image_size
        out["u0"] = (internals[..., _U0] - (width - 1) / 2) / (priors.principal_point_sd * width)
        out["v0"] = (internals[..., _V0] - (height - 1) / 2) / (priors.principal_point_sd * width)
    if priors.focal_range_px is not None:
        low, high = np.log(priors.focal_range_px)
        out["fx"], out["fy"] = (log_f[..., k] - (low + high) / 2 for k in (0, 1))
    return out


def prior_cost(internals: FloatArray, priors: Priors | None) -> FloatArray:
    """-2 log prior, up to a constant, ``(H, G)``."""
    cost = np.zeros(internals.shape[:2])
    if priors is None:
        return cost
    for name, r in prior_residuals(internals, priors).items():
        cost = cost + (_focal_terms(r, priors)[0] if name in ("fx", "fy") else np.log1p(r * r))
    return cost


def _focal_terms(offset: FloatArray, priors: Priors) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cost, its half derivative and its half curvature in log f, for log f ``offset`` from the middle of the range."""
    assert priors.focal_range_px is not None
    low, high = np.log(priors.focal_range_px)
    half = (high - low) / 2
    beyond = np.sign(offset) * np.maximum(np.abs(offset) - half, 0.0)
    # fx and fy each carry half of the Gaussian, since they are two readings of one focal length.
    soft, wall = 0.5 / half**2, 0.5 / _WALL_SD**2
    curvature = soft + wall * (beyond != 0)
    return soft * offset**2 + wall * beyond**2, soft * offset + wall * beyond, curvature


def add_priors(hessian: FloatArray, gradient: FloatArray, internals: FloatArray, priors: Priors | None) -> None:
    """Add the priors' Gauss-Newton rows, in place, to ``(H, G, 4, 4)`` and ``(H, G, 4)`` at the given internals."""
    if priors is None:
        return
    fx, fy = (np.maximum(np.abs(internals[..., k]), 1e-9) for k in (_FX, _FY))
    for name, r in prior_residuals(internals, priors).items():
        if name == "aspect":
            assert priors.aspect_sd is not None
            w = cauchy_weight(r)
            jx, jy = -1.0 / (fx * priors.aspect_sd), 1.0 / (fy * priors.aspect_sd)
            hessian[..., _FX, _FX] += w * jx * jx
            hessian[..., _FY, _FY] += w * jy * jy
            hessian[..., _FX, _FY] += w * jx * jy
            hessian[..., _FY, _FX] += w * jx * jy
            gradient[..., _FX] += w * jx * r
            gradient[..., _FY] += w * jy * r
        elif name in ("fx", "fy"):
            k, f = (_FX, fx) if name == "fx" else (_FY, fy)
            _, slope, curvature = _focal_terms(r, priors)
            hessian[..., k, k] += curvature / f**2
            gradient[..., k] += slope / f
        else:
            assert priors.principal_point_sd is not None
            assert priors.image_size is not None
            k, j = (_U0 if name == "u0" else _V0), 1.0 / (priors.principal_point_sd * priors.image_size[0])
            w = cauchy_weight(r)
            hessian[..., k, k] += w * j * j
            gradient[..., k] += w * j * r


def solve_pairs(hessian: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve ``(H, G, 4, 4) @ x = (H, G, 4, K)`` in closed form; only fx-u0, fy-v0 and fx-fy are coupled.

    LAPACK on thousands of 4 x 4 systems costs more than all the rest of a step. Singular systems give zeros in the
    directions that nothing determines.
    """
    h = hessian
    cu, cv = (_safe_inverse(h[..., k, k])[..., None] for k in (_U0, _V0))
    bu, bv = h[..., _FX, _U0, None], h[..., _FY, _V0, None]
    a = h[..., _FX, _FX, None] - bu * bu * cu
    d = h[..., _FY, _FY, None] - bv * bv * cv
    c = h[..., _FX, _FY, None]
    # Cancellation leaves dust where all points share one x (or y): it must not pass for information.
    a = np.where(a <= 1e-13 * h[..., _FX, _FX, None], 0.0, a)
    d = np.where(d <= 1e-13 * h[..., _FY, _FY, None], 0.0, d)
    rx = rhs[..., _FX, :] - bu * cu * rhs[..., _U0, :]
    ry = rhs[..., _FY, :] - bv * cv * rhs[..., _V0, :]
    ia = _safe_inverse(a)
    fy = (ry - c * ia * rx) * _safe_inverse(np.where(d - c * c * ia <= 1e-13 * d, 0.0, d - c * c * ia))
    fx = (rx - c * fy) * ia
    u0 = (rhs[..., _U0, :] - bu * fx) * cu
    v0 = (rhs[..., _V0, :] - bv * fy) * cv
    return np.stack([fx, fy, u0, v0], axis=-2)


def _safe_inverse(value: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore"):
        return np.asarray(np.where(value > 0, 1.0 / value, 0.0))


def log_determinant(inner: FloatArray, outer: FloatArray) -> FloatArray:
    """log det ``(H,)`` of the joint information: internals ``(H, G, 4, 4)`` and what is left of it, ``(H, P, P)``.

    Directions without information are floored, so that two hypotheses on the same views stay comparable.
    """
    values = np.linalg.eigvalsh(inner).reshape(len(inner), -1)
    rest = np.linalg.eigvalsh(np.where(np.isfinite(outer), outer, 0.0))
    return np.asarray(np.log(np.maximum(values, 1e-12)).sum(axis=1) + np.log(np.maximum(rest, 1e-12)).sum(axis=1))
