"""Writes a first bench file of what was found: careful values, each with a comment that says what to measure."""

from __future__ import annotations

import json

from drivers.dynamixel.table import MODELS, MODES, TICKS_PER_TURN
from rig.doctor.controller import ACCELERATION, RATE, TRAVEL, ranges
from rig.doctor.discovery import Seen, SeenGantry, SeenServo, camera_path
from rig.errors import HardwareError

_NO_CAMERA = "/dev/v4l/by-path/no-camera-was-found"
_CAREFUL_FEED = 3000.0
_UNTOLD_MM, _UNTOLD_FEED, _UNTOLD_ACCELERATION = 100.0, 500.0, 10.0
_MARGIN_MM, _MARGIN_SHARE = 2.0, 0.1
_AXES = "xyz"
_NUMBER = {number: name for name, number in MODES.items()}
_LIMITS_HEAD = """\
    # Machine coordinates. Taken from the controller's travel ($130 to $132), a little inside its ends, and at most at
    # half its rate ($110 to $112). Confirm: home it, jog to each end with the power switch in reach, narrow if need be.
"""
_PAN = """\
  pan:
    # Confirm that this servo turns the camera about Y and is not the zoom ring; set gear_ratio, sign and zero_ticks
    # (the servo's count where the camera looks straight ahead). 30 degrees to each side until you know the cable's.
    driver: dynamixel
    port: {port}
    baud: {baud}
    id: {id}
    model: {model}
    mode: {mode}
    speed_deg_per_s: 10.0
    acceleration_deg_per_s2: 30.0
    role: {{kind: pan, gear_ratio: 1.0, sign: 1, zero_ticks: 2048, lower_deg: -30.0, upper_deg: 30.0}}
"""
_ZOOM = """\
  # A second servo was found. If it turns the zoom ring, measure the ring's angle at several zooms (0: widest, 1:
  # longest), put them into the table, and take the marks off these lines and off `zoom` under axes. A wrong table
  # breaks lenses.
  # zoom:
  #   driver: dynamixel
  #   port: {port}
  #   baud: {baud}
  #   id: {id}
  #   model: {model}
  #   mode: {mode}
  #   role: {{kind: zoom, sign: {sign}, zero_ticks: {position}, table: [[0.0, 0.0], [1.0, 30.0]]}}
"""
_SAFETY = """\
safety:
  # Confirm: measure the box that the object stands in, in the rig frame, and how far the camera and its lens reach.
  # Without a box nothing but the limits above keeps the camera from the object.
  # keep_out:
  #   - {name: object, x_mm: [0, 100], y_mm: [0, 100], z_mm: [0, 100]}
  # margin_mm: 100
  homing: each_session
"""


def first_bench(found: Seen) -> str:
    """The text of a bench file that loads, with the first gantry, the first known servo as pan, the first camera.

    Raises:
        HardwareError: no gantry was found: there is nothing to take limits from.
    """
    gantry = found.gantry
    if gantry is None:
        raise HardwareError("no gantry was found, to take limits from. Connect it and switch it on, then try again")
    servos = [seen for seen in found.servos if seen.servo.model in MODELS]
    return "".join(
        (
            "# A first bench file, written by `rig doctor --discover`. Every value is careful, none is measured:\n"
            "# confirm what the comments ask for before anything moves, then run `rig doctor` on this file.\n"
            "schema: 1\nkind: live\n\ndevices:\n",
            _gantry(gantry),
            "".join(form.format(**_values(seen)) for form, seen in zip((_PAN, _ZOOM), servos, strict=False)),
            _camera(found),
            "\n",
            _axes(gantry, with_pan=bool(servos), with_zoom=len(servos) > 1),
            "\n",
            _SAFETY,
        )
    )


