"""The emulated controller: bytes in, bytes out, a planner and a machine, all driven by the time that it is told.

It follows GRBL's own shape. Bytes arrive as by interrupt: real-time bytes act at once, the others wait in a buffer of
128. A main loop, here a generator that yields wherever the firmware would wait, reads lines from the buffer and obeys
them. Motion goes on beside it. Nothing sleeps and there are no threads: only `receive` and `advance_to` pass time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Mapping

from sim_backends.faults import Fault, FaultKind, WireByte
from sim_backends.grbl_emulator import program, realtime, report
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH, Eeprom, Triple
from sim_backends.grbl_emulator.gcode import Modal
from sim_backends.grbl_emulator.mechanics import Mechanics, switches_of
from sim_backends.grbl_emulator.monitor import Monitor
from sim_backends.grbl_emulator.planner import MachineLimits, Planner
from sim_backends.grbl_emulator.states import State

BOOT_S = 0.3
FOR_GOOD_S = 1e9
_NO_ALARM: int | None = None
POSITION_LOST = frozenset({1, 3, 6, 7, 8, 9, 10})
CRITICAL = frozenset({1, 2})

Waiting = Generator[None, None, None]


class GrblMachine:
    """One controller with its machine.

    Attributes:
        homed: machine coordinates are right, as the machine itself knows; the wire does not tell.
        state, alarm: as reported; ``alarm`` is the last alarm's number while it lasts.
        mechanics: where the carriages really are.
    """

    def __init__(
        self,
        dialect: Dialect = GRBL_1_1,
        *,
        settings: Mapping[int, float] = BENCH,
        mechanics: Mechanics | None = None,
        monitor: Monitor | None = None,
        start_delay_s: float = 0.0,
        lag_s: float = 0.0,
    ) -> None:
        """Switch it on at time 0.

        Args:
            dialect: the firmware.
            settings: the EEPROM.
            mechanics: the machine; one that fits the settings where not told.
            monitor: judges every byte that arrives.
            start_delay_s: between ``ok`` and the motion's beginning; reports say ``Idle`` meanwhile.
            lag_s: how long a line takes to be obeyed.
        """
        self.dialect, self.eeprom, self.monitor = dialect, Eeprom(settings), monitor
        self.mechanics = mechanics or Mechanics(switches_of(self.eeprom.axes(130), int(self.eeprom[23])))
        self.planner = Planner(lambda move, along: self.mechanics.along_at_switch(move.start, move.unit, along))
        self.start_delay_s, self.lag_s = start_delay_s, lag_s
        self.now_s = 0.0
        self.homed = self.critical = self.may_start = False
        self.line_open = self.system_line = self.asked_while_homing = False
        self.state, self.alarm, self.last_error = State.IDLE, _NO_ALARM, 0
        self.modal, self.reports = Modal(), report.Counters()
        self.loop: Waiting = program.dead_loop()
        self.rx: deque[int] = deque()
        self._out: list[tuple[float, bytes]] = []
        self.timers: dict[str, float] = {}
        self._stuck_until: dict[int, float] = {}
        self.power_up()

    def receive(self, byte: WireByte) -> None:
        """A byte arrives; time must have been advanced to its arrival."""
        if self.off or self.hung:
            return
        if self.monitor is not None:
            self.monitor.observe(byte, self)
        if "deaf" not in self.timers:  # writing the EEPROM
            realtime.receive(self, byte.value)
            self.run_main()

    def apply_fault(self, fault: Fault) -> None:
        """A fault of the device strikes now."""
        match fault.kind:
            case FaultKind.BANNER:
                self.power_up()
            case FaultKind.POWER_CYCLE:
                self.power_up(off_s=max(fault.seconds, BOOT_S))
            case FaultKind.ALARM if not self.off:
                self.raise_alarm(fault.number)
            case FaultKind.HANG if not self.off:
                self.timers["hung"] = self.now_s + (fault.seconds or FOR_GOOD_S)
            case FaultKind.STUCK_AXIS:
                self.mechanics.follow(self.planner.position)
                self.mechanics.axes[fault.number % 3].stuck = True
                self._stuck_until[fault.number % 3] = self.now_s + (fault.seconds or FOR_GOOD_S)
            case _:
                return  # not a fault that a gantry controller can have

    def advance_to(self, now_s: float) -> None:
        """Let time pass: motion, switches, timers."""
        while (event := self.next_event_s()) is not None and event <= now_s:
            self._step_to(max(event, self.now_s))
        self._step_to(now_s)

    def next_event_s(self) -> float | None:
        """When something happens next without a byte."""
        events = [*self.timers.values(), *self._stuck_until.values()]
        planned = self.planner.next_event_s()
        return min([*events, planned] if planned is not None else events, default=None)

    def take_output(self) -> list[tuple[float, bytes]]:
        """What was written since the last call, and when."""
        out, self._out = self._out, []
        return out

    @property
    def off(self) -> bool:
        """Without power, or booting."""
        return "off" in self.timers

    @property
    def hung(self) -> bool:
        """The firmware does nothing; motion that was planned goes on."""
        return "hung" in self.timers

    @property
    def held(self) -> bool:
        """In `Hold`, and at rest."""
        return self.state is State.HOLD and not self.planner.running

    def say(self, line: str) -> None:
        """Print a line."""
        self._out.append((self.now_s, line.encode("ascii") + b"\r\n"))

    def wait_s(self, seconds: float, name: str = "wait") -> Waiting:
        """Wait in the main loop."""
        if seconds > 0.0:
            self.timers[name] = self.now_s + seconds
            while name in self.timers:
                yield

    def raise_alarm(self, number: int) -> None:
        """Stop and lock; alarms that keep the position come from motion that has braked."""
        if self.planner.running and number in POSITION_LOST:
            self.mechanics.stop_dead(self.planner.velocity)
        self.planner.flush()
        self.rx.clear()
        self.timers.clear()
        self.may_start = False
        self.state, self.alarm = State.ALARM, number
        if number in POSITION_LOST:
            self.homed = False
        self.critical = number in CRITICAL
        self.say(f"ALARM:{number}")
        if self.critical:
            self.say("[MSG:Reset to continue]")
        mute = self.critical and self.dialect.mute_when_critical
        self.loop = program.dead_loop() if mute else program.main_loop(self)
        self._show_monitor()

    def limits(self) -> MachineLimits:
        """What the settings allow the planner."""
        speed = self.eeprom.axes(110)
        return MachineLimits(
            (speed[0] / 60.0, speed[1] / 60.0, speed[2] / 60.0), self.eeprom.axes(120), self.eeprom[11]
        )

    def place(self, position: Triple) -> None:
        """Call the present place something else."""
        self.mechanics.follow(self.planner.position)
        self.mechanics.rename(position)
        self.planner.position = position

    def start_cycle(self) -> None:
        """Begin what is planned, if the machine is idle."""
        if self.state is not State.IDLE or not len(self.planner) or "start" in self.timers:
            return
        if self.start_delay_s > 0.0 and not self.may_start:
            self.timers["start"], self.may_start = self.now_s + self.start_delay_s, True
            return
        self.may_start = False
        self.state = State.RUN
        self.planner.start(self.now_s)

    def unlock(self) -> None:
        """Leave the alarm state, as ``$X`` does."""
        self.state, self.alarm = State.IDLE, None
        self.say("[MSG:Caution: Unlocked]")
        self._show_monitor()

    def begin_homing(self) -> None:
        """Homing starts: until it ends well, nothing is known of the place."""
        self.planner.flush()
        self.state, self.homed, self.alarm = State.HOME, False, None
        self._show_monitor()

    def end_homing(self, position: Triple) -> None:
        """Homing has ended well, at this place; a ``?`` that came meanwhile is answered now."""
        self.place(position)
        self.state, self.homed = State.IDLE, True
        self._show_monitor()
        if self.asked_while_homing:
            self.asked_while_homing = False
            self.say(report.status(self))

    def fail_homing(self, alarm: int) -> None:
        """Homing has failed: an alarm, and a restart; the place that is reported from then on means nothing."""
        self.raise_alarm(alarm)
        self._restart()

    def power_up(self, off_s: float = 0.0) -> None:
        """Start from nothing; what moved stops dead, and the position is forgotten."""
        if self.planner.running:
            self.mechanics.stop_dead(self.planner.velocity)
        self.planner.flush()
        self.place((0.0, 0.0, 0.0))
        self.timers.clear()
        self.homed, self.critical, self.alarm = False, False, None
        self.may_start = False
        self.state = State.ALARM if self.eeprom.flag(22) else State.IDLE
        if off_s > 0.0:
            self.loop = program.dead_loop()
            self.timers["off"] = self.now_s + off_s
        else:
            self._restart()

    def _restart(self) -> None:
        """Print the banner and begin the main loop anew: what resets of all kinds share."""
        self.rx.clear()
        self.line_open = self.system_line = self.asked_while_homing = False
        self.modal, self.last_error = Modal(), 0
        self.reports = report.Counters()
        self._out.append((self.now_s, b"\r\n"))
        self.say(self.dialect.banner)
        if self.state is State.ALARM and not self.homed and self.dialect.homing_lock_alarm and self.eeprom.flag(22):
            self.alarm = self.dialect.homing_lock_alarm
            self.say(f"ALARM:{self.alarm}")
        if self.state is State.ALARM:
            self.say("[MSG:'$H'|'$X' to unlock]")
        self.loop = program.main_loop(self)
        self._show_monitor()

    def _show_monitor(self) -> None:
        """Homed or alarm has changed."""
        if self.monitor is not None:
            self.monitor.look(self)

    def reset(self) -> None:
        """0x18: drop everything; in motion the position is lost."""
        moving, homing = self.planner.running, self.state is State.HOME
        if moving:
            self.mechanics.stop_dead(self.planner.velocity)
        self.planner.flush()
        self.timers.clear()
        self.critical = self.may_start = False
        if moving or homing:
            self.homed, self.state, self.alarm = False, State.ALARM, 6 if homing else 3
            self.say(f"ALARM:{self.alarm}")
        elif self.state is not State.ALARM:
            self.state = State.IDLE
        self._restart()

    def _step_to(self, now_s: float) -> None:
        self.now_s = max(self.now_s, now_s)
        was_running = self.planner.running
        if was_running:
            self.planner.advance_to(self.now_s)
            self.mechanics.follow(self.planner.position)
        for name in [name for name, at_s in self.timers.items() if at_s <= self.now_s]:
            del self.timers[name]
            if name == "off":
                self._restart()
        for axis in [axis for axis, at_s in self._stuck_until.items() if at_s <= self.now_s]:
            del self._stuck_until[axis]
            self.mechanics.axes[axis].stuck = False
        if was_running and self.state is not State.HOME:
            self._after_motion()
        self.run_main()

    def _after_motion(self) -> None:
        if self.eeprom.flag(21) and any(self.mechanics.tripped()):
            self.raise_alarm(1)
        elif not self.planner.running:
            if self.state is State.JOG and self.planner.holding:
                self.planner.flush()
            if self.state in (State.RUN, State.JOG):
                self.state = State.IDLE

    def run_main(self) -> None:
        """Let the main loop go on, unless the firmware waits in a hold."""
        braking = self.state is State.JOG and self.planner.holding
        hung = self.hung and self.state is not State.HOME  # the homing cycle looks at its switches by interrupt
        if not (self.off or hung or braking or self.state is State.HOLD):
            next(self.loop)
