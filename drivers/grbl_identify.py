"""Finds out who answers at the other end, without homing, unlocking, resetting or moving anything.

Only ``?``, ``$I``, ``$$`` and the real-time byte that sets the feed override back to 100 % are sent. ``$I`` also ends
a line that a program before us may have left unfinished: no such line, with ``$I`` behind it, is one that moves.
"""

from __future__ import annotations

import re

from drivers.grbl_errors import RefusedError, SilentError
from drivers.grbl_replies import Garbage, Message, Reply, Setting, StatusReport
from drivers.grbl_session import GrblSession
from rig.devices import Identity
from rig.errors import HardwareError

_ASK_EVERY_S = 0.5
_FEED_OVERRIDE_OFF = b"\x90"
_SERVO_HEADER = b"\xff\xff\xfd\x00"


def identify(session: GrblSession) -> Identity:
    """Wait for a sign of life, identify the firmware and read its settings.

    Raises:
        HardwareError: nothing answers, what answers is no GRBL, it is moving or paused, or its firmware is unknown.
    """
    _wait_for_life(session)
    _wait_for_rest(session)
    replies = _ask_name(session)
    kind, version = firmware_of(replies)
    if not kind:
        texts = ", ".join(reply.text for reply in replies if isinstance(reply, Message)) or "nothing"
        raise HardwareError(
            f"{session.link.where}: no GRBL 1.1, grblHAL or FluidNC; $I answered {texts}. Check the port"
        )
    session.kind, session.version = kind, version
    session.firmware = _read_settings(session)
    session.link.write(_FEED_OVERRIDE_OFF)
    session.forget_position()  # reports so far may have been in inches
    session.report()
    return Identity(kind, version, session.link.where)


def firmware_of(replies: list[Reply]) -> tuple[str, str]:
    """Kind and version from the answer to ``$I``; empty where it is none that we know."""
    texts = [reply.text for reply in replies if isinstance(reply, Message)]
    version = next((text[4:].rstrip(":") for text in texts if text.startswith("VER:")), "")
    if "FluidNC" in version:
        return "FluidNC", version
    if any(text.startswith("FIRMWARE:grblHAL") for text in texts):
        return "grblHAL", version
    if re.match(r"1\.1[a-z]", version):
        return "GRBL", version
    return "", ""


def _wait_for_life(session: GrblSession) -> None:
    """Ask for the status until a valid one comes; the port's opening may have restarted the board."""
    clock, where = session.clock, session.link.where
    deadline_s = clock.now_s() + session.settings.deadlines.connect_s
    while clock.now_s() < deadline_s:
        session.link.write(b"?")
        listen_until_s = min(deadline_s, clock.now_s() + _ASK_EVERY_S)
        while (reply := session.next_reply(listen_until_s)) is not None:
            if isinstance(reply, StatusReport):
                return
    if _SERVO_HEADER in session.link.last_bytes:
        raise HardwareError(f"{where}: a Dynamixel bus answers here. The ports of gantry and servos are swapped")
    if session.link.last_bytes.strip():
        raise HardwareError(
            f"{where}: what answers is no GRBL. Check the baud rate, and that this is the gantry's port"
        )
    raise HardwareError(
        f"{where}: nothing answers. Check that the controller has power and that gantry and servo ports are not "
        "swapped; one that has met a limit answers only after a reset (`rig stop`, or its own button)"
    )


def _wait_for_rest(session: GrblSession) -> None:
    """Its settings can only be read at rest; what moves is left alone."""
    deadline_s = session.clock.now_s() + session.settings.deadlines.connect_s
    while True:
        session.moving = True  # somebody else may be moving it: positions may change
        report = session.fresh_report()
        session.moving = False
        if report is None:
            return
        if report.state in ("Idle", "Alarm"):
            return
        if report.state not in ("Run", "Jog", "Home") or session.clock.now_s() >= deadline_s:
            raise HardwareError(
                f"{session.link.where}: the controller is in state {report.state}, which is not ours to end. "
                "Wait until it is done, or stop it (`rig stop`)"
            )
        session.listen(0.2)


def _ask_name(session: GrblSession) -> list[Reply]:
    reply_s = session.settings.deadlines.reply_s
    try:
        return session.command("$I", reply_s)
    except RefusedError:  # it ended somebody's unfinished line
        return session.command("$I", reply_s)


def _read_settings(session: GrblSession) -> dict[int, float]:
    """``$$``; read again until two readings agree, since a garbled travel or unit would mislead everything after."""
    before: dict[int, float] | None = None
    for _ in range(4):
        replies = session.command("$$", session.settings.deadlines.reply_s)
        found = {reply.number: reply.value for reply in replies if isinstance(reply, Setting)}
        if found == before and not any(isinstance(reply, Garbage) for reply in replies):
            return found
        before = found
    raise SilentError(f"{session.link.where}: its settings ($$) read differently each time. Check the cable")
