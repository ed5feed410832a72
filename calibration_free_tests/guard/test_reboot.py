"""A servo with a hardware error is rebooted only on a person's request, and is then told where it stands."""

from __future__ import annotations

import pytest

from calibration_free_tests.guard.sample import START, at, homed
from rig.errors import HardwareError
from rig.guard import RefusedError, State, StoppedError


def test_point_26_a_reboot_on_request_clears_the_error_and_keeps_the_gantry_homed() -> None:
    made = homed()
    made.pan.overheat()
    assert made.guard.status().state is State.ALARM
    assert made.guard.unlock() is State.ALARM  # a word alone does not cool it
    made.motions.clear()
    assert made.guard.reboot("theta_deg") is State.UNHOMED
    assert (made.motions, made.pan.torque, made.pan.referenced, made.zoom.referenced) == ([], False, False, True)
    with pytest.raises(RefusedError, match="not possible while unhomed"):
        made.guard.move_to(START)
    assert made.guard.reference("theta_deg", 5.0) is State.IDLE
    made.guard.move_to(at(theta_deg=20.0))
    assert made.guard.pose.theta_deg == pytest.approx(20.0)
    assert "home" not in [kind for kind, _ in made.motions]


def test_a_servo_that_reports_no_error_is_not_rebooted() -> None:
    made = homed()
    with pytest.raises(RefusedError, match="reboot is not possible while idle"):
        made.guard.reboot("theta_deg")
    made.pan.overheat()
    made.guard.status()
    with pytest.raises(RefusedError, match=r"zoom reports no hardware error.*would only lose its place"):
        made.guard.reboot("zoom")
    assert made.zoom.referenced
    assert made.guard.state is State.ALARM


def test_there_is_nothing_to_reboot_but_an_axis_of_the_bench() -> None:
    made = homed()
    made.pan.overheat()
    made.guard.status()
    with pytest.raises(RefusedError, match=r"no axis 'x_mm' to reboot. It has theta_deg, zoom"):
        made.guard.reboot("x_mm")


def test_while_stop_is_latched_nothing_is_rebooted() -> None:
    made = homed()
    made.pan.overheat()
    made.guard.status()
    made.guard.stop()
    with pytest.raises(StoppedError):
        made.guard.reboot("theta_deg")
    assert made.pan.overheated
    assert made.guard.release() is State.ALARM
    assert made.guard.reboot("theta_deg") is State.UNHOMED


def test_what_failed_before_still_wants_to_be_looked_at() -> None:
    made = homed()
    made.clock.call_at(made.clock.now_s() + 0.5, made.pan.overheat)
    with pytest.raises(HardwareError, match="pan"):
        made.guard.move_to(at(theta_deg=80.0))
    assert made.guard.state is State.ALARM
    assert made.guard.reboot("theta_deg") is State.ALARM
    assert "the last move failed" in made.guard.glance().troubles[0]
    assert made.guard.unlock() is State.UNHOMED
