"""What tells GRBL 1.1, grblHAL and FluidNC apart on the wire: banner, identity, line length, real-time bytes, quirks.

Seen on GRBL 1.1h and grblHAL firmware in simulation and in their sources (protocol.c of both).
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field


class RealTime(enum.Enum):
    """What a real-time byte asks for."""

    STATUS = "status report"
    FULL_STATUS = "status report with everything in it"
    HOLD = "feed hold"
    RESUME = "cycle start"
    RESET = "soft reset"
    JOG_CANCEL = "jog cancel"
    OVERRIDES_OFF = "feed override 100 %"
    MACRO = "a stored macro"


_COMMON: Mapping[int, RealTime] = {
    ord("?"): RealTime.STATUS,
    ord("!"): RealTime.HOLD,
    ord("~"): RealTime.RESUME,
    0x18: RealTime.RESET,
    0x85: RealTime.JOG_CANCEL,
    0x90: RealTime.OVERRIDES_OFF,
}


@dataclass(frozen=True)
class Dialect:
    """One firmware.

    Attributes:
        name: as `rig.devices.Identity.kind` has it.
        banner: what a start prints.
        identity: the lines that answer ``$I``, before ``ok``.
        line_length: characters that fit a line; longer ones are error:11.
        planner_blocks: moves that fit the planner.
        answers_while_homing: ``?`` is answered during the homing cycle.
        mute_when_critical: after alarm 1 or 2 nothing but 0x18 is answered; otherwise ``$X`` is error:79.
        checks_unhomed_jogs: soft limits hold for jogs of a machine that has not been homed.
        errors_stick: after an error, g-code lines repeat it until a ``$`` line, an empty line or a reset.
        text_in_system_lines: ``?``, ``!`` and ``~`` inside a line that begins with ``$`` are text.
        homing_lock_alarm: the alarm that a start with homing enabled raises; ``None``: locked without a code.
        realtime: bytes that act at once, from anywhere in the stream.
    """

    name: str
    banner: str
    identity: tuple[str, ...]
    line_length: int
    planner_blocks: int
    answers_while_homing: bool = False
    mute_when_critical: bool = True
    checks_unhomed_jogs: bool = True
    errors_stick: bool = False
    text_in_system_lines: bool = False
    homing_lock_alarm: int | None = None
    realtime: Mapping[int, RealTime] = field(default_factory=lambda: dict(_COMMON))


GRBL_1_1 = Dialect(
    name="GRBL",
    banner="Grbl 1.1h ['$' for help]",
    identity=("[VER:1.1h.20190825:]", "[OPT:V,15,128]"),
    line_length=79,
    planner_blocks=15,
)

GRBLHAL = Dialect(
    name="grblHAL",
    banner="GrblHAL 1.1f ['$' or '$HELP' for help]",
    identity=(
        "[VER:1.1f.20240928:]",
        "[OPT:VNMSL,35,1024,3,0]",
        "[NEWOPT:ENUMS,RT+,HOME,TC,SED]",
        "[FIRMWARE:grblHAL]",
        "[DRIVER:Simulator]",
    ),
    line_length=256,
    planner_blocks=35,
    mute_when_critical=False,
    checks_unhomed_jogs=False,
    errors_stick=True,
    text_in_system_lines=True,
    homing_lock_alarm=11,
    realtime={
        **_COMMON,
        0x80: RealTime.STATUS,
        0x81: RealTime.RESUME,
        0x82: RealTime.HOLD,
        0x87: RealTime.FULL_STATUS,
    },
)

FLUIDNC = Dialect(
    name="FluidNC",
    banner="Grbl 3.7 [FluidNC v3.7.8 (noradio) '$' for help]",
    identity=("[VER:3.7 FluidNC v3.7.8 (noradio):]", "[OPT:MPHS]", "[MSG:Machine: bench]"),
    line_length=255,
    planner_blocks=16,
    answers_while_homing=True,
    mute_when_critical=False,
    realtime={**_COMMON, **dict.fromkeys(range(0x87, 0x8B), RealTime.MACRO)},
)

DIALECTS: Mapping[str, Dialect] = {dialect.name: dialect for dialect in (GRBL_1_1, GRBLHAL, FLUIDNC)}