def limits_of(gantry: SeenGantry) -> list[tuple[float, float, float]]:
    """Careful lower and upper limits, mm, machine coordinates, and feeds, mm/min, of X, Y and Z."""
    firmware, careful = gantry.firmware, []
    for axis in range(3):
        travel = firmware.get(TRAVEL + axis, 0.0) or _UNTOLD_MM
        low, high = ranges(gantry.identity.kind, firmware, axis, travel)[0]
        margin = min(max(_MARGIN_MM, firmware.get(27, 0.0)), _MARGIN_SHARE * travel)
        rate = firmware.get(RATE + axis, 0.0) or _UNTOLD_FEED
        acceleration = firmware.get(ACCELERATION + axis, 0.0) or _UNTOLD_ACCELERATION
        # What stops within a second is at rest well before a STOP gives up waiting and resets.
        feed = min(rate / 2.0, _CAREFUL_FEED, 60.0 * acceleration)
        careful.append((round(low + margin, 1), round(high - margin, 1), max(1.0, float(int(feed)))))
    return careful


def _gantry(gantry: SeenGantry) -> str:
    axes = "".join(
        f"    {name}: {{lower_mm: {low}, upper_mm: {high}, feed_mm_per_min: {feed}}}\n"
        for name, (low, high, feed) in zip(_AXES, limits_of(gantry), strict=True)
    )
    who = _plain(f"{gantry.identity.kind} {gantry.identity.version}")
    return (
        f"  gantry:\n    # {who}\n    driver: grbl\n    port: {json.dumps(gantry.port)}\n    baud: {gantry.baud}\n"
        f"    # Some boards with native USB answer only with dtr: true; most others restart with it.\n    dtr: false\n"
        f"{_LIMITS_HEAD}{axes}"
    )


def _values(seen: SeenServo) -> dict[str, str | int]:
    return {
        "port": json.dumps(seen.port),
        "baud": seen.servo.baud,
        "id": seen.servo.id,
        "model": seen.servo.model,
        "mode": _NUMBER.get(seen.mode, "position"),
        "position": seen.position,
        # Away from the end of a turn, beyond which mode position does not reach.
        "sign": 1 if seen.position % TICKS_PER_TURN < TICKS_PER_TURN // 2 else -1,
    }


def _camera(found: Seen) -> str:
    if not found.cameras:
        return (
            "  camera:\n    # No camera was found: connect it, and name its path (`rig doctor --discover` lists it).\n"
            f"    driver: opencv\n    source: {_NO_CAMERA}\n"
        )
    camera = found.cameras[0]
    usb = f"    usb_id: {json.dumps(camera.usb_id)}\n" if camera.usb_id else ""
    others = "".join(
        f"    # Another one: {_plain(c.identity)} at {_plain(camera_path(c))}\n" for c in found.cameras[1:]
    )
    return (
        f"  camera:\n    # {_plain(camera.identity)}. Confirm: is this the one on the rig?\n{others}"
        f"    driver: opencv\n    source: {json.dumps(camera_path(camera))}\n{usb}"
        "    # Confirm: set exposure_s so that nothing is over-exposed; what is left out is locked as it is found.\n"
    )


def _axes(gantry: SeenGantry, *, with_pan: bool, with_zoom: bool) -> str:
    lines = [
        "axes:",
        "  # The rig frame: X right, Y down, Z towards the object, as the camera sees it. Until signs and offsets are",
        "  # set it is the machine's own. Confirm: jog each axis, and set sign: -1 where it goes the other way.",
    ]
    lines += [
        f"  {name}_mm: {{lower: {low}, upper: {high}, speed_mm_per_s: {feed / 60.0:.2f}, sign: 1, offset_mm: 0.0}}"
        for name, (low, high, feed) in zip(_AXES, limits_of(gantry), strict=True)
    ]
    if with_pan:
        lines.append("  theta_deg: {lower: -30.0, upper: 30.0, speed_deg_per_s: 10.0, sign: 1, offset_deg: 0.0}")
    if with_zoom:
        lines.append("  # zoom: {lower: 0.0, upper: 1.0, speed_per_s: 0.2}")
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """What a device says of itself, for a comment of one line."""
    return "".join(character if character.isprintable() else " " for character in text)
