"""The states of a live rig and the table of what may lead from one to another. docs/safety.md shows the same table."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class State(enum.Enum):
    """What a live rig is doing, or why it does nothing."""

    DISCONNECTED = "disconnected"
    UNHOMED = "unhomed"
    IDLE = "idle"
    MOVING = "moving"
    JOGGING = "jogging"
    CAPTURING = "capturing"
    HELD = "held"
    ALARM = "alarm"
    STOPPED = "stopped"


class Event(enum.Enum):
    """What leads from one state to another."""

    CONNECT = "connect"
    HOME = "home"
    MOVE = "move"
    JOG = "jog"
    CAPTURE = "capture"
    REFERENCE = "reference"
    UNLOCK = "unlock"
    REBOOT = "reboot"
    RESUME = "resume"
    RELEASE = "release"
    DONE = "done"
    HOLD = "hold"
    FAIL = "fail"
    FIND = "find"
    STOP = "stop"
    CLOSE = "close"


@dataclass(frozen=True, slots=True)
class Transition:
    """From a state, by an event, to one of some states; the devices' answers say to which."""

    source: State
    event: Event
    targets: tuple[State, ...]


_S, _E = State, Event
_REST = (_S.IDLE, _S.UNHOMED, _S.ALARM, _S.DISCONNECTED)
_FAULT = (_S.ALARM, _S.UNHOMED, _S.DISCONNECTED)
_BUT_STOPPED = tuple(state for state in State if state is not _S.STOPPED)

TABLE: tuple[Transition, ...] = (
    Transition(_S.DISCONNECTED, _E.CONNECT, _REST),
    Transition(_S.UNHOMED, _E.HOME, (_S.MOVING,)),
    Transition(_S.UNHOMED, _E.JOG, (_S.JOGGING,)),
    Transition(_S.UNHOMED, _E.REFERENCE, _REST),
    Transition(_S.UNHOMED, _E.FIND, (_S.ALARM, _S.DISCONNECTED)),
    Transition(_S.IDLE, _E.HOME, (_S.MOVING,)),
    Transition(_S.IDLE, _E.MOVE, (_S.MOVING,)),
    Transition(_S.IDLE, _E.JOG, (_S.JOGGING,)),
    Transition(_S.IDLE, _E.CAPTURE, (_S.CAPTURING,)),
    Transition(_S.IDLE, _E.REFERENCE, _REST),
    Transition(_S.IDLE, _E.FIND, _FAULT),
    Transition(_S.MOVING, _E.DONE, (_S.IDLE, _S.UNHOMED)),
    Transition(_S.MOVING, _E.FAIL, _FAULT),
    Transition(_S.JOGGING, _E.DONE, (_S.IDLE, _S.UNHOMED)),
    Transition(_S.JOGGING, _E.FAIL, _FAULT),
    Transition(_S.CAPTURING, _E.DONE, (_S.IDLE,)),
    Transition(_S.CAPTURING, _E.FAIL, _REST),
    Transition(_S.HELD, _E.RESUME, _REST),
    Transition(_S.HELD, _E.FIND, (_S.DISCONNECTED,)),
    Transition(_S.ALARM, _E.UNLOCK, _REST),
    Transition(_S.ALARM, _E.REBOOT, _REST),
    Transition(_S.ALARM, _E.HOME, (_S.MOVING,)),
    Transition(_S.ALARM, _E.FIND, (_S.DISCONNECTED,)),
    # Connecting what is connected opens the camera anew, and nothing else.
    *(Transition(s, _E.CONNECT, (s,)) for s in (_S.IDLE, _S.UNHOMED, _S.HELD, _S.ALARM)),
    *(Transition(s, _E.HOLD, (_S.HELD,)) for s in (_S.IDLE, _S.UNHOMED, _S.MOVING, _S.JOGGING, _S.CAPTURING)),
    *(Transition(s, _E.CLOSE, (_S.DISCONNECTED,)) for s in (_S.IDLE, _S.UNHOMED, _S.HELD, _S.ALARM)),
    *(Transition(state, _E.STOP, (_S.STOPPED,)) for state in _BUT_STOPPED),
    Transition(_S.STOPPED, _E.RELEASE, _REST),
)

BY_CAUSE = {(row.source, row.event): row.targets for row in TABLE}

ACTIVITIES = (State.MOVING, State.JOGGING, State.CAPTURING)
IN_MOTION = (State.MOVING, State.JOGGING)

MEANINGS: dict[State, str] = {
    State.DISCONNECTED: "not connected, or a device does not answer",
    State.UNHOMED: "the gantry is not homed, or an axis is not referenced: positions mean nothing",
    State.IDLE: "at rest, and every position is known",
    State.MOVING: "on its way to a pose, or homing",
    State.JOGGING: "on its way by one step",
    State.CAPTURING: "settling, and exposing a picture",
    State.HELD: "motion was held (Ctrl-C); nothing is left to run, and nothing moves until it is resumed",
    State.ALARM: "a device raises an alarm, or a move failed; a person must look at it",
    State.STOPPED: "STOP is latched until it is released by hand",
}


def table_markdown() -> str:
    """The states and the table as docs/safety.md has them."""
    lines = ["| state | meaning |", "|---|---|"]
    lines += [f"| {state.value} | {MEANINGS[state]} |" for state in State]
    lines += ["", "| from | by | to |", "|---|---|---|"]
    lines += [f"| {r.source.value} | {r.event.value} | {', '.join(t.value for t in r.targets)} |" for r in TABLE]
    return "\n".join(lines)
