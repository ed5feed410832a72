"""The state that a live rig is in: what may change it, and the one command that may be under way meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rig.guard import remedies
from rig.guard.errors import BusyError, HeldError, RefusedError, StoppedError
from rig.guard.states import ACTIVITIES, BY_CAUSE, IN_MOTION, MEANINGS, Event, State


@dataclass(frozen=True, slots=True)
class Running:
    """The command that is under way, and the thread that gave it."""

    what: str
    thread: int
    yields: bool = False


class Machine:
    """The state that a rig is in, and the one command that may be under way.

    The lock is held for a few assignments, never while a device is asked. `latch_stop` takes no lock at all: from
    then on the state is STOPPED whatever else happens, until `release`.

    Args:
        seen: is told every transition.
        bench: its file, for messages that name commands.
    """

    def __init__(
        self,
        seen: Callable[[State, Event, State], None] = lambda source, event, target: None,
        bench: str = remedies.BENCH,
    ) -> None:
        self.bench = bench
        self._state = State.DISCONNECTED
        self._lock = threading.Lock()
        self._ended = threading.Condition(self._lock)
        self._running: Running | None = None
        self._stop_note = ""
        self._last_stop: object = None
        self._hold_asked = False
        self._seen = seen

    @property
    def state(self) -> State:
        """The present state."""
        return State.STOPPED if self._stop_note else self._state

    @property
    def running(self) -> str:
        """The command that is under way; empty if none is."""
        running = self._running
        return "" if running is None else running.what

    @property
    def hold_asked(self) -> bool:
        """A hold has been asked for, and not resumed."""
        return self._hold_asked

    @property
    def stop_note(self) -> str:
        """Who stopped it; empty unless STOP is latched."""
        return self._stop_note

    @property
    def last_stop(self) -> object:
        """Another object for each STOP that has come."""
        return self._last_stop

    @contextmanager
    def alone(self, what: str, *, yields: bool = False, wait_s: float = 5.0) -> Iterator[None]:
        """Be the only command under way.

        Args:
            what: the command, for whoever is refused meanwhile.
            yields: others may wait until it is over (it is short), instead of being refused.
            wait_s: real time to wait for such a command at most.

        Raises:
            BusyError: another command is under way; tells which.
        """
        me = threading.get_ident()
        with self._ended:
            while (other := self._running) is not None:
                # The thread that would have to end it cannot wait for it.
                if not other.yields or other.thread == me or not self._ended.wait(wait_s):
                    raise BusyError(f"the rig is busy: {other.what} is under way. Wait until it is done, or stop it")
            self._running = Running(what, me, yields)
        try:
            yield
        finally:
            with self._ended:
                self._heed_hold()
                self._running = None
                self._ended.notify_all()

    def refuse(self, event: Event) -> None:
        """Raise unless an event may happen now.

        Raises:
            StoppedError: STOP is latched.
            HeldError: motion is held.
            RefusedError: the table has no such transition; tells the state and what to do.
        """
        if self._stop_note and event is not Event.RELEASE:
            raise StoppedError(f"STOP is latched ({self._stop_note}). {remedies.release(self.bench)}")
        state = self._state
        if (state, event) in BY_CAUSE:
            return
        remedy = remedies.out_of(state, self.bench)
        if state is State.HELD:
            raise HeldError(f"motion is held. {remedy}")
        because = f"{event.value} is not possible while {state.value} ({MEANINGS[state]})"
        raise RefusedError(f"{because}. {remedy}" if remedy else because)

    def go(self, event: Event, target: State) -> None:
        """Change the state.

        Raises:
            StoppedError, HeldError, RefusedError: as `refuse`; or a hold came while the command was being prepared.
        """
        with self._lock:
            self.refuse(event)
            if self._hold_asked and target in ACTIVITIES:
                raise HeldError(f"a hold came before {event.value} had begun. Command it again")
            self._set(event, target)

    def end(self, event: Event, target: State) -> None:
        """End an activity; a STOP or a hold that came meanwhile goes before how it ended."""
        with self._lock:
            if self._stop_note:
                self._set(Event.STOP, State.STOPPED)
            elif self._hold_asked and target in (State.IDLE, State.UNHOMED):
                self._set(Event.HOLD, State.HELD)
            else:
                self._set(event, target)

    def find(self, target: State) -> None:
        """What the devices' answers say, where that changes anything."""
        with self._lock:
            if not self._stop_note and target in BY_CAUSE.get((self._state, Event.FIND), ()):
                self._set(Event.FIND, target)

    def hold(self) -> None:
        """Nothing moves until it is resumed: an activity ends as held, and what is being prepared does not begin."""
        with self._lock:
            if self._stop_note or self._state is State.HELD:
                return
            self._hold_asked = self._running is not None or (self._state, Event.HOLD) in BY_CAUSE
            if self._state not in ACTIVITIES:
                self._heed_hold(ended=self._running is None)

    def latch_stop(self, note: str) -> None:
        """STOPPED from now on. Takes no lock."""
        # In this order: `release` clears the note and then looks if this has changed.
        self._last_stop = object()
        self._stop_note = self._stop_note or note

    def note_stop(self) -> None:
        """Write the STOP into the state, where no activity will do so at its end."""
        with self._lock:
            if self._stop_note and self._state not in (*ACTIVITIES, State.STOPPED):
                self._set(Event.STOP, State.STOPPED)

    def release(self, target: State, stop: object) -> None:
        """Undo the latch, by hand.

        Args:
            target: what the devices say.
            stop: the last one that there was when the person asked for it.

        Raises:
            StoppedError: another one has come since, and stays latched.
        """
        with self._lock:
            self.refuse(Event.RELEASE)
            note, self._stop_note = self._stop_note, ""
            if self._last_stop is not stop:
                self._stop_note = self._stop_note or note
                raise StoppedError("another STOP came while the first was being released. Release it again")
            self._set(Event.RELEASE, target)

    def others_running(self) -> bool:
        """Another thread's command is under way."""
        running = self._running
        return running is not None and running.thread != threading.get_ident()

    def others_in_motion(self) -> bool:
        """Another thread's command may still move something."""
        return self.others_running() and self._state in IN_MOTION

    def wait_for_end(self, seconds: float) -> bool:
        """Wait, in real time, until no command is under way; False if one still is."""
        with self._ended:
            return self._ended.wait_for(lambda: self._running is None, seconds)

    def _heed_hold(self, *, ended: bool = True) -> None:
        """Be held if that was asked for, and can be; a hold of a command that has ``ended`` otherwise is over."""
        if self._hold_asked and not self._stop_note and (self._state, Event.HOLD) in BY_CAUSE:
            self._set(Event.HOLD, State.HELD)
        elif ended and self._state is not State.HELD:
            self._hold_asked = False

    def _set(self, event: Event, target: State) -> None:
        source = self._state
        if target not in BY_CAUSE[source, event]:
            raise RuntimeError(f"{event.value} never leads from {source.value} to {target.value}")
        self._state = target
        if source in (State.HELD, *ACTIVITIES):
            self._hold_asked = self._hold_asked and target in (State.HELD, *ACTIVITIES)
        self._seen(source, event, target)
