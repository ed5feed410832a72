"""The camera that the bench means, by stable path and USB identity, and no other; what cannot be opened says why."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.camera_identity import connected_cameras, find_camera, refuse_inaccessible
from drivers.camera_settings import CameraSettings
from drivers.opencv_camera import OpenCvCamera
from rig.errors import HardwareError
from sim_backends.simulated_clock import SimulatedClock

BY_ID = "/dev/v4l/by-id/usb-046d_0825_{}-video-index{}"
BY_PATH = "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:{}:1.0-video-index{}"


class Computer:
    """Folders as udev and sysfs lay them out."""

    def __init__(self, root: Path) -> None:
        self.root, self.nodes = root, 0

    def plug(self, port: int, *, usb_id: str = "046d:0825", serial: str = "A1B2") -> None:
        """A USB camera with a node for pictures and one for metadata."""
        device = self.root / f"sys/devices/usb1/1-{port}"
        (device / "1-0:1.0").mkdir(parents=True)
        for name, text in zip(("idVendor", "idProduct", "serial"), (*usb_id.split(":"), serial), strict=True):
            (device / name).write_text(text + "\n")
        for index in (0, 1):
            node = f"video{self.nodes}"
            self.nodes += 1
            entry = self.root / "sys/class/video4linux" / node
            entry.mkdir(parents=True)
            (entry / "name").write_text("Webcam C270\n")
            (entry / "index").write_text(f"{index}\n")
            (entry / "device").symlink_to(device / "1-0:1.0")
            (self.root / "dev").mkdir(exist_ok=True)
            (self.root / "dev" / node).touch()
            for path in (BY_ID.format(serial, index), BY_PATH.format(port, index)):
                link = self.root / path.lstrip("/")
                link.parent.mkdir(parents=True, exist_ok=True)
                link.unlink(missing_ok=True)
                link.symlink_to(f"../../{node}")


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


def meaning(source: str, **changes: Any) -> CameraSettings:
    return CameraSettings(source=source, **changes)


@pytest.mark.parametrize("index", ["0", "12", "/dev/video0", "/dev/video11"])
def test_a_bare_index_is_refused_with_the_remedy(index: str) -> None:
    with pytest.raises(ValidationError, match=r"changes from start to start.*/dev/v4l/by-path"):
        CameraSettings(source=index)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"source": 0}, "valid string"),
        ({"source": "/dev/media0"}, "no camera path"),
        ({"source": "https://camera/stream"}, "https:// is not read"),
        ({"source": "rtsp://camera/stream"}, "rtsp:// is not read"),
        ({"source": "http://me:secret@camera/stream"}, "password is not read"),
        ({"source": "http://:8080/"}, "names no computer"),
        ({"source": "film.avi", "usb_id": "046d:0825"}, "usb_id and usb_serial need"),
        ({"source": "film.avi", "width_px": 640}, "both width_px and height_px"),
        ({"source": "film.avi", "focus": 10.0, "automatic": ("focus",)}, "focus is told a value and left automatic"),
        ({"source": "film.avi", "latency_s": float("nan")}, "finite"),
        ({"source": "film.avi", "latency": 0.1}, "Extra inputs"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CameraSettings(**changes)


def test_the_camera_is_found_by_either_stable_path(computer: Computer) -> None:
    computer.plug(1)
    computer.plug(2, usb_id="1234:abcd", serial="Z9")
    for source in (BY_PATH.format(2, 0), BY_ID.format("Z9", 0)):
        camera = find_camera(meaning(source, usb_id="1234:abcd", usb_serial="Z9"), computer.root)
        assert camera.node == "/dev/video2"
        assert camera.identity == "Webcam C270 1234:abcd Z9"
        assert camera.index == 0
    assert [c.node for c in connected_cameras(computer.root)] == [f"/dev/video{n}" for n in range(4)]
    assert connected_cameras(computer.root)[0].paths == (BY_PATH.format(1, 0), BY_ID.format("A1B2", 0))


@pytest.mark.parametrize("told", [{"usb_id": "046d:0826"}, {"usb_serial": "A1B3"}])
def test_another_camera_in_the_same_place_is_refused(computer: Computer, told: dict[str, str]) -> None:
    computer.plug(1)
    with pytest.raises(HardwareError, match=r"another camera is plugged in here.*(046d:0825|A1B2), not .*bench file"):
        find_camera(meaning(BY_PATH.format(1, 0), **told), computer.root)


def test_a_missing_camera_is_named_with_those_that_are_there(computer: Computer) -> None:
    computer.plug(1)
    with pytest.raises(HardwareError, match=r"usb-0:3:1.0-video-index0: no such camera.*now: /dev/v4l/by-path.*:1:1.0"):
        find_camera(meaning(BY_PATH.format(3, 0)), computer.root)


def test_twins_that_share_a_name_must_be_named_by_path(computer: Computer) -> None:
    computer.plug(1)
    computer.plug(2)
    with pytest.raises(HardwareError, match=r"2 cameras of this name.*by its path: .*:1:1.0.*:2:1.0"):
        find_camera(meaning(BY_ID.format("A1B2", 0)), computer.root)
    assert find_camera(meaning(BY_PATH.format(1, 0)), computer.root).node == "/dev/video0"


@pytest.mark.parametrize(
    ("number", "remedy"),
    [(errno.EACCES, "usermod -aG video"), (errno.EBUSY, "Close the program"), (errno.EIO, "Unplug")],
)
def test_a_camera_that_cannot_be_opened_says_what_to_do(computer: Computer, number: int, remedy: str) -> None:
    computer.plug(1)
    told = meaning(BY_PATH.format(1, 0))

    def refuse(path: str, flags: int) -> int:
        raise OSError(number, os.strerror(number), path)

    with pytest.raises(HardwareError, match=rf"{os.strerror(number)}.*{remedy}"):
        refuse_inaccessible(told, find_camera(told, computer.root), refuse)


def test_a_camera_that_is_not_there_is_never_replaced_by_another_source() -> None:
    camera = OpenCvCamera(meaning(BY_PATH.format(9, 0)), SimulatedClock())
    with pytest.raises(HardwareError, match="no such camera"):
        camera.connect()
    assert camera.latest() is None
