"""Puts an emulated serial device on a pseudo-terminal, in a thread, on real time: real programs open it as a port."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import time
import tty
from types import TracebackType

from sim_backends.wired_device import WiredDevice

_NAP_S = 0.02


class PtyServer:
    """A context manager; inside it, `path` can be opened with pyserial.

    Attributes:
        path: of the pseudo-terminal, ``/dev/pts/N``.
        lock: hold it to look at the device or to change it from another thread.
    """

    def __init__(self, device: WiredDevice) -> None:
        self._device = device
        self._began_s = time.monotonic()
        self.lock = threading.Lock()
        self._master, self._slave = pty.openpty()
        # The server keeps the far end open too: without any opener, reading the near end would fail at once.
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name=f"emulator on {self.path}", daemon=True)

    def now_s(self) -> float:
        """The device's time: seconds since the server was made."""
        return time.monotonic() - self._began_s

    def __enter__(self) -> PtyServer:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.write(self._wake_write, b"x")
        self._thread.join()
        self.unplug()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def unplug(self) -> None:
        """Pull the plug for good: the pseudo-terminal disappears. Safe to call twice."""
        with self.lock:
            if self._master >= 0:
                self._device.unplug()
                self._hang_up()

    def _hang_up(self) -> None:
        for end in (self._master, self._slave):
            with contextlib.suppress(OSError):  # the kernel may have closed it in all but name
                os.close(end)
        self._master = self._slave = -1

    def _serve(self) -> None:
        while True:
            with self.lock:
                now_s = self.now_s()
                self._device.advance_to(now_s)
                if self._master >= 0 and not self._device.plugged:
                    self._hang_up()
                self._send()
                event_s = self._device.next_event_s()
                master = self._master
            pause_s = _NAP_S if event_s is None else min(_NAP_S, max(0.0, event_s - self.now_s()))
            watched = [self._wake_read] if master < 0 else [self._wake_read, master]
            try:
                ready, _, _ = select.select(watched, [], [], pause_s)
            except (OSError, ValueError):
                continue  # unplugged in between
            if self._wake_read in ready:
                return
            if ready:
                self._take()

    def _take(self) -> None:
        with self.lock:
            if self._master < 0:
                return
            try:
                data = os.read(self._master, 4096)
            except OSError:
                return
            self._device.host_writes(data, self.now_s())

    def _send(self) -> None:
        data = self._device.host_takes(self._device.host_waiting())
        if self._master >= 0 and data:
            os.write(self._master, data)
