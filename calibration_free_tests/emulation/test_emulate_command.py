"""``rig emulate`` as a person meets it: real ports, the other commands on them, Ctrl-C; short, since this does wait."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.emulation.sample import EMULATED
from rig.bench import load_bench
from rig.emulation.files import bench_text, refuse_overwriting
from rig.errors import InputError
from rig.imagegrid import read_grid

ROOT = Path(__file__).resolve().parents[2]
PLAN = "schema: 1\nlattice: {x_mm: 360, y_mm: 60, z_mm: 180, theta_deg: [0, 5], zoom: 0}\n"
START_S, END_S = 60.0, 20.0


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """An environment with a runtime folder of its own."""
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    return {**os.environ, "RIG_RUNTIME_DIR": str(runtime)}


@pytest.fixture
def bench(tmp_path: Path, home: dict[str, str]) -> Iterator[Path]:
    """The bench file of an emulated bench that runs in another process."""
    path = tmp_path / "bench.yaml"
    command = [sys.executable, "-m", "rig.cli.app", "emulate", str(EMULATED), "--bench-out", str(path)]
    with subprocess.Popen(command, env=home, cwd=ROOT, stderr=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stderr is not None
            assert "Ctrl-C ends it" in emulator.stderr.readline()
            yield path
        finally:
            emulator.send_signal(signal.SIGINT)
            assert emulator.wait(END_S) == 0
            assert emulator.stderr.read() == ""


def rig(home: dict[str, str], *arguments: str | Path) -> dict[str, Any]:
    """What a command prints as JSON."""
    command = [sys.executable, "-m", "rig.cli.app", *map(str, arguments), "--json"]
    done = subprocess.run(command, env=home, cwd=ROOT, capture_output=True, text=True, timeout=START_S)
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_an_emulated_bench_is_homed_jogged_and_scanned_with_by_the_commands(
    bench: Path, home: dict[str, str], tmp_path: Path
) -> None:
    homed = rig(home, "home", bench, "--theta-deg", "0")
    assert (homed["state"], homed["pose"]["x_mm"]) == ("idle", 399.0)
    jogged = rig(home, "move", bench, "--by", "--x-mm", "-20", "--theta-deg", "-5")
    assert jogged["pose"]["x_mm"] == pytest.approx(379.0, abs=0.002)
    assert jogged["pose"]["theta_deg"] == pytest.approx(-5.0, abs=0.05)
    plan = tmp_path / "plan.yaml"
    plan.write_text(PLAN)
    scanned = rig(home, "scan", plan, "--bench", bench, "--out", tmp_path / "grid")
    assert (scanned["outcome"], scanned["taken"]) == ("done", 2)
    grid = read_grid(tmp_path / "grid")
    pictures = [grid.load(frame) for frame in grid.frames]
    assert all(image.shape == (480, 640, 3) for image in pictures)
    # A turn by 5 degrees shows another part of the building.
    assert abs(pictures[0].astype(int) - pictures[1]).mean() > 5.0


def test_the_written_bench_file_is_the_one_that_was_read_but_for_its_ports(bench: Path) -> None:
    told, emulated = load_bench(EMULATED), load_bench(bench)
    assert emulated.bounds() == told.bounds()
    assert emulated.file.model_dump(exclude={"devices"}) == told.file.model_dump(exclude={"devices"})
    changed = {"port", "source", "latency_s"}
    for role, device in told.devices.items():
        there = emulated.devices[role]
        assert there.settings.model_dump(exclude=changed) == device.settings.model_dump(exclude=changed)
        port = getattr(there.settings, "port", None)
        assert port is None or Path(port).exists()


def test_what_cannot_be_emulated_is_told_at_once(home: dict[str, str]) -> None:
    for arguments, told in (
        (["examples/mock.yaml"], "mock bench"),
        (["examples/bench_emulated.yaml", "--object", "shed"], "no object 'shed'"),
        (["examples/bench_emulated.yaml", "--object", "LH", "--grid", "nowhere"], "either an object or a grid"),
        (["examples/bench_emulated.yaml", "--grid", "examples/mock.yaml"], "this is a file, and an image grid is a f"),
        (["examples/bench_emulated.yaml", "--bench-out", "examples/bench_emulated.yaml"], "overwrite it with --force"),
        (["examples/bench_emulated.yaml", "--bench-out", "examples"], "cannot be written (Is a directory)"),
    ):
        command = [sys.executable, "-m", "rig.cli.app", "emulate", *arguments]
        done = subprocess.run(command, env=home, cwd=ROOT, capture_output=True, text=True, timeout=START_S)
        assert done.returncode == 2
        assert told in done.stderr


def test_a_bench_file_that_somebody_wrote_is_not_overwritten_and_one_of_an_earlier_emulation_is(tmp_path: Path) -> None:
    config, path = load_bench(EMULATED), tmp_path / "bench.yaml"
    refuse_overwriting(path)
    port = config.devices["gantry"].settings.model_dump()["port"]
    servos = config.devices["pan"].settings.model_dump()["port"]
    path.write_text(bench_text(config, {port: "/dev/pts/8", servos: "/dev/pts/9"}, "http://127.0.0.1:2/"))
    refuse_overwriting(path)
    path.write_text("# My bench.\n" + path.read_text())
    with pytest.raises(InputError, match=r"bench.yaml: there is a file .*Name another with --bench-out, or .*--force"):
        refuse_overwriting(path)
    assert path.read_text().startswith("# My bench.\n")


def test_with_force_a_bench_file_is_overwritten(home: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text("# My bench.\n")
    command = [sys.executable, "-m", "rig.cli.app", "emulate", str(EMULATED), "--bench-out", str(path), "--force"]
    with subprocess.Popen(command, env=home, cwd=ROOT, stderr=subprocess.PIPE, text=True) as emulator:
        assert emulator.stderr is not None
        assert "Ctrl-C ends it" in emulator.stderr.readline()
        emulator.send_signal(signal.SIGTERM)
        assert emulator.wait(END_S) == 0
    assert load_bench(path).is_live
