"""Which benches can be emulated: live ones all of whose devices have an emulator."""

from __future__ import annotations

from drivers.dynamixel import DynamixelAxis
from drivers.grbl import GrblGantry
from drivers.opencv_camera import OpenCvCamera
from rig.bench import BenchConfig, LiveBenchFile
from rig.errors import InputError

_EMULATED = {"gantry": GrblGantry, "pan": DynamixelAxis, "zoom": DynamixelAxis, "camera": OpenCvCamera}


def emulable(config: BenchConfig) -> LiveBenchFile:
    """What the bench's file says.

    Raises:
        InputError: a mock bench, or a device that there is no emulator for.
    """
    if not isinstance(config.file, LiveBenchFile):
        raise InputError(
            "this is a mock bench: there is nothing to emulate", where=config.name, remedy="Name a live bench's file"
        )
    for role, device in config.devices.items():
        if device.make is not _EMULATED[role]:
            raise InputError(
                f"there is no emulator of the driver {device.driver!r}",
                where=f"{config.name}: devices.{role}.driver",
                remedy="Emulated are grbl, dynamixel and opencv",
            )
    return config.file
