"""A conversation with a connected GRBL-family controller: lines and their answers, status reports that can be trusted.

It keeps what is known (homed, alarm, position) and raises when something unasked for happens: an alarm, a restart, an
answer too many, silence. No line is repeated, only ``?`` asked again. Between reads it gives up if a STOP was called.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.grbl_errors import AlarmError, OutOfStepError, RefusedError, RestartedError, SilentError, StoppedError
from drivers.grbl_faults import Alarm, alarm, error_text
from drivers.grbl_moves import apart_mm
from drivers.grbl_replies import AlarmLine, Banner, Garbage, Ok, Refused, Reply, StatusReport, Triple, parse_reply
from drivers.grbl_settings import GrblSettings
from drivers.serial_link import SerialLink
from rig.devices import Clock

_LOOK_S = 0.05
_STATUS_TRIES = 4
_STATUS_ASKS = 40
_STILL_MM = 0.01
_SLACK_MM = 0.5


@dataclass(frozen=True, slots=True)
class Report:
    """A status report that fits what was known before; ``position_mm`` is in machine coordinates."""

    state: str
    substate: int | None
    position_mm: Triple
    at_s: float

    @property
    def at_rest(self) -> bool:
        """Nothing moves, and nothing will without being told."""
        return self.state in ("Idle", "Alarm", "Check", "Sleep") or (self.state == "Hold" and self.substate == 0)


class GrblSession:
    """One controller on one open link.

    Attributes:
        kind, version: the firmware, once identified.
        firmware: its ``$`` settings, as read on connecting.
        homed: its machine coordinates mean something.
        locked, alarm: it is in alarm, and the alarm's number where that is known.
        trouble: what a person should know; empty where nothing is wrong.
        moving: motion has been commanded and not been seen to end.
        latest: the last report that could be trusted.
        unhomed: it has said itself that it is not homed (grblHAL's ``H:0``).
        stops: how many STOPs there have been.
        stopping: a STOP is being carried out; it heeds no other one.
        lines: how many lines have been written.
    """

    def __init__(self, link: SerialLink, clock: Clock, settings: GrblSettings) -> None:
        self.link, self.clock, self.settings = link, clock, settings
        self.kind = self.version = self.trouble = ""
        self.firmware: dict[int, float] = {}
        self.homed = self.locked = self.moving = self.restarted = self.unhomed = False
        self.alarm: int | None = None
        self.latest: Report | None = None
        self.stops = self._stops_allowed = self.lines = 0
        self.stopping = False
        self._offset: Triple | None = None
        self._offset_doubt: Triple | None = None
        self._doubt: Report | None = None
        self._awaiting_banner = self._silenced = False

    def begin(self) -> int:
        """An operation begins: STOPs from before do not concern it. Returns what `resume` takes."""
        before, self._stops_allowed = self._stops_allowed, self.stops
        return before

    def resume(self, before: int) -> None:
        """The operation that was interrupted by a STOP goes on: to its end, since it is told at its next look."""
        self._stops_allowed = before

    def forget_position(self) -> None:
        """The next report is taken only once a second one agrees with it."""
        self.latest = self._doubt = self._offset = self._offset_doubt = None

    def next_reply(self, deadline_s: float) -> Reply | None:
        """The next line that comes, its consequences noted; ``None`` by the deadline."""
        while True:
            if self.stops != self._stops_allowed and not self.stopping:
                raise StoppedError(f"{self.link.where}: stopped by STOP. Release it before moving again")
            line = self.link.read_line(min(deadline_s, self.clock.now_s() + _LOOK_S))
            if line:
                reply = parse_reply(line)
                if isinstance(reply, AlarmLine):
                    self._note_alarm(reply.number)
                elif isinstance(reply, Banner):
                    self._note_banner()
                elif isinstance(reply, StatusReport) and reply.homed is not None:
                    # Told once, and then only when it changes: so it is noted of whatever report.
                    self.unhomed = not reply.homed
                    self.homed = self.homed and reply.homed
                return reply
            if line is None and self.clock.now_s() >= deadline_s:
                return None

    def listen(self, seconds: float) -> None:
        """Wait, and raise if anything comes that nobody asked for; status reports and noise are dropped."""
        deadline_s = self.clock.now_s() + seconds
        while (reply := self.next_reply(deadline_s)) is not None:
            self._raise_if_unasked(reply)

    def command(self, line: str, seconds: float) -> list[Reply]:
        """Send a line, once, and wait for its ``ok``; returns what came before that.

        Raises:
            RefusedError: ``error:n``.
            AlarmError, RestartedError, OutOfStepError, SilentError, StoppedError: as their names say.
            LinkLostError: the port is gone.
        """
        self.listen(0.0)
        self.lines += 1
        self.link.write(line.encode("ascii") + b"\n")
        deadline_s = self.clock.now_s() + seconds
        replies: list[Reply] = []
        while (reply := self.next_reply(deadline_s)) is not None:
            if isinstance(reply, Ok):
                return replies
            if isinstance(reply, Refused):
                text = error_text(reply.number)
                raise RefusedError(f"{self.link.where}: {line!r} was refused, error:{reply.number}: {text}")
            self._raise_if_unasked(reply)
            replies.append(reply)
        raise SilentError(
            f"{self.link.where}: no answer to {line!r} within {seconds:g} s. Check the cable; nothing was sent again"
        )

    def report(self, tries: int = _STATUS_TRIES) -> Report:
        """Ask for the status until an answer can be trusted.

        A garbled answer is dropped; a position that cannot have been reached since the last one, or the first of all,
        is taken only once a second one agrees.

        Raises:
            SilentError: no valid answer, asked so many times.
            AlarmError, RestartedError, OutOfStepError, StoppedError, LinkLostError: as their names say.
        """
        self.listen(0.0)
        silent = 0
        for _ in range(_STATUS_ASKS):
            self.link.write(b"?")
            status = self._await_status(self.clock.now_s() + self.settings.deadlines.status_s)
            if status is None:
                silent += 1
                if silent >= tries:
                    break
            elif (report := self._judge(status)) is not None:
                return report
        raise SilentError(f"{self.link.where}: no valid status report. Check cable and power, then connect again")

    def fresh_report(self) -> Report | None:
        """A report, alarms and restarts that come before it only being noted; ``None`` of a mute controller.

        Raises:
            SilentError, OutOfStepError, StoppedError, LinkLostError: as `report`.
        """
        for _ in range(_STATUS_TRIES):
            try:
                if self.mute:
                    self._drain()
                if self.mute:
                    return None
                return self.report()
            except (AlarmError, RestartedError):
                continue
        raise SilentError(f"{self.link.where}: alarms and restarts without end. Switch its power off and on")

    def reset(self) -> bool:
        """Send 0x18 and wait for the banner; True if it came. A banner from before is none: it tells of a restart."""
        self._drain()
        self._awaiting_banner = True
        self.link.write(b"\x18")
        deadline_s = self.clock.now_s() + self.settings.deadlines.reset_s
        while self._awaiting_banner and self.next_reply(deadline_s) is not None:
            continue
        came, self._awaiting_banner = not self._awaiting_banner, False
        self.moving = False
        self.forget_position()
        return came

    def describe_alarm(self) -> tuple[Alarm, str]:
        """The alarm that it is in, and how to name it."""
        if self.alarm is None:
            return Alarm("the controller is locked"), "ALARM"
        return alarm(self.alarm), f"ALARM:{self.alarm}"

    def alarm_error(self) -> AlarmError:
        """The alarm that it is in, as an error that tells the remedy."""
        meaning, name = self.describe_alarm()
        return AlarmError(f"{self.link.where}: {name}: {meaning.meaning}. {meaning.remedy}")

    @property
    def mute(self) -> bool:
        """GRBL after alarm 1 or 2: it answers nothing before a reset."""
        return self.kind == "GRBL" and self._silenced

    def _drain(self) -> None:
        """Note what has come by now, and answer to none of it."""
        while self.next_reply(self.clock.now_s()) is not None:
            continue

    def _await_status(self, deadline_s: float) -> StatusReport | None:
        while (reply := self.next_reply(deadline_s)) is not None:
            if isinstance(reply, StatusReport):
                return reply.in_mm() if self.firmware.get(13) else reply
            self._raise_if_unasked(reply)
            if isinstance(reply, Garbage):
                return None  # most likely the answer, garbled
        return None

    def _raise_if_unasked(self, reply: Reply) -> None:
        where = self.link.where
        if isinstance(reply, AlarmLine):
            raise self.alarm_error()
        if isinstance(reply, Banner) and not self._awaiting_banner:
            raise RestartedError(f"{where}: the controller has restarted. Its position is lost: home it (`rig home`)")
        if isinstance(reply, Ok | Refused) and not self.locked:  # an alarm may come before the line's own answer
            raise OutOfStepError(f"{where}: an answer came that nothing had asked for. Check the cable's shielding")

    def _note_alarm(self, number: int) -> None:
        self.alarm, self.locked, self.moving = number, True, False
        self._silenced = number in (1, 2)
        self.homed = self.homed and alarm(number).position_kept
        self.forget_position()

    def _note_banner(self) -> None:
        self.forget_position()
        self.moving = self._silenced = False
        if self._awaiting_banner:
            self._awaiting_banner = False
        else:
            self.homed, self.alarm, self.restarted = False, None, True
            self.trouble = "the controller has restarted: home it again"

    def _judge(self, status: StatusReport) -> Report | None:
        """A status as a report, or ``None`` where it cannot be trusted yet."""
        if not self._offset_is_sure(status.offset):
            return None
        place = status.position(self._offset)
        if place is None:
            return None
        report = Report(status.state, status.substate, place, self.clock.now_s())
        known = self.latest is not None
        if not self._plausible(report):
            return None
        if known and self._doubt is not None and not self._within_reach(self.latest, report):
            # Two reports agree on a place that it cannot have come to: it has begun to count anew.
            self.homed, self.trouble = False, "the position jumped: home it again"
        self._note_state(report)
        return report

    def _offset_is_sure(self, offset: Triple | None) -> bool:
        """Nobody changes the offset but a restart: a new one counts once it has been told twice."""
        if offset is None or offset == self._offset:
            return True
        sure = self._offset is None or offset == self._offset_doubt
        if sure:
            self._offset = offset
        self._offset_doubt = offset
        return sure

    def _plausible(self, report: Report) -> bool:
        if self._within_reach(self.latest, report) or self._within_reach(self._doubt, report):
            return True
        self._doubt = report
        return False

    def _within_reach(self, before: Report | None, report: Report) -> bool:
        if before is None:
            return False
        return apart_mm(before.position_mm, report.position_mm) <= self._reach_mm(before, report)

    def _reach_mm(self, before: Report, report: Report) -> float:
        if not self.moving:
            return _STILL_MM
        fastest = max(axis.feed_mm_per_min for axis in self.settings.axes) / 60.0
        return _SLACK_MM + 1.5 * fastest * (report.at_s - before.at_s)

    def _note_state(self, report: Report) -> None:
        moved_mm = 0.0 if self.latest is None else apart_mm(self.latest.position_mm, report.position_mm)
        if not self.moving and moved_mm > self.settings.tolerance_mm:
            self.homed = False
            self.trouble = "the position changed without a command: home it again"
        self.latest, self._doubt = report, None
        self.locked = report.state == "Alarm"
        if self.locked:
            self.alarm = self.alarm if report.substate is None else report.substate
            self.homed = self.homed and self.alarm is not None and alarm(self.alarm).position_kept
        else:
            self.alarm = None
