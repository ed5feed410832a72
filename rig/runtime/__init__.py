"""What processes that use one live bench tell each other: who holds it, that it is stopped, that it is homed."""

from rig.runtime.attendance import PASSING_S, Attendance, stop_held
from rig.runtime.folder import runtime_folder
from rig.runtime.holding import BenchHeldError, Holder
from rig.runtime.homing import FileHomingMemory
from rig.runtime.latch import FileLatch
from rig.runtime.line import ask, listening
from rig.runtime.telling import status_object, stop_object

__all__ = [
    "PASSING_S",
    "Attendance",
    "BenchHeldError",
    "FileHomingMemory",
    "FileLatch",
    "Holder",
    "ask",
    "listening",
    "runtime_folder",
    "status_object",
    "stop_held",
    "stop_object",
]
