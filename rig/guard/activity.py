"""Being in a state while something is done on the devices, and ending as they, a STOP or a hold say."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

from drivers.combined import CombinedRig
from rig.devices import Clock
from rig.errors import HardwareError, UnreachableError
from rig.guard.breaking import broken_off
from rig.guard.errors import HeldError, StoppedError
from rig.guard.machine import Machine
from rig.guard.states import Event, State
from rig.guard.watch import Watch

ONLY_IDLE = (State.IDLE,)
HOMED_OR_NOT = (State.IDLE, State.UNHOMED)


class Activities:
    """Moves, jogs, homings and captures, from the state's point of view."""

    def __init__(self, rig: CombinedRig, machine: Machine, watch: Watch, clock: Clock) -> None:
        self._rig, self._machine, self._watch, self._clock = rig, machine, watch, clock

    @contextmanager
    def during(self, event: Event, state: State, good: tuple[State, ...] = ONLY_IDLE) -> Iterator[None]:
        """Be in a state while the body runs.

        Args:
            event: the command.
            state: that it is in meanwhile.
            good: states that it may end in.

        Raises:
            StoppedError, HeldError: it was broken off, or must not begin.
            HardwareError: it ended in a state that is not good.
        """
        self._machine.go(event, state)
        try:
            with nullcontext() if event is Event.CAPTURE else _uncollected():
                yield
            self.refuse_broken_off()
            self._rest(event)
            status = self._watch.ask()
            found = self._watch.found(status)
            if found not in good:
                raise HardwareError(f"the {event.value} ended with the rig {found.value}: {self._watch.why(status)}")
        except BaseException as error:
            # Before the state of what is left is known: of an alarm it says nothing about the hold that led there.
            broken = self._due(event)
            self._clear_up(event, error)
            broken = self._due(event) or broken
            if broken is not None and isinstance(error, HardwareError | HeldError):
                raise broken from error
            raise
        self._machine.end(Event.DONE, found)

    def refuse_broken_off(self) -> None:
        """Go no further if a STOP or a hold has come.

        Raises:
            StoppedError, HeldError: as it says.
        """
        broken = self._due(Event.CAPTURE if self._machine.state is State.CAPTURING else Event.MOVE)
        if broken is not None:
            raise broken

    def _due(self, event: Event) -> StoppedError | HeldError | None:
        broken = broken_off(self._machine)
        # A picture is finished though a hold has come; nothing moves while it is taken.
        return None if isinstance(broken, HeldError) and event is Event.CAPTURE else broken

    def _rest(self, event: Event) -> None:
        if event is not Event.CAPTURE:
            self._watch.rest_since_s = self._clock.now_s()

    def _clear_up(self, event: Event, error: BaseException) -> None:
        """See what a failed command has left, and end the activity accordingly."""
        watch = self._watch
        self._rest(event)
        if not isinstance(error, Exception):
            # Ctrl-C in the middle of something: nobody else has seen to it that motion ends.
            self._rig.stop()
        excused = isinstance(error, UnreachableError) or broken_off(self._machine) is not None
        if event is not Event.CAPTURE:
            watch.play = watch.commanded = None
            watch.fault = "" if excused else f"the last {event.value} failed: {error}"
        found = watch.found(watch.ask())
        good = found is State.IDLE or (found is State.UNHOMED and excused and event is not Event.CAPTURE)
        self._machine.end(Event.DONE if good else Event.FAIL, found)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Inside, Python looks for no garbage in cycles.

    A full collection keeps all threads at a stand while it looks through every object, 0.1 to 0.35 s where a screen
    runs: the one that sends STOP, too, and the one that keeps a moving servo's watchdog (0.2 s) quiet.
    """
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
