"""Puts emulated devices where real programs find them: serial lines on pseudo-terminals, the camera on HTTP."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

from rig.clock import SystemClock
from rig.devices import Clock
from sim_backends.camera_emulator import EmulatedCamera
from sim_backends.mjpeg_server import MjpegServer
from sim_backends.pty_server import PtyServer
from sim_backends.wired_device import WiredDevice

LATENCY_S = 0.4
"""A bench file for an emulated bench says so: the camera's frames are drawn as they come, on this computer."""
READOUT_S, ON_TIME_S = 0.02, 0.25


class Served:
    """Emulated devices on real time. A context manager: inside it `ports` and `url` are there.

    Attributes:
        ports: paths of the pseudo-terminals, by the port that the bench file names.
    """

    def __init__(self, lines: Mapping[str, WiredDevice]) -> None:
        """Make the terminals; nothing runs yet.

        Args:
            lines: the serial devices by port.
        """
        self._servers = {port: PtyServer(line) for port, line in lines.items()}
        self._lines = dict(lines)
        self._stack = ExitStack()
        self._stream: MjpegServer | None = None
        self.ports = {port: server.path for port, server in self._servers.items()}

    @property
    def url(self) -> str:
        """Of the camera's stream."""
        assert self._stream is not None, "not started"
        return self._stream.url

    def start(self, camera: EmulatedCamera, clock: Clock | None = None) -> None:
        """Let everything run in threads."""
        for server in self._servers.values():
            self._stack.enter_context(server)
        self._stream = self._stack.enter_context(MjpegServer(camera, clock or SystemClock(), on_time_s=ON_TIME_S))

    def bring_up_to_date(self) -> ExitStack:
        """Let all devices catch up with the clock, and hold them there while inside the context that is returned."""
        held = ExitStack()
        for port, server in self._servers.items():
            held.enter_context(server.lock)
            self._lines[port].advance_to(server.now_s())
        return held

    def close(self) -> None:
        """End all threads. Safe to call twice."""
        self._stack.close()
