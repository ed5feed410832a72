"""Finds the one serial port that a bench means: by its path under /dev/serial, or by its adapter's serial number."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Protocol

from rig.errors import HardwareError

_BY_ID = "/dev/serial/by-id/"
_NUMBERED = ("/dev/ttyUSB", "/dev/ttyACM")


class Adapter(Protocol):
    """A serial port as pyserial's ``list_ports`` describes it."""

    device: str
    serial_number: str | None
    vid: int | None
    pid: int | None


def system_adapters() -> Sequence[Adapter]:
    """The serial ports that this computer has."""
    from serial.tools import list_ports

    return list(list_ports.comports())


def resolve_port(name: str, adapters: Callable[[], Sequence[Adapter]] = system_adapters) -> str:
    """The device path that a name stands for.

    Args:
        name: a path (best one under ``/dev/serial/by-path`` or ``by-id``), or an adapter's serial number.
        adapters: lists what is connected.

    Raises:
        HardwareError: there is no such port, or more than one could be meant.
    """
    if not name.startswith("/"):
        return _by_serial_number(name, adapters())
    if not os.path.exists(name):
        raise HardwareError(f"{name}: no such port. Check cable and power; `rig doctor --discover` lists the ports")
    device = os.path.realpath(name)
    if name.startswith(_BY_ID):
        _refuse_twins(name, device, adapters())
    elif name.startswith(_NUMBERED):
        _refuse_company(name, adapters())
    return device


def _by_serial_number(number: str, adapters: Sequence[Adapter]) -> str:
    found = [adapter.device for adapter in adapters if adapter.serial_number == number]
    if not found:
        raise HardwareError(
            f"no serial adapter has the serial number {number!r}. Check cable and power; `rig doctor --discover` lists "
            "the ports"
        )
    if len(found) > 1:
        raise _ambiguous(number, found)
    return found[0]


def _refuse_twins(name: str, device: str, adapters: Sequence[Adapter]) -> None:
    """Identical adapters share one by-id name, and the link points to the one that came last."""
    own = [adapter for adapter in adapters if os.path.realpath(adapter.device) == device]
    identities = {(adapter.vid, adapter.pid, adapter.serial_number) for adapter in own}
    twins = [a.device for a in adapters if (a.vid, a.pid, a.serial_number) in identities]
    if len(twins) > 1:
        raise _ambiguous(name, twins)


def _refuse_company(name: str, adapters: Sequence[Adapter]) -> None:
    """Numbers are given in the order of plugging in: they tell adapters apart only where there is but one."""
    numbered = [adapter.device for adapter in adapters if adapter.device.startswith(_NUMBERED)]
    if len(numbered) > 1:
        raise _ambiguous(name, numbered)


def _ambiguous(name: str, found: Sequence[str]) -> HardwareError:
    return HardwareError(
        f"{name!r} could be any of {', '.join(sorted(found))}. Name the port by its path under /dev/serial/by-path"
    )
