"""Ends what is under way from another thread, and makes sure that it has ended.

A command looks whether it may begin, and then sends its first byte: a STOP that falls between the two finds nothing to
stop. So devices are stopped again until the other thread's command has ended.
"""

from __future__ import annotations

from dataclasses import replace

from drivers.combined import CombinedRig
from rig.devices import StopReport
from rig.guard import remedies
from rig.guard.errors import HeldError, StoppedError
from rig.guard.machine import Machine

_AGAIN_S, _TIMES = 0.1, 20


def stop_until_ended(rig: CombinedRig, machine: Machine) -> StopReport:
    """Stop all devices, until no other thread's command can move one. The first byte waits for no lock."""
    report = rig.stop()
    for _ in range(_TIMES):
        if not machine.others_in_motion() or machine.wait_for_end(_AGAIN_S):
            return report
        again = rig.stop()
        report = again if report.sent_at_s is None else replace(again, sent_at_s=report.sent_at_s)
    return replace(report, confirmed=False)


def halt_until_ended(rig: CombinedRig, machine: Machine) -> StopReport | None:
    """Stop the device that moves, until no other thread's command can move one."""
    report = rig.halt()
    for _ in range(_TIMES):
        if not machine.others_in_motion() or machine.wait_for_end(_AGAIN_S):
            break
        report = rig.halt() or report
    return report


def broken_off(machine: Machine) -> StoppedError | HeldError | None:
    """The STOP or the hold that has come since a command began, as the error that ends it."""
    note = machine.stop_note
    if note:
        return StoppedError(f"stopped by STOP ({note}). {remedies.release(machine.bench)}")
    if machine.hold_asked:
        return HeldError("motion was held before it had ended. Command it again (in `rig jog` resume first: R)")
    return None
