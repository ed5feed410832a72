"""What a person at the bench can have done: steps, go-to, pictures, marks, homing, hold and STOP; without any screen.

Commands run one at a time in a thread of their own, and all of them pass the guard; what becomes of them is told in
messages. STOP and hold have threads of their own and wait for no command.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

from rig.devices import Clock
from rig.errors import HardwareError, RigError
from rig.guard import Guard, GuardStatus, State
from rig.hal import RigLimits, RigPose
from rig.jog.keeping import HandGrid
from rig.jog.marks import Marks
from rig.jog.places import SHORT, UNITS, shown, typed_pose, typed_reference, typed_servo
from rig.jog.worker import Command, Trigger, Worker
from rig.table import plain

Kind = Literal["done", "note", "refused", "fault"]
Action = Callable[[], str]
"""Does something and returns what to say of it; empty: nothing."""
STEPS: dict[str, tuple[float, ...]] = {"mm": (0.1, 1.0, 10.0, 50.0), "°": (0.1, 1.0, 10.0), "": (0.01, 0.1)}
"""Step sizes by unit; the empty one is the zoom's."""
IDLE_S = 0.25
_MESSAGES = 100
_CLOSE_S = 15.0


@dataclass(frozen=True, slots=True)
class Message:
    """What became of something. ``times``: how often that came in a row."""

    kind: Kind
    text: str
    times: int = 1


