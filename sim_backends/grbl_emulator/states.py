"""The states that a status report names."""

from __future__ import annotations

import enum


class State(enum.Enum):
    """The states of a status report."""

    IDLE = "Idle"
    RUN = "Run"
    JOG = "Jog"
    HOLD = "Hold"
    HOME = "Home"
    ALARM = "Alarm"
