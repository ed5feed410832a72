"""STOP for a GRBL-family controller: ``!`` at once, wait until it is held, then 0x18; a time-out resets regardless.

A reset in motion would lose the position, a hold alone would leave moves in the buffer: so both, in this order. What
is left is a controller at rest with empty buffers, of which it is known which answer belongs to which line.
"""

from __future__ import annotations

import threading

from drivers.grbl_errors import AlarmError, OutOfStepError, RestartedError, SilentError
from drivers.grbl_session import GrblSession
from rig.devices import StopReport
from rig.errors import HardwareError

_HOLD = b"!"
_HOLD_GRBLHAL = b"\x82"
"""grblHAL takes ``!`` for text inside an unfinished line that begins with ``$``, but never this."""
_RESETS = 2


def stop_motion(session: GrblSession, lock: threading.RLock) -> StopReport:
    """Stop; may be called from any thread, and while the lock is held by another. Never raises.

    Args:
        session: of the controller; whoever uses it gives up at its next look.
        lock: held by whoever talks to the controller.
    """
    session.stops += 1
    try:
        session.link.write(_HOLD)
        sent_at_s = session.clock.now_s()
        if session.kind == "grblHAL":
            session.link.write(_HOLD_GRBLHAL)
    except HardwareError as error:
        session.homed = False
        return StopReport(None, confirmed=False, position_kept=False, trouble=f"STOP could not be sent: {error}")
    if not _have(lock, session):
        return _reset_blindly(session, sent_at_s)
    before = session.begin()
    session.stopping = True
    try:
        return _hold_then_reset(session, sent_at_s)
    except HardwareError as error:
        session.homed = False
        return StopReport(sent_at_s, confirmed=False, position_kept=False, trouble=f"not confirmed: {error}")
    finally:
        session.stopping = False
        session.resume(before)
        lock.release()


def _have(lock: threading.RLock, session: GrblSession) -> bool:
    """Take the lock. Another STOP that has it is waited for, as it may brake for longer than a command looks away."""
    while not lock.acquire(timeout=session.settings.deadlines.hold_s):
        if not session.stopping:
            return False
    return True


def _reset_blindly(session: GrblSession, sent_at_s: float) -> StopReport:
    """Somebody holds the lock and does not let go: there is nothing to wait for."""
    session.homed = False
    try:
        session.link.write(b"\x18")
    except HardwareError as error:
        return StopReport(
            sent_at_s, confirmed=False, position_kept=False, trouble=f"the reset could not be sent: {error}"
        )
    trouble = "sent, but not confirmed: another thread does not let go of the port. Connect and home again"
    return StopReport(sent_at_s, confirmed=False, position_kept=False, trouble=trouble)


def _hold_then_reset(session: GrblSession, sent_at_s: float) -> StopReport:
    session.moving = True  # until it is seen at rest the position may change
    rested = session.mute or _wait_for_rest(session)
    if not rested:
        session.homed = False
    alive = any(_reset_seen(session) for _ in range(_RESETS))
    if not alive:
        session.homed = False
    session.moving = False
    session.forget_position()
    troubles = [
        "" if rested else "it was not seen to come to rest before the reset: the position is lost",
        "" if alive else "the reset was not answered: motion may go on. Switch its power off",
    ]
    return StopReport(sent_at_s, alive, session.homed, "; ".join(filter(None, troubles)))


def _wait_for_rest(session: GrblSession) -> bool:
    deadline_s = session.clock.now_s() + session.settings.deadlines.hold_s
    while session.clock.now_s() < deadline_s:
        try:
            report = session.report(tries=1)
        except (SilentError, OutOfStepError):
            continue
        except (AlarmError, RestartedError):
            return True
        if report.at_rest:
            return True
        if report.state == "Home":
            return False  # homing heeds no hold, only the reset
    return False


def _reset_seen(session: GrblSession) -> bool:
    """Reset; the banner, or a state that only a reset leads to, shows that it has happened."""
    if session.reset():
        return True
    try:
        return session.report().state in ("Idle", "Alarm")
    except AlarmError:
        return True
    except HardwareError:
        return False
