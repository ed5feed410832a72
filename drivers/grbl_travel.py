"""Moves and jogs of a connected gantry: what is sent, one line at a time, each waited for to its end."""

from __future__ import annotations

from drivers import grbl_moves as moves
from drivers.grbl_arrival import wait_arrival
from drivers.grbl_session import GrblSession, Report
from rig.devices import Triple
from rig.errors import HardwareError, UnreachableError


def move(session: GrblSession, target: Triple) -> Triple:
    """Move to a place in a straight line; returns the position read back.

    Args:
        session: of the controller.
        target: machine coordinates, mm.

    Raises:
        UnreachableError: outside the limits. Nothing was sent.
        HardwareError: not homed, not idle, or the move failed.
    """
    place = _idle(session).position_mm
    if not session.homed:
        raise HardwareError(f"{session.link.where}: not homed, so that its position means nothing. Home (`rig home`)")
    axes = session.settings.axes
    feed = moves.path_feed(place, target, axes)
    return _send(session, moves.move_line(target, feed, axes), place, target, feed)


def jog(session: GrblSession, step: Triple) -> Triple:
    """One step from where it stands, in segments of which only one is ever outstanding; returns as `move`.

    A process that dies leaves no more than one segment to be done.

    Raises:
        UnreachableError: outside the limits, or too long for a gantry that is not homed. Nothing was sent.
        HardwareError: not idle, or the step failed.
    """
    place = _idle(session).position_mm
    target = moves.rounded((place[0] + step[0], place[1] + step[1], place[2] + step[2]))
    axes = session.settings.axes
    limits = axes if session.homed else None
    if limits is None:
        _check_unhomed_step(session, step)
    else:
        moves.check_limits(target, limits)
    feed = moves.path_feed(place, target, axes)
    accel = moves.path_accel(place, target, session.firmware)
    longest = moves.segment_mm(moves.firmware_feed(place, target, feed, session.firmware), accel)
    for end in moves.jog_targets(place, target, longest):
        place = _send(session, moves.jog_line(end, feed, limits), place, end, feed)
    return place


def _send(session: GrblSession, line: str, start: Triple, target: Triple, feed_mm_per_min: float) -> Triple:
    session.moving = True
    session.command(line, session.settings.deadlines.reply_s)
    return wait_arrival(session, start, target, feed_mm_per_min)


def _idle(session: GrblSession) -> Report:
    """A fresh report of a controller that can be moved."""
    if session.mute:
        raise session.alarm_error()
    report = session.report()
    if session.locked:
        raise session.alarm_error()
    if report.state != "Idle":
        raise HardwareError(
            f"{session.link.where}: the controller is in state {report.state}, not Idle. Stop it (`rig stop`) first"
        )
    return report


def _check_unhomed_step(session: GrblSession, step: Triple) -> None:
    longest = session.settings.unhomed_jog_mm
    if not sum(d * d for d in step) <= longest**2:  # so that NaN is refused too
        raise UnreachableError(
            f"{session.link.where}: a jog by {step} mm while not homed; the bench allows {longest:g} mm "
            "(unhomed_jog_mm). Home it first (`rig home`)"
        )
