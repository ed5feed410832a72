"""What servos may answer, or not, and how people are told."""

from __future__ import annotations

from rig.errors import HardwareError

_REFUSALS = {
    1: "the servo could not do it",
    2: "unknown instruction",
    4: "value out of range, or its bus watchdog has tripped",
    5: "wrong length",
    6: "value beyond the servo's own limits",
    7: "no access: the register is read-only, or locked while torque is on",
}


class NoAnswerError(HardwareError):
    """A servo does not answer, or not in a way that can be read."""


class RefusedError(HardwareError):
    """A servo has answered that it will not do it."""


def refusal(error: int) -> str:
    """What an error code of a status packet means."""
    return _REFUSALS.get(error, f"error {error}")


def silence_of(servo_id: int, heard: bytes = b"") -> str:
    """That a servo does not answer, and what to look at; ``heard`` is what came instead."""
    text = f"servo {servo_id} does not answer. "
    words = heard.decode("ascii", "replace").lower()
    if any(word in words for word in ("grbl", "fluidnc", "error:", "ok\r")):
        return text + "A gantry controller does: are the ports of gantry and servos swapped in the bench file?"
    if heard:
        return text + "Something else was heard: check the baud rate, and that no other device is on this port"
    return text + "Check power, cable, id and baud rate, and that this is the port of the servos"
