"""The guard, through which every live command passes (docs/safety.md)."""

from rig.guard.errors import BusyError, HeldError, RefusedError, StoppedError
from rig.guard.guard import Guard
from rig.guard.rules import Box, Offers, Rules, Tolerance
from rig.guard.states import TABLE, Event, State, Transition, table_markdown
from rig.guard.watch import GuardStatus, HomingMemory, StopLatch

__all__ = [
    "TABLE",
    "Box",
    "BusyError",
    "Event",
    "Guard",
    "GuardStatus",
    "HeldError",
    "HomingMemory",
    "Offers",
    "RefusedError",
    "Rules",
    "State",
    "StopLatch",
    "StoppedError",
    "Tolerance",
    "Transition",
    "table_markdown",
]
