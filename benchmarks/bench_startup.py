"""Prints how long ``rig --help`` takes to answer: the median of several runs, seconds."""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path


def seconds_of(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--limit", type=float, help="fail if the median is above this many seconds")
    options = parser.parse_args()
    command = [str(Path(sys.executable).with_name("rig")), "--help"]
    seconds_of(command)  # the first run compiles
    median = statistics.median(seconds_of(command) for _ in range(options.runs))
    print(f"rig --help: {median:.3f} s (median of {options.runs})")
    if options.limit is not None and median > options.limit:
        print(f"slower than {options.limit} s: something heavy is imported at start", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
