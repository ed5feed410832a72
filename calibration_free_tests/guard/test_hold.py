"""A hold that comes while a command is being prepared: what was asked for does not begin, in whatever state that is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from calibration_free_tests.guard.sample import Bench, at, bench, homed
from rig.devices import AxisStatus, Motion
from rig.errors import HardwareError
from rig.guard import HeldError, State


def in_alarm() -> Bench:
    """A gantry as it is when it has just been switched on, and servos that know their place."""
    made = bench()
    made.gantry.raise_alarm(11)
    made.guard.connect()
    assert made.guard.state is State.ALARM
    return made


def in_preparation(made: Bench, monkeypatch: pytest.MonkeyPatch, action: Callable[[], object]) -> None:
    """Do something once, when the axes are about to be enabled for a command."""
    enable = made.rig.enable

    def enabled(axis: str) -> None:
        monkeypatch.undo()
        action()
        enable(axis)

    monkeypatch.setattr(made.rig, "enable", enabled)


def test_a_hold_while_homing_is_prepared_in_alarm_keeps_it_from_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    made = in_alarm()
    in_preparation(made, monkeypatch, made.guard.hold)
    with pytest.raises(HeldError):
        made.guard.home()
    assert made.motions == []
    assert made.guard.state is State.ALARM
    made.guard.home()  # asked for anew, it is carried out
    assert made.guard.state is State.IDLE


def test_a_hold_while_homing_is_prepared_unhomed_keeps_it_from_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    made = bench()
    made.guard.connect()
    in_preparation(made, monkeypatch, made.guard.hold)
    with pytest.raises(HeldError):
        made.guard.home()
    assert made.motions == []
    assert made.guard.state is State.HELD
    made.guard.resume()
    made.guard.home()


def test_a_hold_in_alarm_where_nothing_is_under_way_changes_nothing() -> None:
    made = in_alarm()
    made.guard.hold()
    made.guard.home()
    assert made.guard.state is State.IDLE


@pytest.mark.parametrize("ask", ["unlock", "connect"])
def test_a_hold_during_what_moves_nothing_holds_once_it_is_done(ask: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = homed() if ask == "unlock" else bench()
    if ask == "unlock":
        made.gantry.raise_alarm(2)
        made.guard.status()
    status = made.gantry.status

    def held() -> object:
        monkeypatch.undo()
        made.guard.hold()
        return status()

    monkeypatch.setattr(made.gantry, "status", held)
    getattr(made.guard, ask)()
    assert made.guard.state is State.HELD
    with pytest.raises(HeldError):
        made.guard.home()
    made.guard.resume()
    made.guard.home()


@pytest.mark.parametrize("slow_looks", [1, 10], ids=["at rest soon", "still slowing down"])
def test_a_move_that_was_held_ends_as_held_however_long_the_servo_takes_to_slow_down(
    slow_looks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = homed()
    status, looks = made.pan.status, []

    def slowing_down() -> AxisStatus:
        looks.append(None)
        return replace(status(), motion=Motion.MOVING if len(looks) <= slow_looks else Motion.IDLE)

    def held_in_motion(position: float) -> float:
        monkeypatch.setattr(made.pan, "status", slowing_down)
        made.guard.hold()
        raise HardwareError("pan servo 1 was stopped")

    monkeypatch.setattr(made.pan, "move_to", held_in_motion)
    with pytest.raises(HeldError, match="held before it had ended"):
        made.guard.move_to(at(theta_deg=20.0))
