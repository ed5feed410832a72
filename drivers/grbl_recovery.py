"""Ways back to a known position: homing, and unlocking after an alarm that has kept it; on a person's request only."""

from __future__ import annotations

from dataclasses import replace

from drivers.grbl_errors import SilentError
from drivers.grbl_faults import alarm
from drivers.grbl_session import GrblSession, Report
from rig.errors import HardwareError

_DOUBLED_S = 0.5
"""After so long a second homing would be seen to run."""


def home(session: GrblSession) -> Report:
    """Home all axes, resetting first where the alarm asks for it.

    Raises:
        HardwareError: it moves or is held, or homing failed; the position is then unknown.
    """
    where = session.link.where
    if session.locked and session.alarm is not None and alarm(session.alarm).needs_reset:
        _reset(session)
    before = session.fresh_report()
    if before is not None and before.state not in ("Idle", "Alarm"):
        raise HardwareError(f"{where}: in state {before.state}. Stop it (`rig stop`), then home")
    session.homed, session.moving = False, True
    session.trouble = "homing has not been completed: home it again"
    began_s = session.clock.now_s()
    session.command("$H", session.settings.deadlines.home_s)
    if session.clock.now_s() - began_s < _shortest_homing_s(session):
        raise HardwareError(
            f"{where}: homing was answered sooner than it can be done; the command was garbled on its way. "
            "Check the cable, then home again"
        )
    # Of a line that was doubled on its way the second one homes again, or is answered a second time.
    session.listen(_DOUBLED_S)
    session.forget_position()
    report = session.report()
    if report.state != "Idle":
        raise HardwareError(f"{where}: in state {report.state} after homing. Home again")
    session.moving, session.homed, session.trouble = False, True, ""
    return report


def unlock(session: GrblSession) -> None:
    """Leave an alarm that has kept the position; a controller that is not in alarm is left as it is.

    Raises:
        HardwareError: the alarm has cost the position: home instead.
    """
    if not session.mute:
        session.fresh_report()
    if not session.locked:
        return
    meaning, name = session.describe_alarm()
    if session.settings.homing == "none" and session.alarm is None:
        # A machine that cannot home is locked without a number by a start only; its coordinates begin anew then.
        meaning = replace(meaning, position_kept=True)
    if not meaning.position_kept:
        raise HardwareError(
            f"{session.link.where}: {name}: {meaning.meaning}; its position is lost, so that it cannot just be "
            f"unlocked. {meaning.remedy}"
        )
    if meaning.needs_reset:
        _reset(session)
    session.command("$X", session.settings.deadlines.reply_s)
    session.report()


def _reset(session: GrblSession) -> None:
    if not session.reset():
        raise SilentError(f"{session.link.where}: no answer to a reset. Switch its power off and on, then connect")


def _shortest_homing_s(session: GrblSession) -> float:
    """Half the time of one slow pull-off ($27 at $24): no homing is faster, a ``$H`` garbled into something else is."""
    return 0.5 * 60.0 * session.firmware.get(27, 0.0) / max(session.firmware.get(24, 1.0), 1e-3)
