"""Prints what SIGKILL at random instants does to a scan: pictures lost, torn, doubled, and taken again.

Run from the repository: ``python -m benchmarks.bench_crash``. Exit code 1 if anything but retakes was found, or more
than one retake a kill.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rig-crash-", dir=".") as work:
        command = [sys.executable, "-m", "calibration_free_tests.scan.crash", work]
        command += [f"--{name}={value}" for name, value in vars(options).items()]
        tally = json.loads(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout)
    retaken = {int(pictures): kills for pictures, kills in tally["retaken"].items()}
    stored = tally["frames_stored_at_kill"]
    print(f"{tally['kills']} kills in {tally['scans']} scans of {tally['frames']} pictures")
    print(f"pictures stored when killed    {min(stored)} .. {max(stored)}")
    print(f"pictures acknowledged          {tally['acknowledged']}")
    print(f"acknowledged, then lost        {tally['lost']}")
    print(f"listed, but torn               {tally['torn']}")
    print(f"listed twice                   {tally['duplicates']}")
    print(f"wrong or missing in the end    {tally['wrong_at_end']}")
    again = sum(pictures * kills for pictures, kills in retaken.items())
    print(f"taken again after a kill       {again}, at most {max(retaken)} each time")
    faults = tally["lost"] + tally["torn"] + tally["duplicates"] + tally["wrong_at_end"]
    return 1 if faults or max(retaken) > 1 else 0


if __name__ == "__main__":
    sys.exit(main())
