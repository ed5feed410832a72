"""A serial port as the drivers use it: opened alone and locked, read by lines, and with one error for all its failures.

pyserial raises `SerialException`, a bare `OSError`, or `termios.error`, depending on the call that meets a port that is
gone; all become `LinkLostError`. Time comes from the clock that is passed in.
"""

from __future__ import annotations

import errno
import grp
import os
import termios
from typing import Protocol

import serial

from drivers.port_lock import PortLock, lock_port
from drivers.serial_ports import resolve_port
from rig.devices import Clock
from rig.errors import HardwareError

PORT_ERRORS = (OSError, serial.SerialException, termios.error)
READ_SLICE_S = 0.02
_WRITE_S = 0.5
_LONGEST_LINE = 4096


class LinkLostError(HardwareError):
    """The port is gone: unplugged, or its device was switched off."""


class SerialPort(Protocol):
    """The part of pyserial's interface that drivers use."""

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        ...

    def read(self, size: int = 1, /) -> bytes:
        """Read, waiting until so many bytes have come or the port's time-out."""
        ...

    def write(self, data: bytes, /) -> int | None:
        """Write."""
        ...

    def close(self) -> None:
        """Close."""
        ...


class LockedPort:
    """A real port with its lock; closing gives back both."""

    def __init__(self, port: serial.Serial, lock: PortLock) -> None:
        self._port, self._lock = port, lock

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        return int(self._port.in_waiting)

    def read(self, size: int = 1) -> bytes:
        """Read, waiting until so many bytes have come or the port's time-out."""
        return bytes(self._port.read(size))

    def write(self, data: bytes) -> int | None:
        """Write."""
        return int(self._port.write(data) or 0)

    def close(self) -> None:
        """Close the port and give back its lock. Safe to call twice."""
        try:
            self._port.close()
        finally:
            self._lock.release()


def open_serial(name: str, baud: int, *, dtr: bool = False) -> LockedPort:
    """Find, lock and open a port for this process alone; DTR is set before opening, so that it resets few boards.

    Raises:
        HardwareError: no such port, several that could be meant, permission denied, or in use (names the process).
    """
    device = resolve_port(name)
    lock = lock_port(device)
    try:
        port = serial.Serial(timeout=READ_SLICE_S, write_timeout=_WRITE_S, exclusive=True, baudrate=baud)
        port.dtr = dtr
        port.port = device
        port.open()
    except PORT_ERRORS as error:
        lock.release()
        raise not_opened(device, error) from error
    return LockedPort(port, lock)


def not_opened(device: str, error: BaseException) -> HardwareError:
    """What to tell of a port that pyserial could not open."""
    number = getattr(error, "errno", None)
    if number == errno.EACCES:
        return HardwareError(
            f"{device}: permission denied. Add yourself to the group {_group_of(device)} "
            f"(sudo usermod -aG {_group_of(device)} $USER) and log in again"
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return HardwareError(f"{device}: in use by another program. `fuser -v {device}` names it; stop it")
    return HardwareError(f"{device}: cannot be opened ({error}). Check cable and power")


def _group_of(device: str) -> str:
    try:
        return grp.getgrgid(os.stat(device).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"


class SerialLink:
    """Lines over a port."""

    def __init__(self, port: SerialPort, clock: Clock, where: str) -> None:
        self._port, self._clock, self.where = port, clock, where
        self._buffer = bytearray()
        self.last_bytes = b""

    def write(self, data: bytes) -> None:
        """Write at once; takes no lock and may be called from any thread.

        Raises:
            LinkLostError: the port is gone, or takes nothing any more.
        """
        try:
            self._port.write(data)
        except PORT_ERRORS as error:
            raise self._lost(error) from error

    def read_line(self, deadline_s: float) -> str | None:
        """The next line without its end, or ``None`` if none was complete by the deadline.

        Raises:
            LinkLostError: the port is gone.
        """
        while True:
            end = self._buffer.find(b"\n")
            if end >= 0:
                line = bytes(self._buffer[:end])
                del self._buffer[: end + 1]
                return line.rstrip(b"\r").decode("latin-1")
            if self._clock.now_s() >= deadline_s and not self._waiting():
                return None
            self._fill()

    def _waiting(self) -> int:
        try:
            return self._port.in_waiting
        except PORT_ERRORS as error:
            raise self._lost(error) from error

    def _fill(self) -> None:
        try:
            data = self._port.read(max(1, self._port.in_waiting))
        except PORT_ERRORS as error:
            raise self._lost(error) from error
        self._buffer += data
        self.last_bytes = (self.last_bytes + data)[-64:]
        del self._buffer[:-_LONGEST_LINE]  # noise without line ends must not grow for ever

    def close(self) -> None:
        """Close the port; one that is gone is closed too."""
        try:
            self._port.close()
        except PORT_ERRORS:
            return  # nothing is left to close

    def _lost(self, error: BaseException) -> LinkLostError:
        return LinkLostError(f"{self.where}: the connection is lost ({error}). Check cable and power, then connect")
