"""A gantry on a GRBL-family controller (GRBL 1.1, grblHAL, FluidNC): connect, home, move, jog, unlock, stop.

At most one line is outstanding, and none is ever sent twice. A move is done when the controller is idle *and* two
reports agree on a position at the target. Whatever else happens, motion is stopped before an error is raised, unless
the controller is at rest by itself (alarm, restart) or out of reach.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

from drivers.grbl_errors import AlarmError, OutOfStepError, RestartedError, SilentError, StoppedError
from drivers.grbl_identify import identify
from drivers.grbl_moves import check_limits, rounded
from drivers.grbl_recovery import home, unlock
from drivers.grbl_session import GrblSession, Report
from drivers.grbl_settings import GrblSettings
from drivers.grbl_stop import stop_motion
from drivers.grbl_travel import jog, move
from drivers.serial_link import PORT_ERRORS, LinkLostError, SerialLink, SerialPort, not_opened, open_serial
from rig.devices import Clock, GantryStatus, Identity, Motion, StopReport, Triple
from rig.errors import HardwareError, UnreachableError

OpenPort = Callable[[GrblSettings], SerialPort]
Result = TypeVar("Result")

_OPENING_LOOKS, _OPENING_LOOK_S = 200, 0.02

_MOTIONS = {
    "Idle": Motion.IDLE,
    "Run": Motion.MOVING,
    "Jog": Motion.JOGGING,
    "Home": Motion.HOMING,
    "Alarm": Motion.ALARM,
}


def open_settings_port(settings: GrblSettings) -> SerialPort:
    """Open the real port of a bench, alone and locked.

    Raises:
        HardwareError: see `drivers.serial_link.open_serial`.
    """
    return open_serial(settings.port, settings.baud, dtr=settings.dtr)


class GrblGantry:
    """A `rig.devices.LiveGantry`."""

    Settings = GrblSettings

    def __init__(self, settings: GrblSettings, clock: Clock, *, open_port: OpenPort = open_settings_port) -> None:
        """Open nothing yet.

        Args:
            settings: from the bench file.
            clock: monotonic time.
            open_port: opens the port; the bench passes an emulated one where it has no hardware.
        """
        self._settings, self._clock, self._open_port = settings, clock, open_port
        self._lock = threading.RLock()
        self._session: GrblSession | None = None
        self._dead = False

    @property
    def firmware_settings(self) -> Mapping[int, float]:
        """The controller's ``$`` settings as read on connecting, by number; empty before that."""
        return dict(self._session.firmware) if self._session is not None else {}

    def connect(self) -> Identity:
        """Open, lock and identify. Never homes, unlocks, resets or moves; resumes nothing from before."""
        with self._lock:
            self.close()
            # Known from now on, so that a STOP that comes meanwhile goes by this port: no other can be opened.
            session = self._session = self._open()
            try:
                identity = identify(session)
            except StoppedError:
                # Whoever stops is still using the port; closing gives it back.
                self._dead = True
                raise
            except BaseException:
                self._session = None
                session.link.close()
                raise
            trusted = self._settings.homing == "trusted" and not session.restarted and not session.locked
            session.homed = (trusted and not session.unhomed) or self._settings.homing == "none"
            session.restarted, session.trouble = False, ""
            self._dead = False
            return identity

    def status(self) -> GantryStatus:
        """Ask and wait for the answer; of a controller that its alarm has struck mute, tell from memory."""
        with self._lock:
            session = self._ready()
            return self._told(session, self._guarded(session, session.fresh_report))

    @property
    def last_status(self) -> GantryStatus | None:
        """The status as last read, without asking; ``trouble`` says so once it is stale. ``None``: never read."""
        session = self._session
        if session is None or session.latest is None:
            return None
        told = self._told(session, session.latest)
        age_s = self._clock.now_s() - told.read_at_s
        if age_s <= self._settings.stale_s and not self._dead:
            return told
        stale = f"stale: read {age_s:.1f} s ago"
        return replace(told, trouble=f"{stale}; {told.trouble}" if told.trouble else stale)

    def home(self) -> GantryStatus:
        """Home all axes, resetting first where the alarm asks for it; the only way to a known position."""
        with self._lock:
            session = self._ready()
            return self._told(session, self._guarded(session, lambda: home(session)))

    def move_to(self, x_mm: float, y_mm: float, z_mm: float) -> Triple:
        """Move in a straight line; see `LiveGantry`."""
        target = (x_mm, y_mm, z_mm)
        check_limits(target, self._settings.axes)
        with self._lock:
            session = self._ready()
            return self._guarded(session, lambda: move(session, rounded(target)))

    def jog(self, dx_mm: float, dy_mm: float, dz_mm: float) -> Triple:
        """One step relative to the present place; a process that dies meanwhile leaves less than 0.3 s of motion."""
        with self._lock:
            session = self._ready()
            return self._guarded(session, lambda: jog(session, (dx_mm, dy_mm, dz_mm)))

    def unlock(self) -> GantryStatus:
        """Leave an alarm that keeps the position, by reset where needed, then ``$X``; on a person's request only."""
        with self._lock:
            session = self._ready()
            self._guarded(session, lambda: unlock(session))
            return self.status()

    def stop(self) -> StopReport:
        """Stop now, from any thread; where nothing is connected, a port is opened for it. Never raises."""
        for _ in range(_OPENING_LOOKS):
            session = self._session
            if session is not None:
                report = stop_motion(session, self._lock)
                self._dead = self._dead or not report.confirmed
                return report
            # Another thread may be about to open the port, which then nobody else can.
            if self._lock.acquire(timeout=_OPENING_LOOK_S):
                try:
                    if self._session is None:
                        return self._stop_unconnected()
                finally:
                    self._lock.release()
        return _not_sent("another thread is opening the port, and does not come back")

    def close(self) -> None:
        """Release the port; motion that is under way is stopped first, a STOP waited for. Safe to call twice."""
        session = self._session
        if session is None:
            return
        if session.moving and not self._dead:
            stop_motion(session, self._lock)
        alone = self._lock.acquire(timeout=self._settings.deadlines.hold_s)
        try:
            self._session = None
            session.link.close()
        finally:
            if alone:
                self._lock.release()

    def _stop_unconnected(self) -> StopReport:
        try:
            session = self._open()
        except HardwareError as error:
            return _not_sent(str(error))
        report = stop_motion(session, threading.RLock())
        session.link.close()
        return report

    def _open(self) -> GrblSession:
        try:
            port = self._open_port(self._settings)
        except PORT_ERRORS as error:
            raise not_opened(self._settings.port, error) from error
        return GrblSession(SerialLink(port, self._clock, self._settings.port), self._clock, self._settings)

    def _ready(self) -> GrblSession:
        session = self._session
        if session is None:
            raise HardwareError(f"{self._settings.port}: not connected. Connect first")
        if self._dead:
            raise HardwareError(f"{self._settings.port}: the link is dead since its last error. Connect again")
        session.begin()
        return session

    def _told(self, session: GrblSession, report: Report | None) -> GantryStatus:
        motion = Motion.ALARM if report is None else _MOTIONS.get(report.state, Motion.UNKNOWN)
        if report is not None and report.state == "Hold":
            motion = Motion.HELD if report.at_rest else Motion.HOLDING
        trouble = session.trouble
        if session.locked:
            meaning, name = session.describe_alarm()
            trouble = f"{name}: {meaning.meaning}. {meaning.remedy}"
        elif not session.homed and not trouble:
            trouble = "not homed. Home it (`rig home`)"
        return GantryStatus(
            motion,
            report.position_mm if report is not None and session.homed else None,
            session.homed,
            self._clock.now_s() if report is None else report.at_s,
            session.alarm,
            trouble,
        )

    def _guarded(self, session: GrblSession, action: Callable[[], Result]) -> Result:
        """Do something on the wire; what still moves is stopped before any error is passed on, Ctrl-C among them."""
        lines = session.lines
        try:
            return action()
        except (UnreachableError, AlarmError, StoppedError):
            raise  # nothing was sent, it is at rest by itself, or it has been stopped
        except RestartedError:
            if session.lines > lines:
                # It may have restarted before the line reached it, and be doing now what the line says.
                self.stop()
            raise
        except LinkLostError:
            session.homed, self._dead = False, True
            raise
        except BaseException as error:
            if session.moving or isinstance(error, OutOfStepError):
                self.stop()
            elif isinstance(error, SilentError):
                self._dead = True
            raise


def _not_sent(why: str) -> StopReport:
    return StopReport(None, confirmed=False, position_kept=False, trouble=f"STOP could not be sent: {why}")
