"""Two processes of one user meet, whatever their environment and whichever name their bench files have for the port."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import pytest

from calibration_free_tests.guard.real_time import grbl_settings
from calibration_free_tests.guard.sample import bench
from calibration_free_tests.guard.wired import config
from drivers.grbl import GrblGantry
from drivers.serial_ports import resolve_port
from drivers.stopping_all import in_threads
from rig.bench import BenchConfig, Device
from rig.bench.port_place import place_of
from rig.clock import SystemClock
from rig.errors import InputError
from rig.runtime import Attendance, BenchHeldError, runtime_folder, stop_held

ROOT = Path(__file__).parents[2]


# The folder.


def folder_of_a_process(environment: dict[str, str], home: Path) -> str:
    """Where a process with nothing else in its environment meets others; ``home`` stands for the folder /tmp."""
    code = (
        "import sys\nfrom pathlib import Path\nimport rig.runtime.folder as folder\n"
        "folder.SHARED = Path(sys.argv[1])\nprint(folder.runtime_folder())"
    )
    command = [sys.executable, "-c", code, str(home)]
    answer = subprocess.run(
        command, env={"PYTHONPATH": str(ROOT), **environment}, capture_output=True, text=True, timeout=30.0
    )
    assert answer.returncode == 0, answer.stderr
    return answer.stdout.strip()


def test_processes_of_one_user_meet_whatever_their_environment(tmp_path: Path) -> None:
    session, temporary = tmp_path / "session", tmp_path / "temporary"
    for folder in (session, temporary):
        folder.mkdir(mode=0o700)
    of_cron = folder_of_a_process({}, tmp_path)
    assert of_cron == str(tmp_path / f"rig-{os.getuid()}")
    of_a_login = folder_of_a_process(
        {"XDG_RUNTIME_DIR": str(session), "TMPDIR": str(temporary), "HOME": str(session), "USER": "x"}, tmp_path
    )
    assert of_a_login == of_cron


def test_who_asks_for_a_folder_of_his_own_meets_nobody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "apart"))
    assert runtime_folder() == tmp_path / "apart"
    assert runtime_folder().stat().st_mode & 0o777 == 0o700
    monkeypatch.setenv("RIG_RUNTIME_DIR", "apart")
    with pytest.raises(InputError, match="RIG_RUNTIME_DIR to a full path"):
        runtime_folder()


@pytest.mark.parametrize("spoiled", ["others may write", "a file", "a link", "no such place"])
@pytest.mark.parametrize("apart", [True, False], ids=["a folder of its own", "the shared place"])
def test_a_runtime_folder_that_is_not_private_is_refused(
    spoiled: str, apart: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "missing" if spoiled == "no such place" else tmp_path
    folder = place / f"rig-{os.getuid()}"
    if apart:
        monkeypatch.setenv("RIG_RUNTIME_DIR", str(folder))
    else:
        monkeypatch.delenv("RIG_RUNTIME_DIR", raising=False)
        monkeypatch.setattr("rig.runtime.folder.SHARED", place)
    if spoiled == "a file":
        folder.touch()
    elif spoiled == "others may write":
        assert runtime_folder() == folder
        folder.chmod(0o777)
    elif spoiled == "a link":
        (tmp_path / "mine").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match=r"[sS]et RIG_RUNTIME_DIR"):
        runtime_folder()


# The names of a port.


@dataclass
class Serial:
    """A computer's /dev with one adapter, and bench files that name its port in one way or the other."""

    folder: Path

    def __post_init__(self) -> None:
        for name in ("by-id", "by-path"):
            (self.folder / name).mkdir()
        self.plug("ttyUSB0")

    def plug(self, device: str) -> None:
        """Plug the adapter into its place; it gets this number."""
        self.unplug()
        (self.folder / device).touch()
        for name in ("by-path/pci-0:1-port0", "by-path/pci-0-v2:1-port0", "by-id/usb-1a86"):
            (self.folder / name).symlink_to(self.folder / device)

    def unplug(self) -> None:
        for path in self.folder.rglob("*"):
            if path.is_symlink() or path.is_file():
                path.unlink()

    def bench(self, port: str) -> BenchConfig:
        settings = grbl_settings(port if port == "A5069RR4" else str(self.folder / port))
        return replace(
            config(), name=f"{port}.yaml", devices={"gantry": Device("gantry", "grbl", GrblGantry, settings)}
        )

    def attendance(self, port: str, runtime: Path) -> Attendance:
        bench = self.bench(port)
        return Attendance(runtime, bench.key, bench.name, also=bench.other_keys)


@dataclass
class Adapter:
    """As pyserial lists it."""

    device: str
    serial_number: str | None = "A5069RR4"
    vid: int | None = 1
    pid: int | None = 1


