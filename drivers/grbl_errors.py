"""What can go wrong in a conversation with a GRBL-family controller, by what must follow from it."""

from __future__ import annotations

from rig.errors import HardwareError


class AlarmError(HardwareError):
    """The controller has raised an alarm, or is found locked by one."""


class RestartedError(HardwareError):
    """The controller has restarted by itself."""


class OutOfStepError(HardwareError):
    """An answer too many: it is not known any more which answer belongs to which line."""


class SilentError(HardwareError):
    """No valid answer in time."""


class RefusedError(HardwareError):
    """The controller refused a line."""


class StoppedError(HardwareError):
    """A STOP has ended what was under way."""
