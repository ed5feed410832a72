"""Looks at the serial ports before anything is opened: there, allowed, free, and not meant for two devices."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from typing import Any

from drivers.serial_link import not_opened
from rig.bench import Device
from rig.doctor.finding import Finding, failed, not_tested, passed, raised
from rig.doctor.surroundings import Surroundings
from rig.errors import HardwareError

LINES = ("port", "permission", "in use")


def port_of(device: Device) -> str | None:
    """The serial port that a device's settings name; ``None``: it has none."""
    return getattr(device.settings, "port", None)


def check_port(subject: str, port: str, others: Mapping[str, str], world: Surroundings) -> list[Finding]:
    """All lines of one port.

    Args:
        subject: whose port it is.
        port: as the bench file has it.
        others: subjects of other kinds by the device path that they use.
        world: this computer.
    """
    try:
        device = world.find_port(port)
    except HardwareError as error:
        return [raised(subject, "port", error), *not_tested(subject, LINES[1:], f"{subject}: port")]
    if device in others:
        told = f"{port} is {device}, which is the port of the {others[device]} as well"
        shared = failed(
            subject, "port", told, "Give each its own port; `rig doctor --discover` tells who answers where"
        )
        return [shared, *not_tested(subject, LINES[1:], f"{subject}: port")]
    found = [passed(subject, "port", port if device == port else f"{port} is {device}")]
    if not world.may_use(device):
        found.append(raised(subject, "permission", not_opened(device, OSError(errno.EACCES, "Permission denied"))))
        return [*found, *not_tested(subject, LINES[2:], f"{subject}: permission")]
    found.append(passed(subject, "permission", "may be read and written"))
    try:
        world.refuse_held(device)
    except HardwareError as error:
        return [*found, raised(subject, "in use", error)]
    return [*found, passed(subject, "in use", "by no other process")]


def resolved(devices: Mapping[str, Any], world: Surroundings) -> dict[str, str]:
    """Device paths by role, of the ports that there are."""
    paths = {}
    for role, device in devices.items():
        port = port_of(device)
        if port is not None:
            try:
                paths[role] = world.find_port(port)
            except HardwareError:
                continue  # its own line tells
    return paths
