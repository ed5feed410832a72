"""Errors of poses that solvers found, and the row of the table that they make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Of H trials, each ``(H,)``; infinite where a solver failed.

    Attributes:
        rotation_deg: angle between the rotations found and true.
        pan_deg: that of the pans alone: the rotation projected on a rotation about Y.
        centre_mm: between the camera centres, in the object frame.
    """

    rotation_deg: FloatArray
    pan_deg: FloatArray
    centre_mm: FloatArray

    @property
    def failures(self) -> int:
        """Trials without a pose."""
        return int(np.count_nonzero(~np.isfinite(self.centre_mm)))


@dataclass(frozen=True)
class Row:
    """A solver's line: its errors, and microseconds a solve by the wall's clock and of the processor.

    ``None`` for what is no solver.
    """

    name: str
    errors: Errors
    microseconds: float | None
    processor: float | None = None


def errors(rotation: FloatArray, shift: FloatArray, true_rotation: FloatArray, true_shift: FloatArray) -> Errors:
    """Errors of poses points -> camera, ``(H, 3, 3)`` and ``(H, 3)`` mm; NaN stands for a failure."""
    apart = rotation @ true_rotation.swapaxes(1, 2)
    # By the chord, since the arc cosine of the trace loses half the digits near zero.
    chord = np.linalg.norm(apart - np.eye(3), axis=(1, 2)) / np.sqrt(8.0)
    turn = np.degrees(2.0 * np.arcsin(np.clip(chord, 0.0, 1.0)))
    pan = np.degrees(_pan(rotation) - _pan(true_rotation))
    pan = np.abs((pan + 180.0) % 360.0 - 180.0)
    off = np.linalg.norm(centre(rotation, shift) - centre(true_rotation, true_shift), axis=1)
    failed = ~(np.isfinite(turn) & np.isfinite(off))
    return Errors(*(np.where(failed, np.inf, a) for a in (turn, pan, off)))


def centre(rotation: FloatArray, shift: FloatArray) -> FloatArray:
    """Camera centres ``(H, 3)`` in the object frame."""
    return np.asarray(-np.einsum("hji,hj->hi", rotation, shift))


def _pan(rotation: FloatArray) -> FloatArray:
    return np.asarray(np.arctan2(rotation[:, 0, 2], rotation[:, 0, 0]))


HEADER = (
    f"{'':58} {'rotation, deg':>15} {'pan alone, deg':>15} {'centre, mm':>15}  failed   us/solve\n"
    f"{'':58} {'median    p90':>15} {'median    p90':>15} {'median    p90':>15}            wall    cpu"
)


def line(row: Row) -> str:
    """A row of the table."""
    e = row.errors
    cells = " ".join(f"{pair(values):>15}" for values in (e.rotation_deg, e.pan_deg, e.centre_mm))
    took = "".join("" if t is None else f"{t:8.0f}" for t in (row.microseconds, row.processor))
    return f"{row.name:58} {cells} {e.failures:7d} {took}".rstrip()


def pair(values: FloatArray) -> str:
    """Median and 90th percentile; failures count as infinite."""
    low, high = np.quantile(values, [0.5, 0.9], method="lower")
    return f"{low:6.3f} {high:7.3f}" if high < 100 else f"{low:6.2f} {high:7.1f}"


@dataclass(frozen=True)
class Verdict:
    """Ours against the peers: ours' figure over the best peer's, and which peer that is."""

    rotation: float
    rotation_peer: str
    pan: float
    pan_peer: str
    centre: float
    centre_peer: str
    time: float
    time_peer: str
    fastest: float
    fastest_peer: str


def verdict(ours: Row, peers: list[Row]) -> Verdict:
    """Ratios of medians. ``time`` is over that peer's time whose rotation is best; ``fastest``, over the fastest's."""
    by = {
        "rotation": lambda row: float(np.median(row.errors.rotation_deg)),
        "pan": lambda row: float(np.median(row.errors.pan_deg)),
        "centre": lambda row: float(np.median(row.errors.centre_mm)),
        "time": lambda row: float(row.microseconds or np.inf),
    }
    best = {name: min(peers, key=of) for name, of in by.items()}
    ratio = {name: by[name](ours) / by[name](best[name]) for name in by}
    exact = best["rotation"]
    return Verdict(
        rotation=ratio["rotation"],
        rotation_peer=best["rotation"].name,
        pan=ratio["pan"],
        pan_peer=best["pan"].name,
        centre=ratio["centre"],
        centre_peer=best["centre"].name,
        time=by["time"](ours) / by["time"](exact),
        time_peer=exact.name,
        fastest=ratio["time"],
        fastest_peer=best["time"].name,
    )


def told(ours: Row, against: Verdict) -> str:
    """The verdict in words."""
    return (
        f"{ours.name}\n"
        f"    rotation {against.rotation:.2f} x ({against.rotation_peer}), pan alone {against.pan:.2f} x "
        f"({against.pan_peer}), centre {against.centre:.2f} x ({against.centre_peer})\n"
        f"    time 1/{1 / against.time:.0f} of the most exact peer's ({against.time_peer}), "
        f"1/{1 / against.fastest:.1f} of the fastest's ({against.fastest_peer})"
    )
