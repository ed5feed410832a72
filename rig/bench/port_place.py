"""Tells where a serial port is plugged in, whichever of its names a bench file uses."""

from __future__ import annotations

import os
from pathlib import Path

from drivers.serial_ports import resolve_port
from rig.errors import HardwareError

BY_PATH = Path("/dev/serial/by-path")
_PASSING = "/dev/pts/"


def place_of(port: str) -> str | None:
    """The port's name by its place, or its device path where it has none; ``None``: it is not there, or not for long.

    A number like that of ``/dev/ttyUSB0`` would do while it is plugged in; the place also outlives that.
    """
    try:
        device = resolve_port(port)
    except HardwareError:
        return None
    # The number of a pseudo-terminal is given to another one as soon as it is closed.
    if device.startswith(_PASSING):
        return None
    links = sorted(BY_PATH.iterdir()) if BY_PATH.is_dir() else []
    return next((str(link) for link in links if os.path.realpath(link) == device), device)
