"""Kills a real scan, in a process of its own, at random instants, resumes it, and counts what that cost.

Run as a module: it must fork before any thread is started. Prints one JSON object.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

from calibration_free_tests.scan.sample import FakeRig, digest_at, rng, row, scan_into
from rig.imagegrid import read_grid
from rig.imagegrid.entry import MANIFEST
from rig.scan import Finish


@dataclass
class Tally:
    """What the kills did. ``retaken`` counts pictures by kill: taken before it, and again after it."""

    frames: int
    kills: int = 0
    scans: int = 0
    acknowledged: int = 0
    lost: int = 0
    torn: int = 0
    duplicates: int = 0
    retaken: dict[int, int] = field(default_factory=dict)
    wrong_at_end: int = 0
    frames_stored_at_kill: list[int] = field(default_factory=list)


def child(folder: Path, log: Path, frames: int) -> None:
    """Scan or resume; each picture is written down when it is taken and when it is acknowledged."""
    handle = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def say(*words: object) -> None:
        os.write(handle, (" ".join(map(str, words)) + "\n").encode())

    rig = FakeRig()
    rig.before = lambda what, pose: say("taken", round(pose.x_mm)) if what == "capture" else None
    poses = row(frames)
    scan = scan_into(folder, poses, rig, acknowledged=lambda frame: say("safe", frame.file, frame.sha256))
    os._exit(0 if scan.finish is Finish.DONE else 1)


def run_child(folder: Path, log: Path, frames: int, delay_s: float | None) -> bool:
    """Let a process of its own scan; kill it after the delay. Says whether it came to its end before."""
    pid = os.fork()
    if pid == 0:
        try:
            child(folder, log, frames)
        finally:
            os._exit(2)
    if delay_s is not None:
        time.sleep(delay_s)
        # Nobody else has waited for it, so the number is still this process's.
        os.kill(pid, signal.SIGKILL)
    status = os.waitpid(pid, 0)[1]
    if not os.WIFSIGNALED(status) and os.WEXITSTATUS(status) != 0:
        raise RuntimeError(f"the scan in {folder} failed")
    return not os.WIFSIGNALED(status)


def events(log: Path) -> list[list[str]]:
    return [line.split() for line in log.read_text().splitlines()] if log.exists() else []


def judge(folder: Path, sessions: list[Path], tally: Tally) -> None:
    """Compare the folder, as the kill left it, with what had been acknowledged; with our own eyes, not the reader's."""
    manifest = folder / MANIFEST
    raw = manifest.read_bytes() if manifest.exists() else b""
    lines = [json.loads(line) for line in raw[: raw.rfind(b"\n") + 1].splitlines()]
    listed = Counter((line["file"], line["sha256"]) for line in lines)
    safe = {(words[1], words[2]) for log in sessions for words in events(log) if words[0] == "safe"}
    tally.lost += sum(listed[entry] == 0 for entry in safe)
    tally.torn += sum(
        hashlib.sha256((folder / file).read_bytes()).hexdigest() != sha256 for file, sha256 in listed | Counter(safe)
    )
    tally.duplicates += sum(count - 1 for count in Counter(line["file"] for line in lines).values())
    tally.duplicates += len(lines) - len({line["x_mm"] for line in lines})
    tally.frames_stored_at_kill.append(len(lines))


def judge_end(folder: Path, sessions: list[Path], tally: Tally) -> None:
    """After the last resume: every pose once, with its own picture; and what each kill cost."""
    grid = read_grid(folder)
    expected = {pose: digest_at(pose) for pose in row(tally.frames)}
    found = {frame.pose: frame.sha256 for frame in grid.frames}
    tally.wrong_at_end += len(grid.frames) - len(found) + sum(found.get(p) != d for p, d in expected.items())
    taken = [[words[1] for words in events(log) if words[0] == "taken"] for log in sessions]
    for number, now in enumerate(taken[:-1]):
        later = {x for session in taken[number + 1 :] for x in session}
        again = sum(x in later for x in now)
        tally.retaken[again] = tally.retaken.get(again, 0) + 1
    tally.acknowledged += sum(words[0] == "safe" for log in sessions for words in events(log))


def kill_scans(work: Path, frames: int, kills: int, seed: int, kills_per_scan: float) -> Tally:
    """Scan after scan, each killed again and again until it comes to its end, until there have been enough kills."""
    begun = time.monotonic()
    run_child(work / "whole", work / "whole.log", frames, None)
    whole_s = time.monotonic() - begun
    tally, random = Tally(frames), rng(seed)
    while tally.kills < kills:
        folder, sessions = work / f"scan{tally.scans}", []
        done = False
        while not done:
            log = work / f"scan{tally.scans}-{len(sessions)}.log"
            sessions.append(log)
            delay = random.uniform(0.0, 2.0 * whole_s / kills_per_scan) if tally.kills < kills else None
            done = run_child(folder, log, frames, delay)
            if not done:
                tally.kills += 1
                judge(folder, sessions, tally)
        judge_end(folder, sessions, tally)
        tally.scans += 1
        shutil.rmtree(folder)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--kills-per-scan", type=float, default=15.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tally = kill_scans(options.work, options.frames, options.kills, options.seed, options.kills_per_scan)
    print(json.dumps(asdict(tally)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
