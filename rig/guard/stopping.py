"""STOP, hold and release: any thread, at any time. STOP takes no lock before its first byte (decision 0054)."""

from __future__ import annotations

import threading
from dataclasses import replace

from drivers.combined import CombinedRig
from rig.devices import StopReport
from rig.guard.breaking import halt_until_ended, stop_until_ended
from rig.guard.errors import StoppedError
from rig.guard.machine import Machine
from rig.guard.states import Event, State
from rig.guard.watch import StopLatch, Watch

LATCH_S = 2.0
"""How long a file system that hangs may keep a STOP from telling what it did; real time."""


class Latching:
    """Latches a STOP for other processes while the devices are stopping: neither waits for the other.

    Args:
        latch: keeps the STOP.
        note: who stopped.
    """

    def __init__(self, latch: StopLatch, note: str) -> None:
        self._latch, self._note, self._trouble = latch, note, ""
        self._thread: threading.Thread | None = threading.Thread(target=self._set, name="STOP latch", daemon=True)
        try:
            self._thread.start()
        except RuntimeError:
            # No thread can be had: then once the devices are stopped, rather than not at all.
            self._thread = None

    def end(self) -> str:
        """Wait until it is latched; returns what went wrong, empty if nothing did."""
        if self._thread is None:
            self._set()
            return self._trouble
        self._thread.join(LATCH_S)
        if self._thread.is_alive():
            return "STOP is not latched for other processes yet: keep them from moving"
        return self._trouble

    def _set(self) -> None:
        self._trouble = self._latch.set(self._note)


class Stopping:
    """What ends motion, and what allows it again. See `rig.guard.Guard` for what each does."""

    def __init__(self, rig: CombinedRig, machine: Machine, watch: Watch, latch: StopLatch | None) -> None:
        self._rig, self._machine, self._watch, self._latch = rig, machine, watch, latch

    def stop(self, by: str) -> StopReport:
        """STOP. Never raises."""
        self._machine.latch_stop(by)
        # A process that is killed from now on has told the others all the same.
        latching = None if self._latch is None else Latching(self._latch, by)
        report = stop_until_ended(self._rig, self._machine)
        self._machine.note_stop()
        if not report.position_kept:
            self._watch.homed = False
        troubles = [report.trouble, "" if latching is None else latching.end()]
        if not report.confirmed:
            troubles.append("it is not certain that everything is at rest: look, and switch the power off if it is not")
        stop = replace(report, trouble="; ".join(filter(None, troubles)))
        self._watch.stop = stop
        return stop

    def hold(self) -> StopReport | None:
        """Stop motion without latching. Never raises."""
        self._machine.hold()
        return halt_until_ended(self._rig, self._machine)

    def release(self) -> None:
        """Release STOP.

        Raises:
            StoppedError, RefusedError: see `rig.guard.Guard`.
        """
        machine, watch = self._machine, self._watch
        with machine.alone("releasing STOP"):
            machine.refuse(Event.RELEASE)
            released = machine.last_stop
            watch.let_go()
            found = watch.found(watch.ask()) if watch.connected else State.DISCONNECTED
            if self._latch is not None:
                self._latch.clear()
            try:
                machine.release(found, released)
            except StoppedError:
                # The other STOP may have found the latch set, just before it was cleared.
                if self._latch is not None:
                    self._latch.set(machine.stop_note)
                raise
