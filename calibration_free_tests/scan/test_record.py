"""By what a scan's folder knows the bench that it was begun with."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.bench import load_bench
from rig.scan import bench_digest

EXAMPLE = (Path(__file__).parents[2] / "examples" / "bench_emulated.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "another"),
    [
        ("/dev/serial/by-id/emulated-gantry", "/dev/pts/7", False),
        ("/dev/serial/by-id/emulated-servos", "/dev/pts/8", False),
        ("http://127.0.0.1:1/", "http://127.0.0.1:41301/", False),
        ("http://127.0.0.1:1/", "http://camera.local:1/", True),
        ("gear_ratio: 3", "gear_ratio: 2", True),
    ],
)
def test_a_bench_is_the_same_by_whatever_ports_it_is_reached(tmp_path: Path, old: str, new: str, another: bool) -> None:
    if old not in EXAMPLE:
        pytest.fail(f"the example no longer says {old}")
    for name, text in (("one", EXAMPLE), ("other", EXAMPLE.replace(old, new))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "bench.yaml").write_text(text)
    one, other = (bench_digest(load_bench(tmp_path / name / "bench.yaml")) for name in ("one", "other"))
    assert (one != other) is another
