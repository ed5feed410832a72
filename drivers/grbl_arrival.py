"""Waits until a move is done: idle, and two reports agreeing on a position within tolerance of the target.

``ok`` only means that a line was buffered, and an ``Idle`` may have been reported before motion began. So position
decides; where the start itself lies within tolerance of the target, time must pass between the two reports.
"""

from __future__ import annotations

import math

from drivers import grbl_moves as moves
from drivers.grbl_session import GrblSession, Report
from drivers.not_arrived import NotArrivedError
from rig.devices import Triple

CONFIRM_S = 0.1
"""Longer than any controller takes between ``ok`` and the first step."""
_QUICK_LOOK_S = 0.01
_LONGEST_LOOK_S = 0.2
_OFF_PATH_MM = 1.0


def wait_arrival(session: GrblSession, start: Triple, target: Triple, feed_mm_per_min: float) -> Triple:
    """Wait for the end of a move that was acknowledged; returns the position read back.

    Raises:
        NotArrivedError: it stands elsewhere, leaves its path, makes no progress, or takes far too long.
        HardwareError: see `GrblSession.report`.
    """
    feed = moves.firmware_feed(start, target, feed_mm_per_min, session.firmware)
    accel = moves.path_accel(start, target, session.firmware)
    expected_s = moves.duration_s(math.dist(start, target), feed, accel)
    watch = _Watch(session, start, target, expected_s)
    while True:
        report = session.report()
        if watch.arrived(report):
            session.moving = False
            return report.position_mm
        session.listen(watch.pause_s(report))


class _Watch:
    """What the reports of one move have shown so far."""

    def __init__(self, session: GrblSession, start: Triple, target: Triple, expected_s: float) -> None:
        self._session, self._start, self._target = session, start, target
        self._expected_s, self._began_s = expected_s, session.clock.now_s()
        self._tolerance_mm = session.settings.tolerance_mm
        self._nowhere_to_go = moves.apart_mm(start, target) <= self._tolerance_mm
        self._ran = False
        self._progress: Report | None = None
        self._resting: Report | None = None
        self._off_path = 0

    def arrived(self, report: Report) -> bool:
        """Whether this report shows that the move is done."""
        self._check_progress(report)
        if report.state in ("Run", "Jog"):
            self._ran, self._resting = True, None
            return False
        if report.state != "Idle":
            raise self._failed(report, f"the controller went into state {report.state}")
        first, self._resting = self._resting, report
        if first is None or moves.apart_mm(first.position_mm, report.position_mm) > 1e-6:
            return False
        if moves.apart_mm(report.position_mm, self._target) <= self._tolerance_mm:
            # Keep the first of the agreeing reports: the wait counts from there.
            self._resting = first
            return self._ran or not self._nowhere_to_go or report.at_s - first.at_s >= CONFIRM_S
        if self._ran or report.at_s - self._began_s >= self._session.settings.deadlines.stall_s:
            raise self._failed(report, "it came to rest elsewhere")
        return False

    def pause_s(self, report: Report) -> float:
        """How long to wait before the next look: half of what is left to travel."""
        if report.state == "Idle":
            there = moves.apart_mm(report.position_mm, self._target) <= self._tolerance_mm
            return 0.0 if there and not self._nowhere_to_go else _QUICK_LOOK_S
        left_s = self._expected_s - (report.at_s - self._began_s)
        return min(max(left_s / 2.0, _QUICK_LOOK_S), _LONGEST_LOOK_S)

    def _check_progress(self, report: Report) -> None:
        stall_s = self._session.settings.deadlines.stall_s
        if self._progress is None or moves.apart_mm(self._progress.position_mm, report.position_mm) > 1e-6:
            self._progress = report
        elif report.at_s - self._progress.at_s > stall_s:
            raise self._failed(report, f"it made no progress for {stall_s:g} s")
        if report.at_s - self._began_s > 3.0 * self._expected_s + 2.0 * stall_s:
            raise self._failed(report, "it takes far longer than it should")
        off_mm = moves.off_path_mm(self._start, self._target, report.position_mm)
        self._off_path = self._off_path + 1 if off_mm > _OFF_PATH_MM + self._tolerance_mm else 0
        if self._off_path >= 2:
            raise self._failed(report, f"it left the straight path by {off_mm:.1f} mm")

    def _failed(self, report: Report, what: str) -> NotArrivedError:
        return NotArrivedError(self._session.link.where, what, self._target, report.position_mm)
