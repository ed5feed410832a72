"""The driver through real pyserial on a pseudo-terminal, on real time; short, since these tests do wait."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from calibration_free_tests.gantry.simulated_bench import ALL, name_of, settings
from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblSettings
from rig.errors import HardwareError
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.pty_server import PtyServer
from sim_backends.wired_device import WiredDevice

QUICK = {**BENCH, 20: 0, 21: 0, 22: 0}


class RealClock:
    """Monotonic time of the computer."""

    def now_s(self) -> float:
        return time.monotonic()

    def sleep_s(self, seconds: float) -> None:
        time.sleep(seconds)


@pytest.fixture
def server() -> Iterator[PtyServer]:
    with PtyServer(WiredDevice(GrblMachine(GRBL_1_1, settings=QUICK))) as running:
        yield running


def bench_of(server: PtyServer) -> GrblSettings:
    return settings(port=server.path, homing="none")


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_the_driver_identifies_and_moves_a_controller_on_a_real_terminal(dialect: Dialect) -> None:
    with PtyServer(WiredDevice(GrblMachine(dialect, settings=QUICK))) as server:
        gantry = GrblGantry(bench_of(server), RealClock())
        assert gantry.connect().kind == dialect.name
        place = (-3.0, -2.0, -1.0)
        assert gantry.move_to(*place) == pytest.approx(place)
        assert gantry.stop().confirmed
        gantry.close()
        gantry.close()


def test_a_second_process_is_refused_on_a_real_terminal(server: PtyServer) -> None:  # 6
    gantry = GrblGantry(bench_of(server), RealClock())
    code = (
        "import sys; from drivers.serial_link import open_serial\n"
        "port = open_serial(sys.argv[1], 115200); print('open', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, server.path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "open\n"
        with pytest.raises(HardwareError, match=f"in use by process {holder.pid}"):
            gantry.connect()
        holder.kill()
    assert gantry.connect().kind == "GRBL"
    gantry.close()


def test_a_pulled_plug_is_noticed_on_a_real_terminal(server: PtyServer) -> None:  # 20
    gantry = GrblGantry(bench_of(server), RealClock())
    gantry.connect()
    server.unplug()
    began_s = time.monotonic()
    with pytest.raises(HardwareError, match="connection is lost"):
        gantry.status()
    assert time.monotonic() - began_s < 1.0
    with pytest.raises(HardwareError, match="dead"):
        gantry.status()
    assert gantry.stop().sent_at_s is None
    gantry.close()
