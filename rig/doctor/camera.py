"""Finds the camera that is meant, connects to it, takes a fresh picture and looks at it.

Connecting locks the controls that the bench file wants locked, as every use of the camera does; nothing moves.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.camera_identity import refuse_inaccessible
from drivers.camera_locks import Lock
from drivers.camera_settings import CameraSettings
from drivers.frame_checks import BadFrameError, PictureFault, PictureLook
from drivers.opencv_camera import OpenCvCamera
from rig.bench import Device
from rig.devices import Identity, LiveCamera
from rig.doctor.finding import Finding, Verdict, failed, not_tested, passed, raised, warned
from rig.doctor.surroundings import Surroundings
from rig.errors import HardwareError

LINES = ("identity", "pictures")
OPENCV_LINES = ("locks", "frame rate", "fresh picture", "exposure")
_RATE_SHARE = 0.8
_SLOWEST_HZ = 5.0
_LONG_WAIT_S = 1.0
_DIM_LEVEL = 80.0
_BRIGHT_SHARE = 0.05


def check_camera(device: Device, world: Surroundings) -> list[Finding]:
    """All lines of the camera."""
    identity = _identity(device, world)
    rest = OPENCV_LINES if isinstance(device.settings, CameraSettings) else ("fresh picture",)
    if identity.ok is Verdict.FAIL:
        return [identity, *not_tested("camera", (*LINES[1:], *rest), "camera: identity")]
    camera: LiveCamera = (world.make or (lambda d, clock: d.make(d.settings, clock)))(device, world.clock)
    try:
        who = camera.connect()
    except HardwareError as error:
        return [identity, raised("camera", "pictures", error), *not_tested("camera", rest, "camera: pictures")]
    try:
        return [identity, _pictures(who, camera), *_behind(camera, device, world)]
    finally:
        camera.close()


def _identity(device: Device, world: Surroundings) -> Finding:
    settings = device.settings
    if not isinstance(settings, CameraSettings):
        return passed("camera", "identity", f"is known to its driver ({device.driver})")
    if settings.kind != "v4l2":
        return passed("camera", "identity", settings.source)
    try:
        found = world.find_camera(settings)
        refuse_inaccessible(settings, found)
    except HardwareError as error:
        return raised("camera", "identity", error)
    if not (settings.usb_id or settings.usb_serial):
        return passed("camera", "identity", f"{found.identity} at {settings.source}; usb_id and usb_serial pin it down")
    return passed("camera", "identity", f"{found.identity} at {settings.source}, as the bench file says")


def _pictures(who: Identity, camera: LiveCamera) -> Finding:
    size = camera.size if isinstance(camera, OpenCvCamera) else None
    of = f", {size[0]}x{size[1]}" if size is not None else ""
    return passed("camera", "pictures", f"{who.kind} {who.version}{of}")


def _behind(camera: LiveCamera, device: Device, world: Surroundings) -> list[Finding]:
    settings = device.settings
    if not isinstance(camera, OpenCvCamera) or not isinstance(settings, CameraSettings):
        return _capture(camera, world)
    of_picture = _capture(camera, world)  # first: more frames come meanwhile, from which the rate is known
    if len(of_picture) == 1 and camera.last_look is not None:
        of_picture.append(check_exposure(camera.last_look))
    return [
        check_locks(camera.locks, settings),
        check_rate(camera.frame_period_s, settings.frame_rate_hz),
        *of_picture,
    ]


def _capture(camera: LiveCamera, world: Surroundings) -> list[Finding]:
    asked_s = world.clock.now_s()
    try:
        picture = camera.capture(asked_s)
    except BadFrameError as error:
        if PictureFault.FROZEN in error.faults:
            return _not_fresh(error)
        # Only fresh pictures are looked at: what they show is at fault.
        return [passed("camera", "fresh picture", "they come"), raised("camera", "exposure", error)]
    except HardwareError as error:
        return _not_fresh(error)
    waited_s = world.clock.now_s() - asked_s
    told_s = f"proved to be exposed after it was asked for; took {1000.0 * waited_s:.0f} ms"
    if picture.exposed_at_s <= asked_s:
        return [
            failed("camera", "fresh picture", "the driver gave an old picture", "Report this: the driver is at fault")
        ]
    if waited_s > _LONG_WAIT_S:
        remedy = (
            "Ask for a higher frame rate, a smaller size or pixel_format MJPG; lower latency_s if it is too careful"
        )
        return [warned("camera", "fresh picture", told_s, remedy)]
    return [passed("camera", "fresh picture", told_s)]


def _not_fresh(error: HardwareError) -> list[Finding]:
    late = raised("camera", "fresh picture", error)
    return [late, *not_tested("camera", ("exposure",), "camera: fresh picture")]


def check_locks(locks: Sequence[Lock], settings: CameraSettings) -> Finding:
    """Exposure, white balance, focus and gain stay as they are, or the bench file says that they need not."""
    if settings.kind == "http":
        told_s = (
            "" if settings.exposure_s is None else f" to {settings.exposure_s:g} s, which the bench file counts with"
        )
        return passed("camera", "locks", f"cannot be seen over HTTP: set the exposure in the camera itself{told_s}")
    told = {
        "exposure": ("exposure_s", settings.exposure_s),
        "white_balance": ("white_balance_k", settings.white_balance_k),
        "focus": ("focus", settings.focus),
        "gain": ("gain", settings.gain),
    }
    for lock in locks:
        key, wanted = told[lock.name]
        if lock.held:
            continue
        if wanted is not None:
            return failed(
                "camera",
                "locks",
                f"{lock.name} is not locked at {wanted:g}: {lock.trouble}",
                f"Set {key} to a value that the device takes, or leave it out",
            )
        if lock.value is not None:
            return warned(
                "camera",
                "locks",
                f"{lock.name} is not locked: {lock.trouble}",
                f"Give {key} a value, or list {lock.name} under automatic if it may change",
            )
    held = [lock.name for lock in locks if lock.held]
    without = [lock.name for lock in locks if not lock.held]
    text = f"{', '.join(held) or 'nothing'} locked"
    return passed("camera", "locks", text + (f"; the device has no control of {', '.join(without)}" if without else ""))


def check_rate(period_s: float | None, wanted_hz: float | None) -> Finding:
    """It gives the frames that it was asked for."""
    if period_s is None:
        return warned(
            "camera",
            "frame rate",
            "cannot be told: this computer never waits for a frame",
            "Ask for a smaller size or frame rate",
        )
    rate_hz = 1.0 / period_s
    least_hz = _SLOWEST_HZ if wanted_hz is None else _RATE_SHARE * wanted_hz
    if rate_hz < least_hz:
        asked = "" if wanted_hz is None else f", not the {wanted_hz:g} asked for"
        return warned(
            "camera",
            "frame rate",
            f"{rate_hz:.1f} frames a second{asked}",
            "Shorten exposure_s, set pixel_format: MJPG, ask for a smaller size, or use a USB port of its own",
        )
    return passed("camera", "frame rate", f"{rate_hz:.1f} frames a second")


def check_exposure(look: PictureLook) -> Finding:
    """Neither too dark nor too bright to see corners in."""
    if look.saturated_share > _BRIGHT_SHARE:
        return warned(
            "camera",
            "exposure",
            f"{look.saturated_share:.0%} of the picture is saturated",
            "Shorten exposure_s, lower the gain, or dim the light",
        )
    if look.top_level < _DIM_LEVEL:
        return warned(
            "camera",
            "exposure",
            f"the brightest of the picture is at level {look.top_level:.0f} of 255",
            "Lengthen exposure_s, raise the gain, or add light",
        )
    return passed("camera", "exposure", f"mean level {look.mean_level:.0f}, {look.saturated_share:.1%} saturated")
