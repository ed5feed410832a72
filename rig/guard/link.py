"""Connects and closes the devices of a bench, and whoever keeps company with them: who listens for a STOP, say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from typing import Any

from drivers.combined import CombinedRig
from rig.errors import HardwareError
from rig.guard.breaking import broken_off
from rig.guard.errors import StoppedError
from rig.guard.machine import Machine
from rig.guard.states import Event, State
from rig.guard.watch import StopLatch, Watch

PATIENCE_S = 5.0
"""How long a command that does not end, for a camera that hangs, say, keeps the bench from being closed; real time."""

Companion = Callable[[Any], AbstractContextManager[object]]
"""Takes the guard, and is entered before the devices are connected and left after they are closed."""


class Link:
    """The devices' connections. See `rig.guard.Guard` for what each method does."""

    def __init__(
        self,
        rig: CombinedRig,
        machine: Machine,
        watch: Watch,
        latch: StopLatch | None,
        company: Sequence[Companion],
    ) -> None:
        self._rig, self._machine, self._watch, self._latch = rig, machine, watch, latch
        self._company, self._companions = tuple(company), ExitStack()

    def connect(self, guard: object) -> None:
        """Connect all devices, or, where they are connected, the camera anew.

        Raises:
            HardwareError, StoppedError, RefusedError: see `rig.guard.Guard`.
        """
        with self._machine.alone("connecting"):
            again = self._machine.state is not State.DISCONNECTED
            self._machine.refuse(Event.CONNECT)
            if again:
                self._watch.connect_camera()
                return
            # What is left of a link that has failed need not close well.
            with suppress(HardwareError):
                self._disconnect()
            before = self._machine.last_stop
            try:
                # First: whoever wants to stop what another program has left running must not find this one mute.
                for companion in self._company:
                    self._companions.enter_context(companion(guard))
                self._take_up(before)
            except BaseException as error:
                self._companions.close()
                stopped = broken_off(self._machine)
                if isinstance(stopped, StoppedError) and isinstance(error, HardwareError):
                    raise stopped from error
                raise

    def close(self) -> None:
        """Close all devices, each following its torque policy: also under a command that does not come back.

        Raises:
            HardwareError: a device could not be closed as its policy says, or a command is still under way.
        """
        if self._machine.others_running() and not self._machine.wait_for_end(PATIENCE_S):
            self._close_under(self._machine.running)
        with self._machine.alone("closing"):
            try:
                self._watch.remember()
                self._disconnect()
            finally:
                if self._machine.state not in (State.DISCONNECTED, State.STOPPED):
                    self._machine.go(Event.CLOSE, State.DISCONNECTED)

    def _close_under(self, what: str) -> None:
        # Its torque off, and its ports given back, a bench is safe to leave; that command finds nobody to talk to.
        self._disconnect()
        raise HardwareError(f"{what} does not end: all devices were closed under it. Look at the camera and the links")

    def _take_up(self, before: object) -> None:
        """Connect the devices; a STOP that came since the one ``before`` may have found some not connected yet."""
        status = self._watch.connect()
        if self._machine.last_stop is not before and not self._rig.stop().position_kept:
            self._watch.homed = False
        if self._latch is not None and (note := self._latch.note()):
            self._machine.latch_stop(note)
        try:
            self._machine.go(Event.CONNECT, self._watch.found(status))
        except StoppedError:
            self._machine.note_stop()

    def _disconnect(self) -> None:
        self._watch.forget()
        try:
            self._rig.close()
        finally:
            # Last: who holds the bench for us must not let another process in before the devices are free.
            self._companions.close()
