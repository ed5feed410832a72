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

from recognition.geometry import rotation_y
from recognition.kernels import projection as kernels

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
    place, slope, depth = kernels.normalise(points_mm, view, camera_rows(cameras), *arrays(state))
    return Normalised(place[:, 0], place[:, 1], slope[:, 0], slope[:, 1], depth)


def arrays(state: State) -> tuple[FloatArray, bool, FloatArray, FloatArray, FloatArray]:
    """A state as the kernels take it: rotations ``(H, 3, 3)``, whether about Y alone, shift, tilt and radial term.

    What is not carried has no columns, ``(H, 0)``. All are contiguous: kernels are compiled anew for each layout.
    """
    none = np.zeros((len(state.shift), 0))
    upright = state.rotation.ndim == 1
    rotation = rotation_y(state.rotation) if upright else state.rotation
    tilt = none if state.tilt is None else np.ascontiguousarray(state.tilt)
    radial = none if state.radial is None else state.radial[:, None].copy()
    return np.ascontiguousarray(rotation), upright, np.ascontiguousarray(state.shift), tilt, radial


def camera_rows(cameras: FloatArray) -> FloatArray:
    """``(V, 5)`` cos and sin of the pan, and centre, of cameras ``(V, 4)``."""
    pan = cameras[:, 0]
    return np.concatenate([np.cos(pan)[:, None], np.sin(pan)[:, None], cameras[:, 1:]], axis=1)
