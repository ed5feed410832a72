"""What the guard says when it refuses or fails: in the person's own coordinates, with the command that helps."""

from __future__ import annotations

import pytest

from calibration_free_tests.guard.sample import at, bench, homed
from drivers.not_arrived import NotArrivedError
from rig.devices import Triple
from rig.errors import HardwareError, RigError
from rig.guard import HeldError, RefusedError, StoppedError


@pytest.mark.parametrize("step", [False, True], ids=["a move", "a jog"])
def test_a_gantry_that_does_not_arrive_is_told_in_the_rig_frame(step: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    made = homed()

    def miss(*_: float) -> Triple:
        raise NotArrivedError("port", "it came to rest elsewhere", (420.0, 60.0, 10.0), (430.0, 60.0, 10.0))

    monkeypatch.setattr(made.gantry, "jog" if step else "move_to", miss)
    there = r"not arrived at \(-170\.000, -140\.000, 10\.000\) mm: it came to rest elsewhere, "
    here = r"at \(-180\.000, -140\.000, 10\.000\) mm \(rig frame\)"
    with pytest.raises(HardwareError, match=there + here):
        made.guard.jog(dx_mm=10.0) if step else made.guard.move_to(at(x_mm=-170.0))


def test_what_a_stop_keeps_from_beginning_names_the_command_that_releases_it() -> None:
    made = homed(bench="'my bench.yaml'")
    made.guard.stop("a person")
    with pytest.raises(StoppedError, match=r"`rig stop 'my bench\.yaml' --release`"):
        made.guard.move_to(at(x_mm=-170.0))


def test_of_a_stopped_rig_whose_place_is_not_known_the_stop_is_told_first() -> None:
    made = bench(bench="bench.yaml")
    made.guard.connect()
    made.guard.stop("a person")
    with pytest.raises(StoppedError, match=r"STOP is latched \(a person\).*`rig stop bench.yaml --release`"):
        _ = made.guard.pose


def test_what_is_refused_in_alarm_names_keys_and_command() -> None:
    made = homed(bench="bench.yaml")
    made.gantry.raise_alarm(2)
    made.guard.status()
    with pytest.raises(
        RefusedError, match=r"unlock it or home it \(U or H in `rig jog bench.yaml`, or `rig home bench"
    ):
        made.guard.move_to(at(x_mm=-170.0))


def test_what_a_hold_keeps_from_beginning_names_the_key_that_resumes() -> None:
    made = homed()
    made.guard.hold()
    with pytest.raises(HeldError, match=r"Resume it first \(R in `rig jog`\)"):
        made.guard.move_to(at(x_mm=-170.0))


@pytest.mark.parametrize(
    ("lost", "remedy"),
    [
        ((), r"Home it first \(`rig home bench.yaml`, or `--home`\)"),
        (("pan",), "Look where the pan stands and say it; if at 0: `rig home bench.yaml --theta-deg 0`"),
        (
            ("pan", "zoom"),
            "Look where the pan and the zoom stand and say it; if at 0: `rig home bench.yaml --theta-deg 0 --zoom 0`",
        ),
    ],
)
def test_a_place_that_is_not_known_is_told_with_what_makes_it_known(lost: tuple[str, ...], remedy: str) -> None:
    made = bench(bench="bench.yaml")
    made.guard.connect()
    if lost:
        made.guard.home()
    for name in lost:
        getattr(made, name).lose_power()
    made.guard.status()
    with pytest.raises(RigError, match=f"where the rig stands is not known. {remedy}"):
        _ = made.guard.pose
