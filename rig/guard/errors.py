"""Why the guard does not do what it was told, where no device is to blame."""

from __future__ import annotations

from rig.errors import HardwareError, RigError


class RefusedError(RigError):
    """The state that the rig is in does not allow the command. Nothing was sent."""


class BusyError(RefusedError):
    """Another command is under way; tells which. Nothing was sent."""


class StoppedError(HardwareError):
    """STOP has ended a command, or is latched and keeps it from beginning."""


class HeldError(RigError):
    """Motion was held (Ctrl-C), and nothing moves until it is resumed."""

    exit_code = 130
