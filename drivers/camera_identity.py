"""Finds the one V4L2 camera that a bench means, and refuses any other: stable path, USB identity, permission."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.camera_settings import STABLE_FOLDERS, CameraSettings
from rig.errors import HardwareError

_NODE = re.compile(r"video\d+")
_BY_PATH, _BY_ID = STABLE_FOLDERS


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A video device of this computer.

    Attributes:
        node: ``/dev/videoN``, which changes from start to start.
        name: as the device calls itself.
        usb_id: vendor and product, ``046d:0825``; empty where it is not on USB.
        usb_serial: serial number; empty where it has none.
        index: 0 for a camera's pictures, others for metadata and the like.
        paths: its stable paths, those by path first.
    """

    node: str
    name: str
    usb_id: str
    usb_serial: str
    index: int
    paths: tuple[str, ...]

    @property
    def identity(self) -> str:
        """Name, USB identity and serial number, as far as there are any."""
        return " ".join(part for part in (self.name, self.usb_id, self.usb_serial) if part)


def connected_cameras(root: Path = Path("/")) -> tuple[FoundCamera, ...]:
    """The video devices that this computer has, in the order of their numbers; ``root`` holds ``dev`` and ``sys``."""
    nodes = sorted((root / "sys/class/video4linux").glob("video*"), key=lambda path: (len(path.name), path.name))
    return tuple(_described(path.name, root) for path in nodes if _NODE.fullmatch(path.name))


def find_camera(settings: CameraSettings, root: Path = Path("/")) -> FoundCamera:
    """The camera that a bench means.

    Raises:
        HardwareError: it is not there, another one is, or more than one could be meant.
    """
    path = root / settings.source.lstrip("/")
    cameras = connected_cameras(root)
    if not path.exists():
        there = ", ".join(camera.paths[0] for camera in cameras if camera.index == 0 and camera.paths) or "none"
        raise HardwareError(f"{settings.source}: no such camera. Check cable and power; connected now: {there}")
    node = os.path.realpath(path)
    found = [camera for camera in cameras if os.path.realpath(root / camera.node.lstrip("/")) == node]
    if not found:
        raise HardwareError(f"{settings.source}: {node} is no video device. `rig doctor --discover` lists the cameras")
    _refuse_another(settings, found[0])
    if settings.source.startswith(_BY_ID):
        _refuse_twins(settings.source, found[0], cameras)
    return found[0]


def refuse_inaccessible(
    settings: CameraSettings, camera: FoundCamera, open_node: Callable[[str, int], int] = os.open
) -> None:
    """Open the device once for reading and writing, and close it.

    Raises:
        HardwareError: permission denied, in use, or gone; says what to do.
    """
    try:
        descriptor = open_node(camera.node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        remedy = {
            errno.EACCES: "Add yourself to the group that owns it (`sudo usermod -aG video $USER`) and log in again",
            errno.EPERM: "Add yourself to the group that owns it (`sudo usermod -aG video $USER`) and log in again",
            errno.EBUSY: "Close the program that uses it",
        }.get(error.errno or 0, "Unplug it, plug it in and try again")
        raise HardwareError(
            f"{settings.source} ({camera.node}): cannot be opened: {error.strerror or error}. {remedy}"
        ) from error
    os.close(descriptor)


def _described(number: str, root: Path) -> FoundCamera:
    entry = root / "sys/class/video4linux" / number
    device = Path(os.path.realpath(entry / "device"))
    # The USB device stands above the interface that the video node belongs to.
    usb = next((d for d in (device, *device.parents) if (d / "idVendor").is_file()), None)
    usb_id = f"{_read(usb / 'idVendor')}:{_read(usb / 'idProduct')}" if usb is not None else ""
    node = os.path.realpath(root / "dev" / number)
    links = [
        f"{folder}{link.name}"
        for folder in STABLE_FOLDERS
        for link in sorted((root / folder.lstrip("/")).glob("*"))
        if os.path.realpath(link) == node
    ]
    return FoundCamera(
        node=f"/dev/{number}",
        name=_read(entry / "name"),
        usb_id=usb_id.lower(),
        usb_serial=_read(usb / "serial") if usb is not None else "",
        index=int(_read(entry / "index") or 0),
        paths=tuple(links),
    )


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""  # the kernel leaves out what a device does not tell


def _refuse_another(settings: CameraSettings, camera: FoundCamera) -> None:
    for what, wanted, got in (
        ("usb_id", settings.usb_id, camera.usb_id),
        ("usb_serial", settings.usb_serial, camera.usb_serial),
    ):
        if wanted is not None and wanted != got:
            raise HardwareError(
                f"{settings.source}: another camera is plugged in here: {what} is {got or 'not told'}, not {wanted} "
                f"({camera.identity}). Plug the bench's camera in here, or correct {what} in the bench file"
            )


def _refuse_twins(source: str, camera: FoundCamera, cameras: tuple[FoundCamera, ...]) -> None:
    """Identical cameras share one by-id name, and the link points to the one that came last."""
    own = (camera.usb_id, camera.usb_serial, camera.index)
    twins = [c for c in cameras if (c.usb_id, c.usb_serial, c.index) == own]
    if len(twins) > 1:
        by_path = ", ".join(path for c in twins for path in c.paths if path.startswith(_BY_PATH))
        raise HardwareError(
            f"{source}: {len(twins)} cameras of this name are plugged in. Name the one that is meant by its path: "
            f"{by_path or _BY_PATH}"
        )
