"""Finds the drivers that a bench file names, by entry points, and lets each check its own settings.

A driver is a class whose constructor takes ``(settings, clock)`` and whose attribute ``Settings`` is a pydantic model.
It may have a class method ``together(settings, clock)`` that makes several axes at once, so that those on one bus can
share it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from pydantic import BaseModel

from rig.bench.live import DeviceEntry, Devices
from rig.devices import Clock, LiveAxis, LiveCamera, LiveGantry
from rig.schema import Document, Problem, check, did_you_mean, raise_problems

GROUPS = {"gantry": "rig.gantries", "pan": "rig.axes", "zoom": "rig.axes", "camera": "rig.cameras"}
AXES = ("pan", "zoom")
PLAY = ("backlash_mm", "backlash_deg")


@dataclass(frozen=True)
class Device:
    """A device of a bench, not made yet.

    Attributes:
        role: ``gantry``, ``pan``, ``zoom`` or ``camera``.
        driver: by the name of its entry point.
        make: the driver's class.
        settings: an instance of its ``Settings``.
    """

    role: str
    driver: str
    make: Any
    settings: BaseModel


Maker = Callable[[Device, Clock], Any]


def installed(group: str) -> dict[str, EntryPoint]:
    """The drivers of an entry-point group, by name."""
    return {point.name: point for point in entry_points(group=group)}


def devices_of(entries: Devices, document: Document) -> dict[str, Device]:
    """Look up the drivers of a bench file and check their settings.

    Raises:
        InputError: with file:line:column of everything that is wrong.
    """
    found: dict[str, Device] = {}
    problems: list[Problem] = []
    for role in GROUPS:
        entry: DeviceEntry | None = getattr(entries, role)
        if entry is None:
            continue
        device, wrong = _device(role, entry.driver, document)
        problems += wrong
        if device is not None:
            found[role] = device
    raise_problems(problems)
    return found


def make_devices(
    devices: Mapping[str, Device], clock: Clock, make: Maker | None = None
) -> tuple[LiveGantry, dict[str, LiveAxis], LiveCamera]:
    """Construct the gantry, the axes by role, and the camera; nothing is opened.

    Args:
        devices: of a bench.
        clock: theirs from now on.
        make: constructs one device, e.g. on an emulated port; ``None``: the drivers' own constructors.
    """
    each = make or (lambda device, clock: device.make(device.settings, clock))
    axes = {role: devices[role] for role in AXES if role in devices}
    made: dict[str, LiveAxis] = {}
    for driver in dict.fromkeys(device.make for device in axes.values()):
        roles = [role for role, device in axes.items() if device.make is driver]
        together = getattr(driver, "together", None)
        if make is None and together is not None:
            made |= zip(roles, together([axes[role].settings for role in roles], clock), strict=True)
        else:
            made |= {role: each(axes[role], clock) for role in roles}
    gantry, camera = each(devices["gantry"], clock), each(devices["camera"], clock)
    return cast(LiveGantry, gantry), made, cast(LiveCamera, camera)


def _device(role: str, driver: str, document: Document) -> tuple[Device | None, Sequence[Problem]]:
    group, at = GROUPS[role], ("devices", role)
    known = installed(group)
    if driver not in known:
        remedy = " ".join(filter(None, (did_you_mean(driver, known), _listed(group, known))))
        return None, [document.problem((*at, "driver"), f"there is no driver {driver!r}", remedy)]
    try:
        make = known[driver].load()
    except (ImportError, AttributeError) as failure:
        reason = f"the driver {driver!r} cannot be loaded ({failure})"
        return None, [document.problem((*at, "driver"), reason, "Install what it needs, or another version of it.")]
    settings, problems = check(make.Settings, document, at=at, without=("driver",))
    problems += [
        document.problem(
            (*at, *location),
            "the guard has to know of backlash, since it checks the way past a place",
            "Say it under axes (`backlash_mm`, `backlash_deg`), and leave it out here.",
            key=True,
        )
        for location in _play_in(document.data["devices"][role])
    ]
    return (None if settings is None else Device(role, driver, make, settings)), problems


def _listed(group: str, known: Mapping[str, EntryPoint]) -> str:
    return f"Installed ({group}): {', '.join(sorted(known))}." if known else f"No driver is installed ({group})."


def _play_in(data: Any, at: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Where a driver's settings speak of backlash that is not 0: its own approach would escape the guard's checks."""
    if not isinstance(data, dict):
        return []
    found = [(*at, key) for key in PLAY if data.get(key)]
    for key, value in data.items():
        found += _play_in(value, (*at, key))
    return found
