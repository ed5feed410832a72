"""Normalised coordinates of points seen from known camera poses, with derivatives in the object's placement.

Shape legend: H hypotheses, N points, V views, P parameters. The object's placement in the rig frame is
p_rig = R p + d; view v sees p_cam = T Ry(theta_v) (p_rig - c_v), T being the mount's tilt, and x = X/Z, y = Y/Z, times
1 + k r^2 where a radial term is carried. Parameters, in this order: rotation (1 about Y, radians; or 3, a small
rotation from the left), d (3, mm), then, where asked for, roll and pitch of the mount (radians) and k.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class State:
    """Where the object is, and the nuisances: the unknowns besides the internals.

    ``rotation`` (H,) angle about Y in radians, or (H, 3, 3); ``shift`` (H, 3) mm; ``tilt`` (H, 2) roll and pitch,
    radians, and ``radial`` (H,), or ``None`` where they are not carried.
    """

    rotation: FloatArray
    shift: FloatArray
    tilt: FloatArray | None = None
    radial: FloatArray | None = None

    @property
    def size(self) -> int:
        """P, the number of parameters."""
        rotation = 1 if self.rotation.ndim == 1 else 3
        return rotation + 3 + (0 if self.tilt is None else 2) + (0 if self.radial is None else 1)

    def moved(self, step: FloatArray) -> State:
        """The state after a step ``(H, P)``."""
        k = 1 if self.rotation.ndim == 1 else 3
        rotation = self.rotation + step[:, 0] if k == 1 else rotation_exp(step[:, :3]) @ self.rotation
        at = k + 3
        tilt, radial = self.tilt, self.radial
        if tilt is not None:
            tilt, at = tilt + step[:, at : at + 2], at + 2
        if radial is not None:
            radial = radial + step[:, at]
        return State(rotation, self.shift + step[:, k : k + 3], tilt, radial)

    def where(self, chosen: npt.NDArray[np.bool_], other: State) -> State:
        """This state where ``chosen`` (H,), else ``other``."""
        return self._map(lambda a, b: np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b), other)

    def take(self, index: IntArray) -> State:
        """The state of some of the hypotheses."""
        return self._map(lambda a, _: a[index], self)

    def put(self, index: IntArray, part: State) -> State:
        """This state with that of some hypotheses replaced."""
        return self._map(lambda a, b: replaced(a, index, b), part)

    def _map(self, change: Callable[[Any, Any], FloatArray], other: State) -> State:
        names = [name for name in State.__slots__ if getattr(self, name) is not None]
        return State(**{name: change(getattr(self, name), getattr(other, name)) for name in names})


def replaced(whole: npt.NDArray[Any], index: IntArray, part: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A copy with the rows at ``index`` replaced."""
    out = whole.copy()
    out[index] = part
    return out


@dataclass(frozen=True, slots=True)
class Normalised:
    """Coordinates ``x``, ``y`` (H, N), their derivatives ``dx``, ``dy`` (H, P, N), and ``depth`` (H, N) mm."""

    x: FloatArray
    y: FloatArray
    dx: FloatArray
    dy: FloatArray
    depth: FloatArray


def rotation_exp(omega: FloatArray) -> FloatArray:
    """Rodrigues' formula: rotations ``(H, 3, 3)`` of rotation vectors ``(H, 3)`` in radians."""
    angle = np.linalg.norm(omega, axis=-1)[:, None, None]
    k = cross_matrix(omega)
    # sinc forms stay exact at zero angle, where the plain formula divides by zero.
    sin_term, half_sinc = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + sin_term * k + 0.5 * half_sinc**2 * (k @ k))


