"""Reads bench files (``bench.yaml``) and makes rigs of them: mock rigs on image grids, and guarded live rigs."""

from rig.bench.config import BenchConfig, bench_file, default_bench_for_grid, load_bench
from rig.bench.drivers import Device, Maker, installed, make_devices
from rig.bench.live import LiveBenchFile
from rig.bench.mock import BenchFile
from rig.bench.opening import attendance_of, open_live, open_rig, stop_directly

__all__ = [
    "BenchConfig",
    "BenchFile",
    "Device",
    "LiveBenchFile",
    "Maker",
    "attendance_of",
    "bench_file",
    "default_bench_for_grid",
    "installed",
    "load_bench",
    "make_devices",
    "open_live",
    "open_rig",
    "stop_directly",
]
