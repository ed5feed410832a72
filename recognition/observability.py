"""Which directions of a pose the views leave open, in words: pose against the internals that can make up for it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from recognition.internals import solve_pairs

FloatArray = npt.NDArray[np.float64]

OPEN_ANGLE_RAD = 0.5
OPEN_FRACTION = 0.5
"""A direction is open if its sd exceeds this angle, or this fraction of the distance: linear thinking ends there."""

NAMES = {4: ("theta_deg", "x_mm", "y_mm", "z_mm"), 6: ("rx_deg", "theta_deg", "rz_deg", "x_mm", "y_mm", "z_mm")}
_INTERNALS = ("focal length", "focal length", "principal point u0", "principal point v0")


def open_directions(covariance: FloatArray, distance_mm: float) -> FloatArray:
    """Orthonormal basis ``(P, k)``, in units of the open angle and distance, of directions that the views leave open.

    Args:
        covariance: ``(P, P)`` of the pose, radians and mm, silent directions huge.
        distance_mm: from the camera to the points.
    """
    p = len(covariance)
    unit = _unit(p, distance_mm)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(vectors[:, values > 1.0])


def _unit(p: int, distance_mm: float) -> FloatArray:
    return np.array([OPEN_ANGLE_RAD] * (p - 3) + [OPEN_FRACTION * distance_mm] * 3)


def unobservable(
    basis: FloatArray, inner: FloatArray, mixed: FloatArray, information: FloatArray, distance_mm: float
) -> tuple[str, ...]:
    """Names of the open directions.

    Args:
        basis: ``(P, k)`` from ``open_directions``.
        inner: ``(G, 4, 4)`` information of the internals at a given pose.
        mixed: ``(G, 4, P)`` information between internals and pose.
        information: ``(P,)`` diagonal of the information of the pose at given internals.
        distance_mm: from the camera to the points.
    """
    if basis.shape[1] == 0:
        return ()
    p = len(basis)
    directions = basis * _unit(p, distance_mm)[:, None]
    answer = -solve_pairs(inner[None], mixed[None] @ directions)[0]  # what the internals do to make up, (G, 4, k)
    # Everything in sd of effect on the picture, so that millimetres, radians and pixels can be compared.
    pose = directions * np.sqrt(np.maximum(information, 0.0))[:, None]
    each = answer * np.sqrt(np.maximum(np.einsum("gaa->ga", inner), 0.0))[..., None]
    together = np.concatenate([pose, each.reshape(-1, basis.shape[1])])
    readable = _readable(together, p)
    # Among themselves the pose's components are compared by how far they move, in open angles and distances.
    to_units = 1.0 / (np.sqrt(np.maximum(information, 1e-300)) * _unit(p, distance_mm))
    return tuple(_name(column[:p] * to_units, column[p:]) for column in readable.T)


def _readable(vectors: FloatArray, p: int) -> FloatArray:
    """The same space with a basis that reads well: one direction for each principal point coordinate, one for depth."""
    vectors = np.linalg.qr(vectors)[0]
    x, y, z = p - 3, p - 2, p - 1
    order = [p + 2, p + 3, z, x, y, *range(p - 3)]
    used: list[int] = []
    for row in order:
        free = [c for c in range(vectors.shape[1]) if c not in used]
        if not free:
            break
        column = max(free, key=lambda c: abs(vectors[row, c]))
        if abs(vectors[row, column]) < 1e-3 * np.linalg.norm(vectors[:, column]):
            continue
        pivot = vectors[:, column] / vectors[row, column]
        vectors = vectors - np.outer(pivot, vectors[row])
        vectors[:, column] = pivot
        used.append(column)
    return vectors[:, used]


def _name(pose: FloatArray, each: FloatArray) -> str:
    internals = np.abs(each).reshape(-1, 4).max(axis=0)
    moved = [NAMES[len(pose)][k] for k in np.argsort(-np.abs(pose)) if abs(pose[k]) > 0.2 * np.abs(pose).max()]
    # Translations first: "z_mm against theta_deg and focal length" reads better than the reverse.
    moved.sort(key=lambda name: not name.endswith("_mm"))
    names = [_INTERNALS[k] for k in np.argsort(-internals) if internals[k] > 0.3 * max(internals.max(), 1e-300)]
    others = list(dict.fromkeys(moved[1:] + names))
    listed = " and ".join(filter(None, [", ".join(others[:-1]), *others[-1:]]))
    return f"{moved[0]} against {listed}" if listed else str(moved[0])
