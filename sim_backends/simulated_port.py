"""A serial port with pyserial's interface whose other end is an emulated device on simulated time.

Reading with a time-out lets simulated time pass and returns at once in real time. A pulled plug shows as it does on
Linux: `in_waiting` raises a bare `OSError`, reading and writing `SerialException`, or all what a test asks for.
"""

from __future__ import annotations

import serial

from sim_backends.simulated_clock import SimulatedClock
from sim_backends.wired_device import WiredDevice


class SimulatedPort:
    """An open port. Attributes and methods as `serial.Serial` has them, as far as drivers use them."""

    def __init__(
        self,
        device: WiredDevice,
        clock: SimulatedClock,
        *,
        port: str = "simulated",
        baudrate: int = 115200,
        timeout: float | None = None,
        unplugged: Exception | None = None,
    ) -> None:
        """Open it; the device must be attached to the clock.

        Raises:
            serial.SerialException: the device is not plugged in.

        Args:
            device: what is at the other end.
            clock: passes the time while a read waits.
            port, baudrate, timeout: as in pyserial.
            unplugged: raised by every call once the plug is out; ``None``: what pyserial raises.
        """
        if not device.plugged:
            raise serial.SerialException(2, f"could not open port {port}: No such file or directory")
        self._device, self._clock, self._unplugged = device, clock, unplugged
        self._pulls = device.pull_count
        self.port = self.name = port
        self.baudrate, self.timeout, self.write_timeout = baudrate, timeout, 1.0
        self.dtr = self.rts = False
        self.is_open = True
        self.reset_input_buffer()  # the kernel keeps nothing of what comes to a closed port

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        self._check(OSError(5, "Input/output error"))
        return self._device.host_waiting()

    @property
    def out_waiting(self) -> int:
        """Bytes not yet sent: the simulated wire takes them all."""
        return 0

    def read(self, size: int = 1) -> bytes:
        """Read, waiting until so many bytes have come or the time-out."""
        self._check(serial.SerialException("device reports readiness to read but returned no data"))
        device = self._device
        deadline_s = self._clock.now_s() + (1e9 if self.timeout is None else self.timeout)
        self._clock.wait_until(lambda: self._dead or device.host_waiting() >= size, deadline_s)
        self._check(serial.SerialException("device reports readiness to read but returned no data"))
        return device.host_takes(size)

    def write(self, data: bytes) -> int:
        """Write; returns how many bytes were taken."""
        self._check(serial.SerialException("write failed: [Errno 5] Input/output error"))
        self._device.host_writes(bytes(data), self._clock.now_s())
        return len(data)

    def flush(self) -> None:
        """Wait until all is sent: it is."""
        self._check(serial.SerialException("Input/output error"))

    def reset_input_buffer(self) -> None:
        """Forget what has come."""
        self._device.host_takes(self._device.host_waiting())

    def reset_output_buffer(self) -> None:
        """Forget what was not sent: nothing."""

    def close(self) -> None:
        """Close it. Safe to call twice."""
        self.is_open = False

    @property
    def _dead(self) -> bool:
        return not self._device.plugged or self._device.pull_count != self._pulls

    def _check(self, error: Exception) -> None:
        if not self.is_open:
            raise serial.PortNotOpenError
        if self._dead:
            raise self._unplugged or error
