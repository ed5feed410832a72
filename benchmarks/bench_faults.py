"""Prints what random serial faults do to scans on a whole emulated bench: gantry, servos and camera, simulated time.

Run from the repository: ``python -m benchmarks.bench_faults`` (10,000 faults for each of 5 seeds: an hour or so).
A fault may end a scan; it is then gone on with as a person would. Every picture carries a frame counter, by which the
emulator tells where the axes truly were while it was exposed. Exit code 1 if a stored pose was off by more than 0.05 mm
or 0.1 degrees, or if anything moved that must not (unhomed, in alarm, out of limits) by the emulators' own judgement.
A scan or command that did not end within its bound ends the program with an error.
"""

from __future__ import annotations

import argparse
import sys
import time

from calibration_free_tests.emulation.faulty_scans import COMMAND_S, SCAN_S, Person

MOST_MM, MOST_DEG = 0.05, 0.1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--faults", type=int, default=10_000, help="on the serial lines, for each seed")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--every-s", type=float, default=3.0, help="simulated seconds between faults, on average")
    options = parser.parse_args()
    print(
        "seed  faults  hours simulated  pictures  scans (ended early)  worst mm  worst deg  worst zoom  forbidden  "
        f"longest scan s (bound {SCAN_S:g})  longest command s (bound {COMMAND_S:g})  took s"
    )
    bad = 0
    for seed in range(100, 100 + options.seeds):
        began = time.perf_counter()
        tally = Person(seed, faults=options.faults, every_s=options.every_s).work()
        print(
            f"{seed:4d} {tally.faults:7d} {tally.seconds / 3600.0:16.2f} {tally.frames:9d} "
            f"{tally.scans:7d} {f'({tally.ended_early})':>13s} {tally.worst_mm:9.4f} {tally.worst_deg:10.4f} "
            f"{tally.worst_zoom:11.4f} {len(tally.forbidden):10d} {tally.longest_scan_s:20.1f} "
            f"{tally.longest_command_s:20.1f} {time.perf_counter() - began:20.0f}",
            flush=True,
        )
        for line in tally.forbidden[:10]:
            print(f"      {line}")
        bad += bool(tally.forbidden) or tally.worst_mm > MOST_MM or tally.worst_deg > MOST_DEG
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
