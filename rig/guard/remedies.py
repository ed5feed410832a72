"""What helps out of a state, as the command or key that a person would use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rig.devices import AxisStatus
from rig.guard.states import State

BENCH = "BENCH"
"""Stands for the bench file where its name is not known."""
_NAMES = {"theta_deg": "pan", "zoom": "zoom"}
_BY_STATE: dict[State, str] = {
    State.DISCONNECTED: "Connect it first (N in `rig jog`, or the command once more)",
    State.UNHOMED: "Home it first (`rig home {bench}`, or `--home`)",
    State.HELD: "Resume it first (R in `rig jog`)",
    State.ALARM: "Look what is wrong, then unlock it or home it (U or H in `rig jog {bench}`, or `rig home {bench}`)",
}


def out_of(state: State, bench: str) -> str:
    """What to do where a state does not allow a command; empty where only waiting helps."""
    return _BY_STATE.get(state, "").format(bench=bench)


def release(bench: str) -> str:
    """How a STOP is undone."""
    return f"Release it by hand before anything moves: `rig stop {bench} --release`"


def lost_axes(axes: Mapping[str, AxisStatus]) -> list[str]:
    """Those that do not know where they stand: ``theta_deg``, ``zoom``."""
    return [axis for axis, status in axes.items() if not status.referenced]


def find_place(lost: Sequence[str], bench: str) -> str:
    """How the rig gets to know where it stands: home the gantry, and tell it of axes that have ``lost`` their count."""
    if not lost:
        return f"Home it first (`rig home {bench}`, or `--home`)"
    names = " and the ".join(_NAMES[axis] for axis in lost)
    options = " ".join(f"--{axis.replace('_', '-')} 0" for axis in lost)
    stands = "stands" if len(lost) == 1 else "stand"
    return f"Look where the {names} {stands} and say it; if at 0: `rig home {bench} {options}`"