NAMES = ("by-path/pci-0:1-port0", "by-path/pci-0-v2:1-port0", "by-id/usb-1a86", "ttyUSB0", "A5069RR4")


@pytest.fixture
def serial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Serial:
    (tmp_path / "dev").mkdir()
    monkeypatch.setattr("rig.bench.port_place.BY_PATH", tmp_path / "dev" / "by-path")
    monkeypatch.setattr(
        "rig.bench.port_place.resolve_port",
        lambda name: resolve_port(name, lambda: [Adapter(str(tmp_path / "dev" / "ttyUSB0"))]),
    )
    return Serial(tmp_path / "dev")


@pytest.fixture
def runtime(tmp_path: Path) -> Path:
    folder = tmp_path / "runtime"
    folder.mkdir(mode=0o700)
    return folder


@pytest.mark.parametrize(("ours", "theirs"), list(permutations(NAMES, 2)))
def test_a_stop_reaches_the_bench_whichever_name_its_port_has_been_given(
    ours: str, theirs: str, serial: Serial, runtime: Path
) -> None:
    holder, asker = serial.attendance(ours, runtime), serial.attendance(theirs, runtime)
    made = bench(latch=holder.latch, company=(holder.listen,), clock=SystemClock(), stops=in_threads)
    with made.guard:
        with pytest.raises(BenchHeldError, match=f"process {os.getpid()} "), asker.listen(made.guard):
            pass
        assert (asker.ask("stop", by="a person") or {})["confirmed"]
        assert asker.latch.note().startswith("a person")
        assert [report["confirmed"] for report in stop_held(runtime, "all")] == [True]
    assert asker.ask("status") is None
    assert not list(runtime.glob("*.sock"))
    asker.latch.clear()
    assert (holder.latch.note(), asker.latch.note()) == ("", "")
    assert [path.name for path in runtime.iterdir()] == ["all.stopped-at"]


def test_a_stop_is_found_while_the_adapter_is_unplugged_and_after_it_has_got_another_number(
    serial: Serial, runtime: Path
) -> None:
    serial.attendance("by-id/usb-1a86", runtime).latch.set("a person")
    serial.unplug()
    assert serial.attendance("by-id/usb-1a86", runtime).latch.note()
    serial.plug("ttyUSB1")
    for name in ("by-id/usb-1a86", "by-path/pci-0:1-port0", "ttyUSB1"):
        assert serial.attendance(name, runtime).latch.note()


def test_a_holder_whose_adapter_was_unplugged_is_still_found(serial: Serial, runtime: Path) -> None:
    holder = serial.attendance("by-id/usb-1a86", runtime)
    with holder.listen(bench(clock=SystemClock()).guard):
        serial.unplug()
        assert serial.attendance("by-id/usb-1a86", runtime).ask("status")


def test_a_killed_holder_with_two_names_leaves_nothing_in_the_way(serial: Serial, runtime: Path) -> None:
    holder = serial.attendance("by-id/usb-1a86", runtime)
    code = (
        "import sys, os\nfrom pathlib import Path\nfrom rig.runtime import Attendance\n"
        "with Attendance(Path(sys.argv[1]), sys.argv[2], 'x', also=sys.argv[3:]).listen(None):\n    os._exit(9)"
    )
    bench_config = serial.bench("by-id/usb-1a86")
    command = [sys.executable, "-c", code, str(runtime), bench_config.key, *bench_config.other_keys]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    assert subprocess.run(command, check=False, env=environment, timeout=30.0).returncode == 9
    assert len(list(runtime.glob("*.sock"))) == 2
    assert stop_held(runtime, "all") == []
    with serial.attendance("ttyUSB0", runtime).listen(bench(clock=SystemClock()).guard):
        assert holder.ask("status")


def test_a_pseudo_terminal_is_no_place_for_its_number_is_soon_given_to_another() -> None:
    ours, theirs = pty.openpty()
    with os.fdopen(ours), os.fdopen(theirs) as terminal:
        assert place_of(os.ttyname(terminal.fileno())) is None


def test_an_empty_latch_of_a_full_disk_is_released_too(serial: Serial, runtime: Path) -> None:
    attendance = serial.attendance("ttyUSB0", runtime)
    attendance.latch.set("a person")
    for path in runtime.iterdir():
        path.write_text("")
    assert attendance.latch.note() == "by somebody"
    attendance.latch.clear()
    assert attendance.latch.note() == ""


def test_benches_on_different_ports_do_not_meet(serial: Serial, runtime: Path) -> None:
    (serial.folder / "ttyUSB7").touch()
    serial.attendance("ttyUSB7", runtime).latch.set("a person")
    assert serial.attendance("ttyUSB0", runtime).latch.note() == ""
