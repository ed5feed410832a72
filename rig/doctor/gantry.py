"""Connects to the gantry's controller, asks who it is and how it stands, and compares its settings with the bench file.

Nothing is sent but what the driver's own `connect` and `status` send: status queries, ``$I``, ``$$``, and the byte that
sets the feed override back to 100 %.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblSettings
from rig.bench import Device, LiveBenchFile
from rig.devices import GantryStatus, Identity, LiveGantry, Motion
from rig.doctor.controller import Controller
from rig.doctor.finding import Finding, failed, in_two, not_tested, passed, raised
from rig.doctor.firmware import CHECKS, check_firmware
from rig.doctor.surroundings import Surroundings
from rig.errors import HardwareError
from rig.guard import State

USUAL_BAUD_RATES = (115200, 250000, 57600, 38400, 9600)
_MUST_HOME = (None, 11)
"""Alarms of a controller that only waits to be homed: GRBL tells no number."""
_TRIAL_S = 3.0


def check_gantry(device: Device, file: LiveBenchFile, world: Surroundings) -> list[Finding]:
    """All lines of the gantry behind those of its port."""
    gantry = made(device, world)
    try:
        identity = gantry.connect()
    except HardwareError as error:
        # It may have been struck dumb, or speak at another rate.
        found = _at_another_rate(device, world) or raised("gantry", "firmware", error)
        return [found, *not_tested("gantry", ("state", *_firmware_lines(device)), "gantry: firmware")]
    try:
        return [
            passed("gantry", "firmware", f"{identity.kind} {identity.version}".strip()),
            _state(gantry),
            *_settings(gantry, identity, device, file),
        ]
    finally:
        gantry.close()


def made(device: Device, world: Surroundings) -> LiveGantry:
    """The gantry, not connected."""
    gantry: LiveGantry = (world.make or (lambda d, clock: d.make(d.settings, clock)))(device, world.clock)
    return gantry


def _firmware_lines(device: Device) -> Sequence[str]:
    return tuple(CHECKS) if isinstance(device.settings, GrblSettings) else ()


def _settings(gantry: LiveGantry, identity: Identity, device: Device, file: LiveBenchFile) -> list[Finding]:
    settings = device.settings
    if not isinstance(gantry, GrblGantry) or not isinstance(settings, GrblSettings):
        return []  # another driver's: what its settings mean is its own
    x, y, z = (axis.speed_mm_per_s for axis in (file.axes.x_mm, file.axes.y_mm, file.axes.z_mm))
    return check_firmware(Controller(identity.kind, gantry.firmware_settings, settings, (x, y, z)))


def _state(gantry: LiveGantry) -> Finding:
    try:
        status = gantry.status()
    except HardwareError as error:
        return raised("gantry", "state", error)
    return state_finding(status)


def state_finding(status: GantryStatus) -> Finding:
    """Idle, or waiting to be homed, is well; any other alarm or motion is not. In the words of `rig status`."""
    if status.motion is Motion.ALARM and status.alarm not in _MUST_HOME:
        told, remedy = in_two(status.trouble)
        return failed("gantry", "state", f"{State.ALARM.value}: {told}", remedy)
    if status.motion not in (Motion.IDLE, Motion.ALARM):
        return failed(
            "gantry",
            "state",
            f"{status.motion.value}, though nobody here has told it to",
            "Wait until whoever drives it is done, or stop it (`rig stop`)",
        )
    if status.motion is Motion.ALARM:
        return passed("gantry", "state", f"{State.ALARM.value}: locked until it is homed (`rig home`)")
    state = State.IDLE if status.homed else State.UNHOMED
    told = "at rest, homed" if status.homed else "at rest, to be homed (`rig home`)"
    return passed("gantry", "state", f"{state.value}: {told}")


def _at_another_rate(device: Device, world: Surroundings) -> Finding | None:
    """Where the controller answers at a rate that the bench file does not have."""
    settings = device.settings
    if not isinstance(settings, GrblSettings):
        return None
    for baud in USUAL_BAUD_RATES:
        identity = None if baud == settings.baud else who_answers(device, world, baud=baud)
        if identity is not None:
            return failed(
                "gantry",
                "firmware",
                f"{identity.kind} {identity.version} answers at {baud} baud, not at {settings.baud}",
                f"Set devices.gantry.baud to {baud}",
            )
    return None


def who_answers(device: Device, world: Surroundings, **changes: object) -> Identity | None:
    """The controller that answers if the settings are changed, e.g. on another port; ``None``: none.

    Until one has answered only ``?`` is sent, which at a wrong baud rate arrives as bytes that mean nothing, and to a
    servo as well.
    """
    settings = device.settings
    if not isinstance(settings, GrblSettings):
        return None
    hasty = settings.deadlines.model_copy(update={"connect_s": min(_TRIAL_S, settings.deadlines.connect_s)})
    changed = settings.model_copy(update={"deadlines": hasty, **changes})
    gantry = made(Device(device.role, device.driver, device.make, changed), world)
    try:
        return gantry.connect()
    except HardwareError:
        return None
    finally:
        gantry.close()
