"""What only a person may ask for: to leave an alarm, to say where an axis stands, to reboot a servo."""

from __future__ import annotations

from dataclasses import replace

from drivers.combined import CombinedRig
from drivers.rig_status import NAMES
from rig.devices import Motion
from rig.guard.errors import RefusedError
from rig.guard.machine import Machine
from rig.guard.rules import Rules
from rig.guard.states import Event
from rig.guard.watch import Watch
from rig.guard.ways import refuse_outside
from rig.hal import AXES, RigLimits, RigPose


class ByHand:
    """A person's requests, each the only command under way."""

    def __init__(self, rig: CombinedRig, rules: Rules, machine: Machine, watch: Watch) -> None:
        self._rig, self._rules, self._machine, self._watch = rig, rules, machine, watch

    def unlock(self) -> None:
        """See `rig.guard.Guard`."""
        with self._machine.alone("unlocking"):
            self._machine.refuse(Event.UNLOCK)
            gantry = self._watch.ask().gantry
            if gantry is not None and gantry.motion is Motion.ALARM:
                self._rig.unlock()
            self._watch.fault = ""
            # A servo that has stopped itself (its watchdog) is enabled again with the next move.
            self._watch.let_go()
            self._machine.go(Event.UNLOCK, self._watch.found(self._watch.ask()))

    def reference(self, axis: str, value: float) -> None:
        """See `rig.guard.Guard`."""
        self._refuse_unknown(axis, "reference")
        refuse_outside(replace(_middle(self._rules.travel), **{axis: value}), self._rules.travel)
        with self._machine.alone("referencing"):
            self._machine.refuse(Event.REFERENCE)
            self._rig.reference(axis, value)
            self._watch.let_go(axis)
            self._machine.go(Event.REFERENCE, self._watch.found(self._watch.ask()))

    def reboot(self, axis: str) -> None:
        """See `rig.guard.Guard`."""
        self._refuse_unknown(axis, "reboot")
        with self._machine.alone("rebooting"):
            self._machine.refuse(Event.REBOOT)
            told = self._watch.ask().axes.get(axis)
            if told is not None and told.motion is not Motion.ALARM:
                raise RefusedError(
                    f"{NAMES[axis]} reports no hardware error, and a reboot would only lose its place. "
                    "Look which device raises the alarm"
                )
            self._rig.reboot(axis)
            self._watch.let_go(axis)
            self._machine.go(Event.REBOOT, self._watch.found(self._watch.ask()))

    def _refuse_unknown(self, axis: str, what: str) -> None:
        if axis not in self._rig.axes:
            raise RefusedError(f"this bench has no axis {axis!r} to {what}. It has {', '.join(self._rig.axes)}")


def _middle(limits: RigLimits) -> RigPose:
    return RigPose(*((getattr(limits, axis).lower + getattr(limits, axis).upper) / 2 for axis in AXES))
