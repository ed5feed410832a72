"""Prints how right `rig align` is, and how right what it says of its own sureness is, on rendered scans.

Run from the repository: ``python -m benchmarks.bench_align [--scans 24] [--first 0] [--sd-mm 0.05] [--sd-deg 0.02]``.
Each scan draws from its number: the wall and its material, the mount, the camera's internals (one radial term among
them) and where the rig really stands at each of 36 told poses (3 x 2 x 2 places 30 to 40 mm around the middle, some
400 mm from the wall, at pans of -15, 0 and 15 degrees). The pictures have 640 x 480 pixels, blur and noise.
Exit code 1 if less than 85 % of the errors lie within 2 sd (95 % are due; the margin is for the number of scans).
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from calibration_free_tests.alignment.synthetic import SIZE, lattice
from calibration_free_tests.alignment.textured_wall import pictures, textured_wall
from recognition.alignment.estimate import MOUNT, estimate_mount
from recognition.alignment.moves import Moves
from recognition.alignment.tracks import find_features, follow
from recognition.geometry import Mount
from rig.errors import DegenerateGeometryError
from sim_backends.projection import Internals

FloatArray = npt.NDArray[np.float64]

MATERIALS = ("stone", "brick", "plaster")
LEAST_WITHIN = 0.85


@dataclass(frozen=True)
class Scan:
    """How one scan came out: errors and told sd ``(5,)`` in the order of MOUNT, times, and what was found."""

    error: FloatArray
    sd: FloatArray
    seconds: tuple[float, float, float]
    told: str = field(repr=False)


def drawn(rng: np.random.Generator) -> tuple[Mount, Internals]:
    """A mount and a camera as benches may have them."""
    x_mm, z_mm = rng.uniform((-30.0, 0.0), (30.0, 80.0))
    pan, roll, pitch = rng.uniform(-1.0, 1.0, 3) * (5.0, 1.5, 1.5)
    mount = Mount(x_mm=x_mm, z_mm=z_mm, pan_zero_deg=pan, roll_deg=roll, pitch_deg=pitch)
    f, aspect, k1 = rng.uniform((750.0, 0.99, -0.1), (1100.0, 1.01, 0.02))
    u0, v0 = rng.normal((SIZE[0] / 2, SIZE[1] / 2), 15.0)
    return mount, Internals(f, f * aspect, u0, v0, k1)


def one(number: int, sd_mm: float, sd_deg: float) -> Scan:
    """Render a scan and align from it."""
    rng = np.random.default_rng([number, 31])
    mount, lens = drawn(rng)
    poses = lattice()
    scene = textured_wall(number, MATERIALS[number % len(MATERIALS)])
    images = list(pictures(scene, poses, mount, lens, rng, sd_mm=sd_mm, sd_deg=sd_deg))
    moves = Moves.of(poses)
    ticks = [time.perf_counter()]
    features = [find_features(image) for image in images]
    ticks.append(time.perf_counter())
    tracks = follow(features, moves)
    ticks.append(time.perf_counter())
    found = estimate_mount(tracks, moves, SIZE, motion_sd_mm=sd_mm, motion_sd_deg=sd_deg)
    ticks.append(time.perf_counter())
    error = np.array([found.values[name] - getattr(mount, name) for name in MOUNT])
    told = f"{found.points} points seen {found.observations} times, {found.residual_px:.2f} px, {found.explained:.0%}"
    a, b, c = np.diff(ticks)
    return Scan(error, np.array([found.sd[name] for name in MOUNT]), (float(a), float(b), float(c)), told)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=24)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sd-mm", type=float, default=0.05)
    parser.add_argument("--sd-deg", type=float, default=0.02)
    asked = parser.parse_args()
    scans, refused = [], 0
    for number in range(asked.first, asked.first + asked.scans):
        try:
            scans.append(one(number, asked.sd_mm, asked.sd_deg))
        except DegenerateGeometryError as reason:
            refused += 1
            print(f"scan {number}: refused: {reason}", flush=True)
            continue
        off = scans[-1].error / scans[-1].sd
        print(f"scan {number}: {scans[-1].told}; errors in sd: {' '.join(f'{z:+.1f}' for z in off)}", flush=True)
    if not scans:
        return 1
    errors, sds = np.array([scan.error for scan in scans]), np.array([scan.sd for scan in scans])
    off = np.abs(errors / sds)
    print(f"\n{len(scans)} scans, {refused} refused; moves repeat to {asked.sd_mm:g} mm and {asked.sd_deg:g} degrees")
    print(f"{'':14}{'median error':>14}{'p90':>9}{'median sd':>11}{'within 2 sd':>13}{'rms of error/sd':>17}")
    for k, name in enumerate(MOUNT):
        gap = np.abs(errors[:, k])
        print(
            f"{name:14}{np.median(gap):14.4f}{np.quantile(gap, 0.9):9.4f}{np.median(sds[:, k]):11.4f}"
            f"{(off[:, k] <= 2).mean():13.0%}{np.sqrt((off[:, k] ** 2).mean()):17.2f}"
        )
    within = float((off <= 2).mean())
    print(f"within 2 sd, all together: {within:.1%} of {off.size}")
    parts = np.median([scan.seconds for scan in scans], axis=0)
    print(f"seconds a scan of 36 views (median): features {parts[0]:.1f}, tracks {parts[1]:.1f}, fit {parts[2]:.1f}")
    return 0 if within >= LEAST_WITHIN and not refused else 1


if __name__ == "__main__":
    sys.exit(main())
