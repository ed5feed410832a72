"""Finding, locking and identifying a controller. Numbers in comments are those of the list of hardware behaviour."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import serial

from calibration_free_tests.gantry.simulated_bench import ALL, BOTH, Bench, name_of, settings
from drivers import serial_link
from drivers.grbl import GrblGantry
from drivers.grbl_identify import firmware_of
from drivers.grbl_replies import Message
from drivers.port_lock import lock_port
from drivers.serial_ports import resolve_port
from rig.devices import Motion
from rig.errors import HardwareError
from sim_backends.faults import Fault, FaultKind, Side, WireByte
from sim_backends.grbl_emulator.dialects import FLUIDNC, GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.simulated_port import SimulatedPort
from sim_backends.wired_device import WiredDevice


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_connecting_identifies_the_firmware(dialect: Dialect) -> None:  # 1
    identity = Bench(dialect).gantry.connect()
    assert identity.kind == dialect.name
    assert identity.version in dialect.identity[0]
    assert identity.where == "simulated"


@pytest.mark.parametrize("answer", ["VER:0.9j.20160303:", "VER:2.0 Smoothie:", "OPT:V,15,128"])
def test_an_unknown_firmware_is_refused(answer: str) -> None:  # 1
    assert firmware_of([Message(answer)]) == ("", "")
    other = Dialect("other", GRBL_1_1.banner, (f"[{answer}]",), 79, 15)
    with pytest.raises(HardwareError, match=r"no GRBL 1\.1, grblHAL or FluidNC"):
        Bench(other).gantry.connect()


@pytest.mark.parametrize("dialect", ALL, ids=name_of)
def test_connecting_homes_unlocks_resets_and_moves_nothing(dialect: Dialect) -> None:  # 2
    bench = Bench(dialect)
    before = bench.truth
    bench.gantry.connect()
    bench.clock.sleep_s(5.0)
    assert bench.truth == before
    assert set(bench.lines_written()) == {"$I", "$$"}
    assert not set(bench.bytes_written()) & {0x18, 0x85, ord("!"), ord("~"), *range(0x80, 0x90)}
    assert bench.gantry.status().motion is Motion.ALARM


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_line_that_another_program_left_unfinished_does_not_move(dialect: Dialect) -> None:  # 2
    bench = Bench(dialect)
    bench.terminal.home()
    before = bench.truth
    bench.terminal.type(b"G53G1X-100F1000")
    bench.gantry.connect()
    bench.clock.sleep_s(2.0)
    assert bench.truth == before


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_moving_controller_is_waited_for_and_a_held_one_is_left_alone(dialect: Dialect) -> None:  # 2
    bench = Bench(dialect)
    bench.terminal.home()
    bench.terminal.type("G53G1X-100F3000")
    bench.gantry.connect()
    assert bench.truth[0] == pytest.approx(-100.0)
    bench.gantry.close()
    bench.terminal.type(b"!")
    with pytest.raises(HardwareError, match=r"state Hold.*rig stop"):
        bench.gantry.connect()
    assert bench.gantry.stop().confirmed
    assert bench.gantry.connect().kind == dialect.name


@dataclass
class Adapter:
    device: str
    serial_number: str | None
    vid: int | None = 0x1A86
    pid: int | None = 0x7523


def test_ambiguous_ports_are_an_error(tmp_path: Path) -> None:  # 4
    first, second = tmp_path / "first", tmp_path / "second"
    first.touch()
    second.touch()
    twins = [Adapter(str(first), "0001"), Adapter(str(second), "0001")]
    with pytest.raises(HardwareError, match=r"could be any of .*first, .*second.*by-path"):
        resolve_port("0001", lambda: twins)
    different = [Adapter(str(first), "0001"), Adapter(str(second), "0002")]
    assert resolve_port("0002", lambda: different) == str(second)
    assert resolve_port(str(first), lambda: twins) == str(first)
    with pytest.raises(HardwareError, match="'0003'"):
        resolve_port("0003", lambda: different)
    with pytest.raises(HardwareError, match="no such port"):
        resolve_port(str(tmp_path / "gone"), lambda: different)


def test_identical_adapters_make_their_shared_name_ambiguous(monkeypatch: pytest.MonkeyPatch) -> None:  # 4
    link = "/dev/serial/by-id/usb-1a86_USB_Serial-if00-port0"
    monkeypatch.setattr(os.path, "exists", lambda path: True)
    monkeypatch.setattr(os.path, "realpath", lambda path: "/dev/ttyUSB1" if path == link else path)
    twins = [Adapter("/dev/ttyUSB0", None), Adapter("/dev/ttyUSB1", None)]
    with pytest.raises(HardwareError, match="any of /dev/ttyUSB0, /dev/ttyUSB1"):
        resolve_port(link, lambda: twins)
    assert resolve_port(link, lambda: [Adapter("/dev/ttyUSB0", "A"), Adapter("/dev/ttyUSB1", "B")]) == "/dev/ttyUSB1"
    with pytest.raises(HardwareError, match="any of"):
        resolve_port("/dev/ttyUSB0", lambda: twins)
    assert resolve_port("/dev/ttyUSB0", lambda: twins[:1]) == "/dev/ttyUSB0"


class ServoBus:
    """Answers every byte with the header of a Dynamixel packet, or with nothing."""

    def __init__(self, answer: bytes) -> None:
        self.answer, self.out, self.now_s = answer, list[tuple[float, bytes]](), 0.0
        self.received = bytearray()

    def receive(self, byte: WireByte) -> None:
        self.received.append(byte.value)
        self.out.append((self.now_s, self.answer))

    def advance_to(self, now_s: float) -> None:
        self.now_s = now_s

    def next_event_s(self) -> float | None:
        return None

    def take_output(self) -> list[tuple[float, bytes]]:
        out, self.out = self.out, []
        return out

    def apply_fault(self, fault: Fault) -> None:
        raise AssertionError(fault)


@pytest.mark.parametrize(
    ("answer", "what"),
    [(b"\xff\xff\xfd\x00\x01", "Dynamixel.*swapped"), (b"", "nothing answers.*swapped"), (b"U\x9d", "baud rate")],
)
def test_swapped_ports_are_noticed_before_any_motion(answer: bytes, what: str) -> None:  # 5
    clock, bus = SimulatedClock(), ServoBus(answer)
    device = WiredDevice(bus)
    clock.attach(device)
    gantry = GrblGantry(settings(), clock, open_port=lambda wanted: SimulatedPort(device, clock, timeout=0.02))
    with pytest.raises(HardwareError, match=what):
        gantry.connect()
    assert set(bus.received) == {ord("?")}
    assert clock.now_s() < 6.0


def test_a_second_process_is_refused_with_the_holders_number(tmp_path: Path) -> None:  # 6
    code = (
        "import sys, pathlib; from drivers.port_lock import lock_port; "
        "lock_port('/dev/ttyX', pathlib.Path(sys.argv[1])); print('locked', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "locked\n"
        with pytest.raises(HardwareError, match=rf"/dev/ttyX: in use by process {holder.pid}\."):
            lock_port("/dev/ttyX", tmp_path)
        holder.kill()
    lock_port("/dev/ttyX", tmp_path).release()


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_a_device_s_lock_may_be_taken_by_every_user_in_turn(tmp_path: Path, umask: int) -> None:  # 6
    before = os.umask(umask)
    try:
        lock_port("/dev/ttyX", tmp_path).release()
    finally:
        os.umask(before)
    (file,) = tmp_path.iterdir()
    assert stat.S_IMODE(file.stat().st_mode) == 0o666


def test_a_lock_file_that_is_there_is_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # 6
    lock_port("/dev/ttyX", tmp_path).release()
    opened = os.open

    def protected(path: Path, flags: int, mode: int = 0o777) -> int:
        # As the kernel does in a sticky folder, where the file is another user's.
        if flags & os.O_CREAT:
            raise PermissionError(errno.EACCES, "Permission denied")
        return opened(path, flags, mode)

    monkeypatch.setattr(os, "open", protected)
    lock_port("/dev/ttyX", tmp_path).release()


def test_two_processes_that_lock_a_device_for_the_first_time_use_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # 6
    opened, missed = os.open, []

    def slowly(path: Path, flags: int, mode: int = 0o777) -> int:
        if not missed:
            missed.append(flags)
            lock_port("/dev/ttyX", tmp_path)  # another process is quicker
            raise FileNotFoundError
        return opened(path, flags, mode)

    monkeypatch.setattr(os, "open", slowly)
    with pytest.raises(HardwareError, match="in use by process"):
        lock_port("/dev/ttyX", tmp_path)


def refusing(error: Exception) -> Callable[[serial.Serial], None]:
    def open_it(port: serial.Serial) -> None:
        raise error

    return open_it


@pytest.mark.parametrize(
    ("error", "what"),
    [
        (serial.SerialException(errno.EACCES, "Permission denied"), r"permission denied.*usermod -aG"),
        (serial.SerialException(errno.EBUSY, "busy"), r"in use by another program.*fuser"),
        (OSError(errno.ENXIO, "No such device"), r"cannot be opened.*cable"),
    ],
)
def test_a_port_that_cannot_be_opened_says_what_to_do(
    error: Exception, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # 7
    port = tmp_path / "port"
    port.touch()
    monkeypatch.setattr(serial.Serial, "open", refusing(error))
    monkeypatch.setattr("drivers.port_lock.SHARED", tmp_path)
    for _ in range(2):  # the lock is given back each time
        with pytest.raises(HardwareError, match=what):
            serial_link.open_serial(str(port), 115200)


def test_the_port_is_asked_for_exclusively_and_dtr_is_set_before_it_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # 6
    port = tmp_path / "port"
    port.touch()
    seen: list[tuple[object, object]] = []
    monkeypatch.setattr(serial.Serial, "open", lambda opened: seen.append((opened.exclusive, opened.dtr)))
    monkeypatch.setattr("drivers.port_lock.SHARED", tmp_path)
    serial_link.open_serial(str(port), 115200, dtr=False).close()
    serial_link.open_serial(str(port), 115200, dtr=True).close()
    assert seen == [(True, False), (True, True)]


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
def test_a_garbled_identification_is_no_identification(dialect: Dialect) -> None:  # 1
    bench = Bench(dialect)
    clean = bench.gantry.connect()
    bench.gantry.close()
    for start in range(0, 120, 9):
        fault = Fault(FaultKind.GARBLE, Side.FROM_DEVICE, at_byte=60 + start, count=6, mask=start)
        other = Bench(dialect, [fault])
        try:
            assert other.gantry.connect().kind == clean.kind
        except HardwareError:
            continue


def test_inches_in_reports_are_read_as_what_they_are() -> None:  # 22
    bench = Bench(GRBL_1_1, firmware={**BENCH, 13: 1})
    gantry = bench.homed()
    assert gantry.move_to(-100.0, -50.0, -20.0) == pytest.approx((-100.0, -50.0, -20.0), abs=0.01)
    assert bench.truth == pytest.approx((-100.0, -50.0, -20.0))


def test_fluidnc_is_never_sent_a_byte_that_starts_a_macro() -> None:  # 1
    bench = Bench(FLUIDNC)
    gantry = bench.homed()
    gantry.move_to(-100.0, -50.0, -20.0)
    gantry.jog(5.0, 0.0, 0.0)
    gantry.stop()
    gantry.status()
    assert not set(bench.bytes_written()) & set(range(0x82, 0x90))
    assert bench.monitor.violations == []
