"""Scans: a plan of poses, and the image grid that is made by going through it.

A scan's folder *is* an image grid, with ``scan.yaml`` beside it (docs/formats.md): it can be put into a mock bench.
"""

from rig.scan.order import OneSided, all_legs, serpentine
from rig.scan.plan import ScanPlan, load_plan
from rig.scan.preflight import Estimate, estimate, preflight, refuse_small_disk
from rig.scan.record import ScanRecord, bench_digest, open_scan_folder, refuse_other_scan
from rig.scan.runner import Finish, Scan, Target, numbered
from rig.scan.store import BackgroundStore, FrameStore

__all__ = [
    "BackgroundStore",
    "Estimate",
    "Finish",
    "FrameStore",
    "OneSided",
    "Scan",
    "ScanPlan",
    "ScanRecord",
    "Target",
    "all_legs",
    "bench_digest",
    "estimate",
    "load_plan",
    "numbered",
    "open_scan_folder",
    "preflight",
    "refuse_other_scan",
    "refuse_small_disk",
    "serpentine",
]