def cross_matrix(v: FloatArray) -> FloatArray:
    """``(H, 3, 3)`` matrices with ``cross_matrix(v) @ p = v x p``."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    o = np.zeros_like(x)
    rows = [np.stack(r, axis=-1) for r in ([o, -z, y], [z, o, -x], [-y, x, o])]
    return np.asarray(np.stack(rows, axis=-2))


def normalise(state: State, points_mm: FloatArray, view: IntArray, cameras: FloatArray) -> Normalised:
    """Normalised coordinates and derivatives.

    Args:
        state: the placements, H of them.
        points_mm: ``(H, N, 3)`` in the object frame.
        view: ``(H, N)`` which camera sees each point.
        cameras: ``(V, 4)`` theta (radians) and centre (mm) in the rig frame.
    """
    seen = cameras[view]
    cos_v, sin_v = np.cos(seen[..., 0]), np.sin(seen[..., 0])
    if state.rotation.ndim == 1:
        turned, d_rotation = _upright(state.rotation, points_mm)
    else:
        turned, d_rotation = _free(state.rotation, points_mm)
    offset = state.shift[:, None, :] - seen[..., 1:]
    px, py, pz = (turned[k] + offset[..., k] for k in range(3))
    X, Y, Z = cos_v * px + sin_v * pz, py, cos_v * pz - sin_v * px
    zero, one = np.zeros_like(X), np.ones_like(X)
    d_shift = [(cos_v, zero, -sin_v), (zero, one, zero), (sin_v, zero, cos_v)]
    columns = [(cos_v * a + sin_v * c, b, cos_v * c - sin_v * a) for a, b, c in d_rotation] + d_shift
    if state.tilt is not None:
        X, Y, Z, columns = _tilted(state.tilt, X, Y, Z, columns)
    return _divide(X, Y, Z, columns, state.radial)


Triple = tuple[FloatArray, FloatArray, FloatArray]


def _upright(phi: FloatArray, p: FloatArray) -> tuple[Triple, list[Triple]]:
    """Ry(phi) p and its derivative in phi."""
    c, s = np.cos(phi)[:, None], np.sin(phi)[:, None]
    x, z = c * p[..., 0] + s * p[..., 2], c * p[..., 2] - s * p[..., 0]
    return (x, p[..., 1], z), [(z, np.zeros_like(x), -x)]


def _free(rotation: FloatArray, p: FloatArray) -> tuple[Triple, list[Triple]]:
    """R p and its derivatives in a small rotation from the left: e_k x (R p)."""
    q = p @ rotation.transpose(0, 2, 1)
    x, y, z = q[..., 0], q[..., 1], q[..., 2]
    o = np.zeros_like(x)
    return (x, y, z), [(o, -z, y), (z, o, -x), (-y, x, o)]


def _tilted(
    tilt: FloatArray, X: FloatArray, Y: FloatArray, Z: FloatArray, columns: list[Triple]
) -> tuple[FloatArray, FloatArray, FloatArray, list[Triple]]:
    """Apply T = Rx(pitch) Rz(roll) in the camera frame, and append its two columns."""
    (cr, sr), (cp, sp) = ((np.cos(tilt[:, k, None]), np.sin(tilt[:, k, None])) for k in (0, 1))

    def turn(x: FloatArray, y: FloatArray, z: FloatArray) -> Triple:
        x, y = cr * x - sr * y, sr * x + cr * y
        return x, cp * y - sp * z, sp * y + cp * z

    o = np.zeros_like(X)
    roll = turn(-Y, X, o)
    turned = [turn(*column) for column in columns]
    X, Y, Z = turn(X, Y, Z)
    return X, Y, Z, [*turned, roll, (o, -Z, Y)]


def _divide(
    X: FloatArray, Y: FloatArray, Z: FloatArray, columns: list[Triple], radial: FloatArray | None
) -> Normalised:
    """Perspective division (and the radial term) of camera-frame points and their derivatives."""
    inverse = 1.0 / np.where(np.abs(Z) < 1e-9, 1e-9, Z)
    x, y = X * inverse, Y * inverse
    dx = [(a - x * c) * inverse for a, _, c in columns]
    dy = [(b - y * c) * inverse for _, b, c in columns]
    if radial is not None:
        k, r2 = radial[:, None], x * x + y * y
        grow = 1.0 + k * r2
        dr2 = [2 * (x * a + y * b) for a, b in zip(dx, dy, strict=True)]
        dx = [a * grow + x * k * d for a, d in zip(dx, dr2, strict=True)] + [x * r2]
        dy = [b * grow + y * k * d for b, d in zip(dy, dr2, strict=True)] + [y * r2]
        x, y = x * grow, y * grow
    return Normalised(x, y, np.stack(dx, axis=1), np.stack(dy, axis=1), Z)
