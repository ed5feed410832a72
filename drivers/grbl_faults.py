"""What the alarms and errors of GRBL-family controllers mean, whether the position survives, and what to do about them.

Numbers as in GRBL 1.1 and grblHAL; the two agree up to 9, and 10 loses the position in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

UNLOCK = "then unlock (U in `rig jog`)"
HOME_AGAIN = "Clear the cause, then home again (`rig home`)"


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm.

    Attributes:
        meaning: what has happened.
        position_kept: machine coordinates still hold; otherwise only homing helps.
        needs_reset: the controller obeys nothing, not even ``$X``, before a soft reset (0x18).
        remedy: what a person can do.
    """

    meaning: str
    position_kept: bool = False
    needs_reset: bool = False
    remedy: str = HOME_AGAIN


ALARMS: Mapping[int, Alarm] = {
    1: Alarm(
        "a limit switch was hit",
        needs_reset=True,
        remedy="See what the machine has run into, free it, then home again (`rig home`)",
    ),
    2: Alarm(
        "a move would have left the firmware's soft limits",
        position_kept=True,
        needs_reset=True,
        remedy=f"Compare the bench's limits with $130 to $132 (`rig doctor`), {UNLOCK}",
    ),
    3: Alarm("it was reset while moving, and steps may be lost"),
    4: Alarm("the probe was not as expected", position_kept=True, remedy=f"Check the probe, {UNLOCK}"),
    5: Alarm("the probe met nothing", position_kept=True, remedy=f"Check the probe, {UNLOCK}"),
    6: Alarm("homing was interrupted by a reset"),
    7: Alarm("homing was interrupted by the safety door"),
    8: Alarm(
        "homing could not get off the limit switch",
        remedy="Check the switch and its wiring, or raise the pull-off ($27), then home again (`rig home`)",
    ),
    9: Alarm(
        "homing found no limit switch",
        remedy="Check the switches, the axis' direction ($23) and travel ($130 to $132), then home again (`rig home`)",
    ),
    10: Alarm("the emergency stop is pressed, or the second switch of a paired axis was not found", needs_reset=True),
    11: Alarm("it must be homed before it moves", remedy="Home it (`rig home`)"),
    12: Alarm("a limit switch is pressed at start", remedy="Move the axis off its switch by hand, then home again"),
    13: Alarm("the probe protection has tripped", position_kept=True, remedy=f"Check the probe, {UNLOCK}"),
    14: Alarm("the spindle did not come up to speed", position_kept=True, remedy="Switch it off in the settings"),
    15: Alarm("homing did not find the second switch of a paired axis"),
    16: Alarm("its self-test failed", needs_reset=True, remedy="Switch it off and on; if it stays, replace the board"),
    17: Alarm("a motor driver reports a fault", needs_reset=True, remedy="Check motors and drivers, then home again"),
    18: Alarm("homing failed: its settings contradict themselves", remedy="Check $22 to $27 and $44 to $46"),
    19: Alarm("a Modbus device does not answer", position_kept=True, remedy=f"Check the Modbus wiring, {UNLOCK}"),
    20: Alarm("an input/output expander does not answer", remedy="Check its wiring, then switch off and on"),
    21: Alarm("its settings memory failed", needs_reset=True, remedy="Restore the settings, then home again"),
    22: Alarm("a plug-in stopped it", remedy="See the controller's own messages, then home again"),
}

_UNKNOWN = Alarm("an alarm that is not in our table", remedy="See the firmware's manual; then home again (`rig home`)")


def alarm(number: int) -> Alarm:
    """What an alarm means; one that is not known is taken to have cost the position."""
    return ALARMS.get(number, _UNKNOWN)


ERRORS: Mapping[int, str] = {
    1: "a letter was expected",
    2: "a number is malformed",
    3: "no such $ command",
    4: "a number is negative",
    5: "homing is switched off: set $22",
    6: "the step pulse is too short",
    7: "its settings memory could not be read",
    8: "this needs the controller to be idle",
    9: "it is locked: in alarm, or jogging",
    10: "soft limits need homing: set $22",
    11: "the line is too long",
    12: "the step rate is too high",
    13: "the safety door is open",
    14: "the start-up line is too long",
    15: "the jog would leave the machine's travel",
    16: "the jog is malformed",
    17: "laser mode needs PWM",
    20: "a command that it does not know",
    21: "two commands of one modal group",
    22: "no feed rate",
    23: "a whole number was expected",
    24: "two commands that both use the axis words",
    25: "a word is repeated",
    26: "axis words are missing",
    27: "the line number is out of range",
    28: "a value word is missing",
    29: "there is no such coordinate system",
    30: "G53 needs G0 or G1",
    31: "axis words without a command that uses them",
    32: "an arc without axis words in its plane",
    33: "the target cannot be reached so",
    34: "the arc's radius is wrong",
    35: "an arc without offsets",
    36: "words that nothing uses",
    37: "the tool length offset is not for this axis",
    38: "the tool number is too large",
    45: "the emergency stop is pressed",
    46: "it must be homed first",
    79: "it is stopped by a critical alarm until it is reset",
}


def error_text(number: int) -> str:
    """What an error means."""
    return ERRORS.get(number, "an error that is not in our table; see the firmware's manual")
