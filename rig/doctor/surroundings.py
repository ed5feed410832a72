"""What the doctor looks at besides the devices, passed in as functions: ports, cameras, disk, runtime folder."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.camera_identity import FoundCamera, connected_cameras, find_camera
from drivers.camera_settings import CameraSettings
from drivers.dynamixel.latency import latency_timer_ms
from drivers.grbl import OpenPort, open_settings_port
from drivers.port_lock import lock_port
from drivers.serial_link import SerialPort
from drivers.serial_ports import Adapter, resolve_port, system_adapters
from rig.bench import Maker
from rig.clock import SystemClock
from rig.devices import Clock
from rig.imagegrid.disk import write_whole
from rig.runtime import runtime_folder

_STABLE = (Path("/dev/serial/by-path"), Path("/dev/serial/by-id"))
_TRIAL_BYTES = 8 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class DiskLook:
    """An output folder's disk: free space, and how fast it takes a picture for good."""

    free_bytes: int
    bytes_per_s: float


def look_at_disk(folder: Path) -> DiskLook:
    """Write a trial file as pictures are written (flushed to the disk itself), and remove it.

    Raises:
        OSError: the folder is not there or cannot be written.
    """
    trial, data = folder / f".rig-doctor-{os.getpid()}", os.urandom(_TRIAL_BYTES)
    began_s = time.perf_counter()
    try:
        write_whole(os, trial, data)
    finally:
        trial.unlink(missing_ok=True)
    return DiskLook(shutil.disk_usage(folder).free, _TRIAL_BYTES / (time.perf_counter() - began_s))


def take_and_release(device: str) -> None:
    """See that no process holds a port.

    Raises:
        HardwareError: one does (names it).
    """
    lock_port(device).release()


def stable_name(device: str, folders: Sequence[Path] = _STABLE) -> str:
    """The path of a port that tells where it is plugged in, or else its own."""
    links = (link for folder in folders for link in sorted(folder.glob("*")))
    return next((str(link) for link in links if os.path.realpath(link) == os.path.realpath(device)), device)


def may_use(device: str) -> bool:
    """This user may read and write a device."""
    return os.access(device, os.R_OK | os.W_OK)


@dataclass(frozen=True)
class Surroundings:
    """Everything that a test can put in place of this computer.

    Attributes:
        clock: the devices'.
        make: constructs one device, e.g. on an emulated port; ``None``: the drivers' own constructors.
        find_port: the device path that a port's name stands for.
        may_use: this user may read and write a port.
        refuse_held: raises where another process holds a port.
        latency_ms: the latency timer of a port's adapter; ``None``: it has none.
        find_camera: the V4L2 camera that a bench means.
        disk: looks at the disk of an output folder.
        runtime: the folder where processes of this user meet.
        adapters: the serial ports that there are.
        stable_name: a port's name that stays when it is plugged in again.
        cameras: the video devices that there are.
        open_gantry: opens a port to ask for a gantry's controller.
        open_bus: opens a port to ask for servos; ``None``: the real one.
    """

    clock: Clock
    make: Maker | None = None
    find_port: Callable[[str], str] = resolve_port
    may_use: Callable[[str], bool] = may_use
    refuse_held: Callable[[str], None] = take_and_release
    latency_ms: Callable[[str], int | None] = latency_timer_ms
    find_camera: Callable[[CameraSettings], FoundCamera] = find_camera
    disk: Callable[[Path], DiskLook] = look_at_disk
    runtime: Callable[[], Path] = runtime_folder
    adapters: Callable[[], Sequence[Adapter]] = system_adapters
    stable_name: Callable[[str], str] = stable_name
    cameras: Callable[[], Sequence[FoundCamera]] = connected_cameras
    open_gantry: OpenPort = open_settings_port
    open_bus: Callable[[str, int], SerialPort] | None = None


def this_computer() -> Surroundings:
    """Real devices, real time."""
    return Surroundings(SystemClock())