class Jogger:
    """One person's session at a bench. A context manager: leaving it holds what moves, and ends its threads.

    All methods return at once, and any thread may call them.

    Args:
        guard: connected. Nobody else commands it meanwhile, but for STOP.
        grid: keeps the pictures.
        marks: places to come back to.
        idle_s: how often the devices are asked while nothing is commanded; real time.
    """

    def __init__(self, guard: Guard, grid: HandGrid, marks: Marks, *, idle_s: float = IDLE_S) -> None:
        self._guard, self._grid, self._marks = guard, grid, marks
        self._lock = threading.Lock()
        self._messages: deque[Message] = deque(maxlen=_MESSAGES)
        self._steps = {"mm": 1.0, "°": 1.0, "": 0.1}
        self._worker = Worker(self._ask, idle_s)
        self._stopper = Trigger(
            "jog STOP", self._stop_now, partial(self._bug, "STOP: NOT CONFIRMED: use the wired emergency stop")
        )
        self._holder = Trigger("jog hold", self._hold_now, partial(self._bug, "hold"))
        self._held = False

    # What is known.

    @property
    def running(self) -> str:
        """What is being done; empty if nothing is."""
        return self._worker.running

    @property
    def waiting(self) -> str:
        """What will be done next; empty if nothing will."""
        return self._worker.waiting

    @property
    def messages(self) -> tuple[Message, ...]:
        """The last ones, oldest first."""
        with self._lock:
            return tuple(self._messages)

    @property
    def steps(self) -> dict[str, float]:
        """The present step by unit: ``mm``, ``°`` and, for the zoom, an empty one."""
        return dict(self._steps)

    @property
    def limits(self) -> RigLimits:
        """How far steps may go."""
        return self._guard.rules.travel

    @property
    def marks(self) -> dict[str, RigPose]:
        """Marked places by name."""
        return self._marks.poses

    @property
    def pictures(self) -> int:
        """How many the image grid has."""
        return self._grid.count

    @property
    def clock(self) -> Clock:
        """The rig's."""
        return self._guard.clock

    def glance(self) -> GuardStatus:
        """What is known of the rig, without asking it."""
        return self._guard.glance()

    def rest(self, seconds: float) -> bool:
        """Wait until all that was commanded is done; False if that takes longer. Real time."""
        return self._worker.rest(seconds)

    # Moving.

    def choose_step(self, unit: str, size: float) -> None:
        """Take another step size for all axes of a unit."""
        self._steps[unit] = size

    def step(self, axis: str, direction: int) -> None:
        """One step along an axis, up (1) or down (-1)."""
        unit = UNITS[axis]
        size = direction * self._steps[unit]

        def run() -> str:
            self._guard.jog(**{f"d{axis}": size})
            return ""

        self._do(f"{SHORT[axis]} {size:+g} {unit}".rstrip(), run)

    def go_to(self, text: str) -> None:
        """Go to a pose as `rig.jog.places.typed_pose` reads it."""
        self._do(f"go to {text}", lambda: self._go(typed_pose(text, self._guard.pose)))

    def home(self) -> None:
        """Home the gantry."""

        def run() -> str:
            self._guard.home()
            return "homed"

        self._do("homing", run)

    # Pictures and marks.

    def capture(self) -> None:
        """Take a picture and keep it with its pose."""

        def run() -> str:
            kept = self._grid.add(self._guard.capture())
            return f"kept {self._grid.folder / kept.file}"

        self._do("a capture", run)

    def set_mark(self, name: str = "") -> None:
        """Mark the place where the rig stands; without a name, by the lowest number that is free."""

        def run() -> str:
            told = name or self._marks.free_name()
            self._marks.set(told, self._guard.pose)
            return f"mark {told}: {shown(self._guard.pose)}"

        self._do("setting a mark", run)

    def go_to_mark(self, name: str) -> None:
        """Go to a mark that is in the list."""
        pose = self._marks.poses[name]
        self._do(f"go to mark {name}", lambda: self._go(pose))

    def remove_mark(self, name: str) -> None:
        """Forget a mark."""

        def run() -> str:
            self._marks.remove(name)
            return f"mark {name} is removed"

        self._do("removing a mark", run)

    # What a person decides.

    def unlock(self) -> None:
        """Leave an alarm, or take note of what failed."""
        self._do("unlocking", lambda: f"unlocked: {self._guard.unlock().value}")

    def reference(self, text: str) -> None:
        """Say where the pan or the zoom stands: ``theta=0``."""
        self._do("referencing", lambda: f"{text}: {self._guard.reference(*typed_reference(text)).value}")

    def reboot(self, text: str) -> None:
        """Reboot a servo that reports a hardware error: ``pan`` or ``zoom``."""
        self._do("rebooting", lambda: f"{text} is rebooted: {self._guard.reboot(typed_servo(text)).value}")

    def resume(self) -> None:
        """Let motion be commanded again after a hold."""
        self._do("resuming", lambda: f"resumed: {self._guard.resume().value}")

    def release(self) -> None:
        """Release STOP."""
        self._do("releasing STOP", lambda: f"STOP is released: {self._guard.release().value}")

    def connect(self) -> None:
        """Connect again, after a link was lost."""

        def run() -> str:
            self._guard.connect()
            return f"connected: {self._guard.state.value}"

        self._do("connecting", run)

    # Stopping: waits for nothing.

    def stop(self) -> None:
        """STOP, latched until `release`; nothing that waits is done."""
        self._stopper.pull()
        self._worker.drop()

    def hold(self) -> None:
        """End motion until `resume`; a picture being taken is finished."""
        self._held = True
        self._holder.pull()
        self._worker.drop()

    def interrupt(self) -> None:
        """Ctrl-C: the first holds, the next is STOP."""
        if self._held or self._guard.state in (State.HELD, State.STOPPED):
            self.stop()
        else:
            self.hold()

    def close(self) -> None:
        """Hold what moves, wait for it, and end. Safe to call twice."""
        self._worker.drop()
        if self.running:
            self._holder.pull()
        self._stopper.close(_CLOSE_S)
        self._holder.close(_CLOSE_S)
        self._worker.close(_CLOSE_S)

    def __enter__(self) -> Jogger:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

    # Within.

    def say(self, kind: Kind, text: str) -> None:
        """Add a message; one that comes again is counted. What devices say may hold control characters."""
        with self._lock:
            told = Message(kind, plain(text))
            last = self._messages[-1] if self._messages else None
            if last is not None and (last.kind, last.text) == (told.kind, told.text):
                self._messages[-1] = replace(last, times=last.times + 1)
            else:
                self._messages.append(told)

    def _do(self, what: str, action: Action) -> None:
        def run() -> bool:
            good = self._done(what, action)
            self._held = self._held and not good
            return good

        if not self._worker.submit(Command(what, run)):
            self.say("refused", f"{what}: not taken, for {self.running or 'a command'} is under way and one waits")

    def _done(self, what: str, action: Action) -> bool:
        try:
            told = action()
        except HardwareError as error:
            self.say("fault", f"{what}: {error}")
        except RigError as error:
            self.say("refused", f"{what}: {error}")
        except Exception as error:
            # Shown, and not raised: whoever stands at the bench must keep the screen with STOP on it.
            self._bug(what, error)
        else:
            if told:
                self.say("done", told)
            return True
        return False

    def _bug(self, what: str, error: Exception) -> None:
        self.say("fault", f"{what}: internal error: {type(error).__name__}: {error}. This is a bug: report it")

    def _go(self, pose: RigPose) -> str:
        return f"at {shown(self._guard.move_to(pose))}"

    def _ask(self) -> None:
        def run() -> str:
            self._guard.status()
            return ""

        self._done("reading the status", run)

    def _stop_now(self) -> None:
        report = self._guard.stop("rig jog")
        certain = "everything is at rest" if report.confirmed else "NOT CONFIRMED: use the wired emergency stop"
        again = "" if report.position_kept else "it must be homed again"
        text = "; ".join(filter(None, (certain, report.trouble, again)))
        self.say("note" if report.confirmed else "fault", f"STOP: {text}. Shift-R releases it")

    def _hold_now(self) -> None:
        report = self._guard.hold()
        trouble = "" if report is None or report.confirmed else f"; {report.trouble or 'rest is not confirmed'}"
        self.say("fault" if trouble else "note", f"motion is held{trouble}. R resumes; Ctrl-C again is STOP")
